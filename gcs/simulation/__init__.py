"""Virtual time: scenarios, metrics, show rehearsal; imports 13 packages, from flight to sim."""

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from gcs.control import Task
    from gcs.simulation.batch import fly_many
    from gcs.simulation.flight import fly
    from gcs.simulation.metrics import FlightMetrics
    from gcs.simulation.result import DIMS, FlightResult
    from gcs.simulation.scenario import Scenario
    from gcs.simulation.stepper import Stepper, StepState

__all__ = [
    "DIMS",
    "ROWS",
    "FlightMetrics",
    "FlightResult",
    "Scenario",
    "StepState",
    "Stepper",
    "Task",
    "fly",
    "fly_many",
]

ROWS: Final = (
    *("shape", "saddle", "article", "tracking", "tracking-real", "separation", "uncertainty", "obstacles"),
    *("moving-boxes", "traffic", "concave", "wind", "delays", "authority", "changes", "neighbours"),
    *("laws", "landing", "loss", "return", "stations", "drawn", "mixed", "site", "lies"),
)
"""The rows of docs/flight-quality.md: scenarios that answer the same question."""

_MODULES: Final = {
    "DIMS": "gcs.simulation.result",
    "FlightMetrics": "gcs.simulation.metrics",
    "FlightResult": "gcs.simulation.result",
    "Scenario": "gcs.simulation.scenario",
    "StepState": "gcs.simulation.stepper",
    "Stepper": "gcs.simulation.stepper",
    "Task": "gcs.control",
    "fly": "gcs.simulation.flight",
    "fly_many": "gcs.simulation.batch",
}


def __getattr__(name: str) -> object:
    """Import what is used: the command line needs ROWS alone, without arrays and kernels."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
