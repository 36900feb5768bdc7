"""What computes the ticks of a simulated flight: one flight, or several that divide the vehicles."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from gcs.control import ControlSettings, Memory, Tasks
from gcs.model.plan import Plan
from gcs.model.state import FleetState, Setpoints, Traits
from gcs.simulation.scenario import Divided
from gcs.simulation.world import TrueWorld


@dataclass(frozen=True, slots=True, eq=False)
class Decided:
    """What one tick of all flights decided. Rows as in the world."""

    setpoints: Setpoints
    memory: Memory  # of all vehicles: each row is its own flight's
    limited_by: tuple[str, ...]  # (n,) why the safety filter limited a vehicle, "" when it did not
    took_s: tuple[float, ...]  # processor time of each flight: what it receives, its tick, what it sends


class Decider(Protocol):
    """Several flights; `gcs.site.simulated` has them."""

    def decide(
        self, fleet: FleetState, tasks: Tasks, plan: Plan, traits: Traits, settings: ControlSettings
    ) -> Decided:
        """One tick of every flight, with what has arrived by then; the arguments are of the whole fleet."""

    @property
    def law_failed(self) -> str:
        """Which flight does not rely on its law any more, and why; empty: all do, or it is shipped."""

    def close(self) -> None:
        """End the processes of the flights' laws."""


Divide: TypeAlias = Callable[[Divided, TrueWorld, int], Decider]
"""Makes the flights of a scenario, with a seed."""
