"""A start, immediate or scheduled: the checks before it, and the order of take-offs."""

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.preflight.preflight_gate import Cleared, PreflightGate
from gcs.flight.shows.show_begin import AHEAD_MAX_S
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowEvent, advance_show
from gcs.model.state import VehicleId, Whereabouts
from gcs.service import CommandRecord, Outcome, ShowAction
from gcs.service.commands import CommandLog

log = logging.getLogger(__name__)

LATE_MAX_S = 2.0
"""A start missed by more (suspended computer, or changed clock) is not made up for."""

STANDS_BY: Final = "a spare: it stays on the ground until a vehicle is lost"

NAMED: Final = 6
"""Up to this many vehicles are named; of more, only the number is given."""


def uncontrolled(vehicles: FlightVehicles, newest: Newest) -> list[Vehicle]:
    """Airborne vehicles under the control of a pilot or of their own autopilot."""
    outside = vehicles.in_phase(Phase.PILOT, Phase.KILLED)
    return [vehicle for vehicle in outside if newest.whereabouts(vehicle) is Whereabouts.UNCONTROLLED]


def uncontrolled_reason(vehicles: Collection[Vehicle]) -> str:
    """Return how many of these are airborne and why outside control, grouped by reason."""
    by_reason: dict[str, list[str]] = {}
    for vehicle in vehicles:
        by_reason.setdefault(vehicle.reason, []).append(vehicle.id)
    count = f"{len(vehicles)} {'vehicle' if len(vehicles) == 1 else 'vehicles'} airborne"
    if len(by_reason) == 1:
        (only,) = by_reason
        return f"{count}, not under this station's control: {only}"
    parts = [f"{_named(ids)}: {why.removesuffix('.')}" for why, ids in by_reason.items()]
    return f"{count}, not under this station's control: {'; '.join(parts)}"


def _named(ids: list[str]) -> str:
    return ", ".join(ids) if len(ids) <= NAMED else f"{len(ids)} vehicles"


@dataclass(frozen=True, slots=True)
class Countdown:
    """A start that is scheduled for a clock time."""

    at_unix_s: float
    record: CommandRecord
    chosen: tuple[VehicleId, ...]
    show_hash: str | None


@dataclass(eq=False)
class Starting:
    """Executes start commands, and counts down to scheduled ones."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    book: CommandLog
    unix_s: Callable[[], float]
    stagger_s: float  # between two take-offs
    maneuvers: Maneuvers
    preflight_gate: PreflightGate
    show_player: ShowPlayer
    hashes: Callable[[Sequence[VehicleId], str | None], Mapping[str, str]]  # of vehicles and a show
    countdown: Countdown | None = None

    def begin(
        self, desired: Sequence[VehicleId] | None, show_hash: str | None, at_unix_s: float | None
    ) -> CommandRecord:
        """Take off now, or at a clock time: all checks run now, and again at that time.

        Raises: RefusedError, UnknownError, InvalidError.
        """
        if others := uncontrolled(self.vehicles, self.newest):
            raise RefusedError(f"a start needs all vehicles on the ground: {uncontrolled_reason(others)}")
        event = ShowEvent.START if at_unix_s is None else ShowEvent.SCHEDULE
        advance_show(self.show.phase, event)
        if at_unix_s is not None:
            ahead_s = at_unix_s - self.unix_s()
            if not 0.0 < ahead_s <= AHEAD_MAX_S:
                allowed = f"ahead by at most {AHEAD_MAX_S / 3600.0:g} h; it is {self.unix_s():.1f} now"
                raise InvalidError("at_unix_time_s", at_unix_s, allowed)
        chosen, left_out = self.preflight_gate.need(show_hash, desired)
        if at_unix_s is not None:
            record = self.book.open("start", chosen, left_out)
            self.countdown = Countdown(at_unix_s, record, tuple(chosen), show_hash)
            self.show.move(ShowEvent.SCHEDULE, f"{len(chosen)} vehicles take off in {ahead_s:.0f} s")
            return record
        if self.countdown is not None:
            self._end_countdown(self.countdown, "started before its time, by another command")
        record = self.book.open("start", chosen, left_out)
        self._take_off(record, chosen, left_out, show_hash)
        return record

    def _take_off(
        self,
        record: CommandRecord,
        chosen: Sequence[VehicleId],
        left_out: dict[VehicleId, str],
        show_hash: str | None,
    ) -> None:
        log.info("start_hashes", extra={"command": record.id, **self.hashes(chosen, show_hash)})
        flies = self.show_player.give_parts(chosen)
        for name in chosen[len(flies) :]:
            left_out = left_out | {name: STANDS_BY}
            self.book.close(record.id, name, Outcome.DONE, STANDS_BY)
        chosen = flies
        self.show.left_behind, self.show.accepted = left_out, tuple(chosen)
        self.show.move(ShowEvent.START, "checks every vehicle")
        self.show.move(ShowEvent.CHECKED, f"{len(chosen)} vehicles take off one after the other")
        for turn, name in enumerate(chosen):
            vehicle = self.vehicles[name]
            vehicle.home_m = self.newest.position_m(vehicle).copy()
            delay_s = turn * self.stagger_s
            maneuver = self.maneuvers.take_off(
                delay_s, lambda waiting: self.preflight_gate.need_alone(waiting.id)
            )
            self.maneuvers.start(vehicle, maneuver, self._closer(record, name))

    def _closer(self, record: CommandRecord, name: VehicleId) -> Callable[[Outcome, str], None]:
        """Return a function that closes one vehicle's part; a failed take-off leaves the vehicle behind."""
        close = self.book.closer(record, name)

        def ended(outcome: Outcome, reason: str) -> None:
            if outcome is Outcome.FAILED:
                self.show.left_behind[name] = reason
            close(outcome, reason)

        return ended

    def count_down(self) -> None:
        """Take off at the scheduled time if the checks still pass, otherwise say why; called once a tick."""
        countdown = self.countdown
        if countdown is None:
            return
        late_s = self.unix_s() - countdown.at_unix_s
        if late_s < 0.0 and not self.vehicles.airborne and not uncontrolled(self.vehicles, self.newest):
            return
        try:
            chosen, left_out = self._still_ready(countdown, late_s)
        except (RefusedError, InvalidError, UnknownError) as error:
            self._end_countdown(countdown, str(error))
            self.show.move(ShowEvent.CHECK_FAILED, f"did not start: {error}")
            return
        self.countdown = None
        self._take_off(countdown.record, chosen, left_out, countdown.show_hash)

    def _still_ready(self, countdown: Countdown, late_s: float) -> Cleared:
        """Check again, at take-off time. Raises: RefusedError, InvalidError, UnknownError."""
        if self.vehicles.airborne:
            raise RefusedError("a vehicle is in the air already")
        if others := uncontrolled(self.vehicles, self.newest):
            raise RefusedError(uncontrolled_reason(others))
        if late_s > LATE_MAX_S:
            raise RefusedError(f"its time was missed by {late_s:.1f} s: this machine, or its clock, stood")
        return self.preflight_gate.need(countdown.show_hash, countdown.chosen)

    def _end_countdown(self, countdown: Countdown, reason: str) -> None:
        self.countdown = None
        for name in countdown.chosen:
            self.book.close(countdown.record.id, name, Outcome.FAILED, reason)

    def call_off(self, action: ShowAction) -> CommandRecord:
        if self.countdown is not None:
            self._end_countdown(self.countdown, "called off")
        self.show.move(ShowEvent(action.value), "the countdown was called off")
        return self.book.open(action, [], {})
