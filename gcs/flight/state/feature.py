"""What a flight can do beside flying a formation.

A feature has its settings in the configuration, and is one object in `Flight.features`. The tick, the checks
before a start, the alarms and the view ask every feature; none of them knows one by name.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.vehicle import Vehicle
from gcs.links.intake import Intake
from gcs.model.lifecycle import ShowPhase
from gcs.model.preflight_report import Check
from gcs.service.alarms import Condition
from gcs.service.feature_view import FeatureView


class Instant(NamedTuple):
    """What features are asked about: the time of a tick, and the show then."""

    time_s: float
    show: ShowPhase
    show_run: ShowRun | None  # the selected show


class Feature:
    """One of them; what it does not need stays as it is here."""

    name: str
    """Its field of `gcs.service.features.Features`; empty: it reports nothing there."""

    intakes: Sequence[Intake] = ()
    """What bounds its input."""

    async def receive(self) -> None:
        """Receive its input, without end; at once over where it has none."""

    def find(self, vehicle: Vehicle) -> None:
        """Let a vehicle on the ground be found. Raises: RefusedError."""

    def lead(self, at: Instant) -> None:
        """Change the plan as its input says: once a tick, before it computes."""

    def send(self) -> None:
        """Send what waits, within the links' budgets: once a tick, after the setpoints."""

    def checks(self, at: Instant) -> Iterable[Check]:  # noqa: ARG002
        """Its checks before a start."""
        return ()

    def vehicle_checks(self, vehicle: Vehicle, at: Instant) -> Iterable[Check]:  # noqa: ARG002
        """Its checks of one vehicle before a start."""
        return ()

    def conditions(self, at: Instant) -> Iterable[Condition]:  # noqa: ARG002
        """What operators must know of it."""
        return ()

    def view(self, at: Instant) -> FeatureView | None:  # noqa: ARG002
        """What it reports; None: it is not configured."""
        return None
