"""Whether a start would be accepted now: looked at again and again on the ground, for every display."""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final

from gcs.flight.commands.start import Starting, uncontrolled, uncontrolled_reason
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import GcsError
from gcs.model.lifecycle import ON_THE_GROUND
from gcs.service.snapshots import NOT_LOOKED

LOOKS_EVERY_S: Final = 2.0
"""Interval between two looks."""

EACH_S: Final = 0.05
"""The interval is this long for each vehicle at least: a look at a hundred takes 0.1 s of a tick."""

CHANGED_SHARE: Final = 0.125
"""Of the interval, after which a look is due where what decides it has changed."""


@dataclass(eq=False)
class StartOutlook:
    """Used on the event loop only, once a tick."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    starting: Starting
    preflight_gate: PreflightGate
    elsewhere: Callable[[], Elsewhere]
    items_missing: Callable[[], tuple[str, ...]]  # what a start needs of people
    why_not: str = NOT_LOOKED  # why a start would be refused now, in short; empty: it would not
    _own: str = NOT_LOOKED  # the same of this flight alone, of the newest look
    _of: object = None  # what decided it
    _looked_s: float = -inf

    def look(self) -> None:
        """Look anew where one is due."""
        self.why_not = self._why_not()

    def _why_not(self) -> str:
        if self.show.phase not in ON_THE_GROUND or self.vehicles.airborne:
            self._of, self._own = None, NOT_LOOKED  # what was true before this flight says nothing after it
            return f"the show is {self.show.phase}: a start is for the ground"
        if others := uncontrolled(self.vehicles, self.newest):
            return uncontrolled_reason(others)
        if self.starting.countdown is not None:
            return self.starting.why_not_ready
        if self._is_due():
            self._look()
        return self._own or self.elsewhere().why_no_start()

    def _is_due(self) -> bool:
        every_s = max(LOOKS_EVERY_S, EACH_S * len(self.vehicles))
        since_s = self.newest.state.time_s - self._looked_s
        return since_s >= every_s or (since_s >= CHANGED_SHARE * every_s and self._decides() != self._of)

    def _decides(self) -> object:
        """What commands and autopilots change of the answer, as far as it is quickly compared."""
        run, missing = self.show.run, self.items_missing()
        out, phases = self.preflight_gate.left_out, tuple(self.vehicles.phases)
        return run, out, phases, tuple(self.newest.telemetry.ready), missing

    def _look(self) -> None:
        try:
            self._own = self.preflight_gate.outlook()
        except GcsError as error:
            self._own = str(error)
        self._of, self._looked_s = self._decides(), self.newest.state.time_s
