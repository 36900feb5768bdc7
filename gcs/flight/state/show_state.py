"""The show of a flight: its phase, and the written show that is selected."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import Phase, ShowEvent, ShowPhase, advance_show
from gcs.model.preflight_report import named
from gcs.model.state import VehicleId

log = logging.getLogger(__name__)

REACHED: Final = "formation reached"


@dataclass(eq=False)
class ShowState:
    """Changed on the event loop only, by commands and by what the vehicles do."""

    now_s: Callable[[], float]  # time of the newest state of the fleet
    phase: ShowPhase = ShowPhase.IDLE
    reason: str = "nothing has been started"
    run: ShowRun | None = None
    phase_before: ShowPhase = ShowPhase.IDLE  # before control of everything airborne was lost
    came_down_by: ShowPhase | None = None  # how the last show ended, if by a command
    accepted: tuple[VehicleId, ...] = ()  # the vehicles that the last start sent up
    left_behind: dict[VehicleId, str] = field(default_factory=dict)  # why others do not fly with it

    def need_no_countdown(self) -> None:
        if self.phase is ShowPhase.COUNTDOWN:
            raise RefusedError("a start is being counted down: stop cancels it")

    def move(self, event: ShowEvent, reason: str) -> None:
        """Move the show to its next phase. Raises: RefusedError when the transition is not allowed."""
        before, self.phase = self.phase, advance_show(self.phase, event)
        self.reason = reason
        if event is ShowEvent.CONTROL_LOST:
            self.phase_before = before
        if event in {ShowEvent.ALL_DOWN, ShowEvent.CONTROL_LOST} and before is not ShowPhase.UNCONTROLLED:
            self.came_down_by = before if before in {ShowPhase.RETURNING, ShowPhase.ABORTING} else None
        if self.run is not None:
            self.run.follow(self.phase, self.now_s())
        log.info("show_phase", extra={"was": before.value, "phase": self.phase.value, "reason": reason})


def reached(show: ShowState, vehicles: FlightVehicles) -> str:
    """That the formation is reached, and which vehicles of the start are not in it."""
    absent = [name for name in show.accepted if vehicles[name].phase is not Phase.FORMATION]
    there = len(show.accepted) - len(absent)
    text = f"{there} of {len(show.accepted)} in formation, without {named(absent)}"
    return text if absent else REACHED
