"""Advances the show automatically, once a tick: telemetry, failsafes, take-off, assembly, landing."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gcs.flight.commands.commander import Commander
from gcs.flight.commands.start import uncontrolled, uncontrolled_reason
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.monitors.failsafe_monitor import FailsafeMonitor
from gcs.flight.monitors.in_place import InPlaceLandings
from gcs.flight.preflight.parameter_reader import ParameterReader
from gcs.flight.shows.show_begin import ShowBegin
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import REACHED, ShowState, reached
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import ANYTHING_FLIES, ON_THE_GROUND, Phase, ShowEvent, ShowPhase
from gcs.model.state import Whereabouts
from gcs.service import ShowAction

log = logging.getLogger(__name__)

REJOINED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING, ShowPhase.PAUSED})
"""Phases of the show in which a vehicle that was lost rejoins the formation automatically."""

OVER = frozenset({ShowPhase.LANDED, ShowPhase.UNCONTROLLED})
"""Phases in which the show leads no vehicle."""


@dataclass(frozen=True, eq=False)
class ComeBack:
    """What vehicles fly that this station has lost, once they are received again."""

    show: ShowState
    maneuvers: Maneuvers
    commander: Commander

    async def fly(self, vehicle: Vehicle) -> None:
        """Take control through HOLD, then join the formation, return or land, as the other vehicles do.

        For a vehicle that was lost, or that holds because its link lost setpoints. A command to return or
        land still applies to it, also when all other vehicles have landed and the show is over. It joins
        automatically only if it was in formation.
        """
        rejoins = vehicle.flags.rejoins
        if vehicle.phase is Phase.PILOT:
            await self.maneuvers.take_control(vehicle)
        else:
            await self.maneuvers.hold(vehicle)
        if self.show.phase in OVER and self.show.came_down_by is not None:
            reason = f"{vehicle.id}, which was lost, is received again and comes down as commanded"
            goes_on = ShowEvent.STOP if self.show.came_down_by is ShowPhase.RETURNING else ShowEvent.ABORT
            self.show.move(ShowEvent.TAKEN_ON, reason)
            self.show.move(goes_on, reason)
        show = self.show.phase
        if show is ShowPhase.RETURNING and vehicle.home_m is not None:
            await self.maneuvers.landings.come_home(vehicle)
        elif show in {ShowPhase.RETURNING, ShowPhase.ABORTING}:
            await self.maneuvers.landings.descend(self.commander.places.sites_m([vehicle])[vehicle.id])(
                vehicle
            )
        elif rejoins and show in REJOINED:
            await self._rejoin(vehicle)

    async def _rejoin(self, vehicle: Vehicle) -> None:
        """Return it to the formation that it was lost from, if there still is room for it."""
        try:
            self.commander.check_room([vehicle])
            await self.maneuvers.join(vehicle)
        except (CommandError, RefusedError) as error:
            vehicle.reason = f"back, and holds: {error}"
            raise
        log.info("rejoined", extra={"vehicle": vehicle.id})


@dataclass(eq=False)
class ShowProgress:
    """Moves the show's phase with what the vehicles do. Called once a tick."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    assembled: Callable[[], bool]
    elsewhere: Callable[[], Elsewhere]
    maneuvers: Maneuvers
    commander: Commander
    parameter_reader: ParameterReader
    failsafe_monitor: FailsafeMonitor
    begin: ShowBegin
    in_place: InPlaceLandings
    _reached: str = REACHED  # as the show has it: which vehicles are in the formation may change

    def advance(self) -> None:
        self.parameter_reader.watch(self.newest.telemetry)  # starts the reads that are due
        self.failsafe_monitor.look()
        self.commander.starting.count_down()
        self.commander.spares.replace_lost()
        if self.commander.collective_return is not None:
            self.commander.collective_return.advance()
        self.in_place.look()
        self.commander.recovery.advance()
        busy: list[Vehicle] = []
        if self.maneuvers.any_running:
            led = (*self.vehicles.airborne, *self.maneuvers.waiting, *self.vehicles.in_phase(Phase.PILOT))
            busy = [vehicle for vehicle in led if self.maneuvers.running(vehicle)]
        self._follow(busy=bool(busy))
        if self.show.phase is ShowPhase.ARMING:
            # vehicles that come down again do not delay the others
            if all(vehicle.phase in {Phase.RETURN, Phase.LANDING} for vehicle in busy):
                self._all_have_taken_off()
        elif self.show.phase is ShowPhase.ASSEMBLING and self.assembled() and not self.begin.waits:
            self._reached = reached(self.show, self.vehicles)
            self.show.move(ShowEvent.ASSEMBLED, self._reached)
        elif (
            (show_run := self.show.run) is not None
            and self.elsewhere().shows.leads
            and show_run.is_over(self.newest.state.time_s)
        ):
            reason = f"show {show_run.name!r} is over: all vehicles return home"
            self.commander.execute_show_failsafe(ShowAction.STOP, reason)
        if self.show.phase is ShowPhase.RUNNING and self.show.reason == self._reached:
            self.show.reason = self._reached = reached(self.show, self.vehicles)
        self.commander.recovery.stalls.note_setpoints()
        self.commander.outlook.look()

    def _all_have_taken_off(self) -> None:
        holding = ", ".join(
            f"{vehicle.id} ({vehicle.reason})" for vehicle in self.vehicles.in_phase(Phase.HOLD)
        )
        if self.vehicles.in_phase(Phase.FORMATION):
            self.show.move(ShowEvent.ALL_UP, "all airborne")
        elif holding:
            self.show.move(ShowEvent.TAKEN_ON, f"no vehicle in formation; waiting for commands: {holding}")
        elif not self.vehicles.airborne:
            self.show.move(ShowEvent.ALL_DOWN, "no vehicle took off")

    def _follow(self, *, busy: bool) -> None:
        """Move the show's phase to match what is airborne; called once a tick.

        `busy`: whether a vehicle is under control, or takes off or lands.
        """
        if self.vehicles.airborne:
            if (
                self.show.phase in ON_THE_GROUND | {ShowPhase.UNCONTROLLED}
                and self.show.phase is not ShowPhase.COUNTDOWN
            ):
                names = ", ".join(vehicle.id for vehicle in self.vehicles.airborne)
                self.show.move(ShowEvent.TAKEN_ON, f"under control, waiting for commands: {names}")
            return
        if busy or self.show.phase in {ShowPhase.PREFLIGHT, ShowPhase.COUNTDOWN}:
            return
        others = uncontrolled(self.vehicles, self.newest)
        if others:
            why = uncontrolled_reason(others)
            if self.show.phase is not ShowPhase.UNCONTROLLED:
                self.show.move(ShowEvent.CONTROL_LOST, why)
            self.show.reason = why
        elif self.show.phase in ANYTHING_FLIES and self.show.phase is not ShowPhase.ARMING:
            self._land()

    def _land(self) -> None:
        """End the phase with nothing airborne: lost and killed vehicles are named, and no longer count."""
        unknown = [
            vehicle.id
            for vehicle in self.vehicles.values()
            if self.newest.whereabouts(vehicle) is Whereabouts.UNKNOWN
        ]
        named = f"; not confirmed on the ground: {', '.join(unknown)}" if unknown else ""
        if self.show.phase is ShowPhase.UNCONTROLLED and self.show.phase_before is ShowPhase.IDLE:
            self.show.move(ShowEvent.NEVER_FLEW, f"nothing is airborne any more{named}")
        else:
            self.show.move(ShowEvent.ALL_DOWN, f"all vehicles have landed{named}")
