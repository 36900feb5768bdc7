"""Advances the show automatically, once a tick: telemetry, failsafes, take-off, assembly, landing."""

import logging
from dataclasses import dataclass
from typing import Final

from gcs.flight.commands.commander import Commander
from gcs.flight.commands.start import uncontrolled, uncontrolled_reason
from gcs.flight.maneuvers.landing_places import landing_sites_m
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.monitors.failsafe_monitor import FailsafeMonitor
from gcs.flight.monitors.telemetry_monitor import TelemetryMonitor
from gcs.flight.preflight.parameter_reader import ParameterReader
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.flight import REACHED, Flight
from gcs.flight.state.ticker import TickClock
from gcs.flight.state.vehicle import Vehicle
from gcs.model.errors import CommandError, RefusedError
from gcs.model.lifecycle import ANYTHING_FLIES, ON_THE_GROUND, Phase, ShowEvent, ShowPhase
from gcs.model.state import Whereabouts
from gcs.service import ShowAction

log = logging.getLogger(__name__)

REJOINED: Final = frozenset({ShowPhase.ASSEMBLING, ShowPhase.RUNNING, ShowPhase.PAUSED})
"""Phases of the show in which a vehicle that was lost rejoins the formation automatically."""

OVER = frozenset({ShowPhase.LANDED, ShowPhase.UNCONTROLLED})
"""Phases in which the show leads no vehicle."""


@dataclass(eq=False)
class ShowProgress:
    """Follows the telemetry with phases, failsafes and the show's progress. Called once a tick."""

    flight: Flight
    maneuvers: Maneuvers
    commander: Commander
    parameter_reader: ParameterReader
    show_player: ShowPlayer
    clock: TickClock

    def __post_init__(self) -> None:
        self._reached = REACHED  # as the show has it: who is in the formation may change
        self.telemetry_monitor = TelemetryMonitor(self.flight, self.maneuvers, self._come_back)
        self.failsafe_monitor = FailsafeMonitor(
            self.flight, self.show_player, self.clock, self.commander, self.maneuvers.running
        )

    def stalled(self, gap_s: float) -> None:
        """Note that no tick came for `gap_s`, longer than any setpoint lives: control may have been lost."""
        self.commander.recovery.stalls.stalled(gap_s)
        self.telemetry_monitor.resume()

    async def _come_back(self, vehicle: Vehicle) -> None:
        """Take control through HOLD, then join the formation, return or land, as the other vehicles do.

        For a vehicle that was lost, or that holds because its link lost setpoints. A command to return or
        land still applies to it, also when all other vehicles have landed and the show is over. It joins
        automatically only if it was in formation.
        """
        flight, rejoins = self.flight, vehicle.flags.rejoins
        if vehicle.phase is Phase.PILOT:
            await self.maneuvers.take_control(vehicle)
        else:
            await self.maneuvers.hold(vehicle)
        if flight.show in OVER and flight.came_down_by is not None:
            reason = f"{vehicle.id}, which was lost, is received again and comes down as commanded"
            goes_on = ShowEvent.STOP if flight.came_down_by is ShowPhase.RETURNING else ShowEvent.ABORT
            flight.move_show(ShowEvent.TAKEN_ON, reason)
            flight.move_show(goes_on, reason)
        show = flight.show
        if show is ShowPhase.RETURNING and vehicle.home_m is not None:
            await self.maneuvers.landings.come_home(vehicle)
        elif show in {ShowPhase.RETURNING, ShowPhase.ABORTING}:
            await self.maneuvers.landings.descend(landing_sites_m(flight, [vehicle])[vehicle.id])(vehicle)
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

    def advance(self) -> None:
        flight = self.flight
        self.parameter_reader.watch(flight.telemetry)  # starts the reads that are due
        self.failsafe_monitor.look()
        self.commander.starting.count_down()
        self.commander.spares.replace_lost()
        if self.commander.collective_return is not None:
            self.commander.collective_return.advance()
        self.commander.recovery.advance()
        busy: list[Vehicle] = []
        if self.maneuvers.any_running:
            led = (*flight.airborne, *self.maneuvers.waiting, *flight.in_phase(Phase.PILOT))
            busy = [vehicle for vehicle in led if self.maneuvers.running(vehicle)]
        _follow(flight, busy=bool(busy))
        if flight.show is ShowPhase.ARMING:
            # vehicles that come down again do not delay the others
            if all(vehicle.phase in {Phase.RETURN, Phase.LANDING} for vehicle in busy):
                self._all_have_taken_off()
        elif flight.show is ShowPhase.ASSEMBLING and flight.assembled() and not self.show_player.begin.waits:
            flight.move_show(ShowEvent.ASSEMBLED, flight.reached)
            self._reached = flight.reason
        elif (
            (show_run := flight.show_run) is not None
            and flight.elsewhere.shows.leads
            and show_run.is_over(flight.state.time_s)
        ):
            reason = f"show {show_run.name!r} is over: all vehicles return home"
            self.commander.execute_show_failsafe(ShowAction.STOP, reason)
        if flight.show is ShowPhase.RUNNING and flight.reason == self._reached:
            flight.reason = self._reached = flight.reached
        self.commander.recovery.stalls.note_setpoints()

    def _all_have_taken_off(self) -> None:
        flight = self.flight
        holding = ", ".join(f"{vehicle.id} ({vehicle.reason})" for vehicle in flight.in_phase(Phase.HOLD))
        if flight.in_phase(Phase.FORMATION):
            flight.move_show(ShowEvent.ALL_UP, "all airborne")
        elif holding:
            flight.move_show(ShowEvent.TAKEN_ON, f"no vehicle in formation; waiting for commands: {holding}")
        elif not flight.airborne:
            flight.move_show(ShowEvent.ALL_DOWN, "no vehicle took off")


def _follow(flight: Flight, *, busy: bool) -> None:
    """Move the show's phase to match what is airborne; called once a tick.

    `busy`: whether a vehicle is under control, or takes off or lands.
    """
    if flight.airborne:
        if flight.show in ON_THE_GROUND | {ShowPhase.UNCONTROLLED} and flight.show is not ShowPhase.COUNTDOWN:
            names = ", ".join(vehicle.id for vehicle in flight.airborne)
            flight.move_show(ShowEvent.TAKEN_ON, f"under control, waiting for commands: {names}")
        return
    if busy or flight.show in {ShowPhase.PREFLIGHT, ShowPhase.COUNTDOWN}:
        return
    others = uncontrolled(flight)
    if others:
        why = uncontrolled_reason(others)
        if flight.show is not ShowPhase.UNCONTROLLED:
            flight.move_show(ShowEvent.CONTROL_LOST, why)
        flight.reason = why
    elif flight.show in ANYTHING_FLIES and flight.show is not ShowPhase.ARMING:
        _land(flight)


def _land(flight: Flight) -> None:
    """End the phase with nothing airborne: lost and killed vehicles are named, and no longer count."""
    unknown = [one.id for one in flight.vehicles.values() if flight.whereabouts(one) is Whereabouts.UNKNOWN]
    named = f"; not confirmed on the ground: {', '.join(unknown)}" if unknown else ""
    if flight.show is ShowPhase.UNCONTROLLED and flight.show_before is ShowPhase.IDLE:
        flight.move_show(ShowEvent.NEVER_FLEW, f"nothing is airborne any more{named}")
    else:
        flight.move_show(ShowEvent.ALL_DOWN, f"all vehicles have landed{named}")
