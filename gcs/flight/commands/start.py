"""A start, immediate or scheduled: the checks before it, and the order of take-offs."""

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple

from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.preflight.go import CrewGo
from gcs.flight.preflight.preflight_gate import Cleared, PreflightGate
from gcs.flight.shows.show_begin import AHEAD_MAX_S
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowEvent, advance_show
from gcs.model.state import VehicleId, Whereabouts
from gcs.preflight.go import GoByTwo, changes, digest
from gcs.service import CALLER, CommandRecord, Outcome, ShowAction
from gcs.service.commands import CommandLog
from gcs.service.go import ProposedStart

log = logging.getLogger(__name__)

LATE_MAX_S = 2.0
"""A start missed by more (suspended computer, or changed clock) is not made up for."""

STANDS_BY: Final = "a spare: it stays on the ground until a vehicle is lost"

LOOKS_EVERY_S: Final = 2.0
"""Interval between two looks at whether a start that is counted down could still be made."""

PROPOSAL_EVERY_S: Final = 0.5
"""Interval between two looks at whether a proposed start can still be confirmed."""

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


class Approval(NamedTuple):
    """Names of the two tokens of a start, and what they agreed on."""

    proposed_by: str
    confirmed_by: str = ""  # empty: one person starts
    hash: str = ""  # empty: there is none, or another station has it

    @property
    def holds(self) -> bool:
        return bool(self.proposed_by and self.confirmed_by) and self.proposed_by != self.confirmed_by


class StartRequest(NamedTuple):
    """What a start was asked for: the vehicles (None: all that are not left out), the show, the time."""

    desired: tuple[VehicleId, ...] | None
    show_hash: str | None
    at_unix_s: float | None


@dataclass(frozen=True, slots=True)
class WaitingStart:
    """A start that was proposed, and its command, which is pending."""

    record: CommandRecord
    chosen: tuple[VehicleId, ...]
    request: StartRequest


@dataclass(frozen=True, slots=True)
class Countdown:
    """A start that is scheduled for a clock time."""

    at_unix_s: float
    record: CommandRecord
    chosen: tuple[VehicleId, ...]
    request: StartRequest
    parts: Mapping[str, str] | None  # what it was confirmed for; None: it needed no confirmation
    approval: Approval


@dataclass(eq=False)
class Starting:
    """Executes start commands, has them confirmed, and counts down to scheduled ones."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    book: CommandLog
    unix_s: Callable[[], float]
    now_s: Callable[[], float]  # the loop's clock
    stagger_s: float  # between two take-offs
    maneuvers: Maneuvers
    preflight_gate: PreflightGate
    show_player: ShowPlayer
    hashes: Callable[[Sequence[VehicleId], str | None], Mapping[str, str]]  # of vehicles and a show
    go: CrewGo
    countdown: Countdown | None = None
    waiting: WaitingStart | None = None  # for the confirmation of another token
    why_not_ready: str = ""  # why the start that is counted down would be refused now; empty: it would not
    _looked_s: float = -inf  # at the countdown
    _proposal_looked_s: float = -inf

    def begin(
        self,
        desired: Sequence[VehicleId] | None,
        show_hash: str | None,
        at_unix_s: float | None,
        approval: Approval | None = None,
    ) -> CommandRecord:
        """Take off now, or at a clock time: all checks run now, and again at that time.

        Where a start needs two tokens it is proposed only, unless another station has had it confirmed.

        Raises: RefusedError, UnknownError, InvalidError.
        """
        request = StartRequest(None if desired is None else tuple(desired), show_hash, at_unix_s)
        cleared = self._cleared(request)
        if self.go.two is None or (approval is not None and approval.holds):
            return self._accept(request, cleared, None, approval or Approval(CALLER.get()))
        return self._propose(request, cleared)

    def _cleared(self, request: StartRequest) -> Cleared:
        """Run all checks. Raises: RefusedError, UnknownError, InvalidError."""
        if others := uncontrolled(self.vehicles, self.newest):
            raise RefusedError(f"a start needs all vehicles on the ground: {uncontrolled_reason(others)}")
        at_unix_s = request.at_unix_s
        advance_show(self.show.phase, ShowEvent.START if at_unix_s is None else ShowEvent.SCHEDULE)
        if at_unix_s is not None:
            ahead_s = at_unix_s - self.unix_s()
            if not 0.0 < ahead_s <= AHEAD_MAX_S:
                allowed = f"ahead by at most {AHEAD_MAX_S / 3600.0:g} h; it is {self.unix_s():.1f} now"
                raise InvalidError("at_unix_time_s", at_unix_s, allowed)
        return self.preflight_gate.need(request.show_hash, request.desired)

    def _accept(
        self, request: StartRequest, cleared: Cleared, parts: Mapping[str, str] | None, approval: Approval
    ) -> CommandRecord:
        """Take off or count down; `parts` is what the start was confirmed for, None: nothing."""
        chosen, left_out = cleared
        if parts is None and self.go.two is not None:  # a proposal here waits for its own confirmation
            self.go.two.end("another start was made")
            self._drop_waiting(self.go.two.ended)
        waiting, self.waiting = self.waiting, None
        record = self.book.open("start", chosen, left_out) if waiting is None else waiting.record
        if request.at_unix_s is not None:
            ahead_s = request.at_unix_s - self.unix_s()
            self.countdown = Countdown(request.at_unix_s, record, tuple(chosen), request, parts, approval)
            self.why_not_ready, self._looked_s = "", self.now_s()
            self.show.move(ShowEvent.SCHEDULE, f"{len(chosen)} vehicles take off in {ahead_s:.0f} s")
            return record
        if self.countdown is not None:
            self._end_countdown(self.countdown, "started before its time, by another command")
        self._take_off(record, Cleared(chosen, left_out), request.show_hash, approval)
        return record

    # proposed by one token, confirmed by another

    def _propose(self, request: StartRequest, cleared: Cleared) -> CommandRecord:
        two = self._needs_two()
        by, parts = CALLER.get(), self._parts(request, cleared.chosen)
        own = None if self.waiting is None else self._parts_now(self.waiting.request)
        proposal = two.propose(by, parts, self.now_s(), own)
        self._drop_waiting("proposed again")
        record = self.book.open("start", cleared.chosen, cleared.left_out)
        self.waiting = WaitingStart(record, tuple(cleared.chosen), request)
        until_unix_s = self.unix_s() + two.within_s
        count = len(cleared.chosen)
        self.go.proposed = ProposedStart(record.id, by, proposal.hash, until_unix_s, count, request.at_unix_s)
        self.go.refresh()
        log.info(
            "start_proposed",
            extra={"by": by, "count": count, "within_s": two.within_s, "hash": proposal.hash, "of": parts},
        )
        return record

    def confirm(self, go_hash: str) -> CommandRecord:
        """Make the start that another token proposed, after all checks. Raises: RefusedError."""
        two, by, waiting = self._needs_two(), CALLER.get(), self.waiting
        now = {} if waiting is None else self._parts_now(waiting.request)
        try:
            proposal = two.check(by, go_hash, now, self.now_s())
        except RefusedError:
            if two.proposal is None:
                self._drop_waiting(two.ended)
            raise
        if waiting is None:
            raise RefusedError("no start is proposed; gcs start proposes one")
        cleared = self._cleared(waiting.request)
        two.take()
        self.book.open("confirm", [], {})
        approved = {"by": by, "proposed_by": proposal.by, "hash": proposal.hash, "of": dict(proposal.parts)}
        log.info("start_confirmed", extra=approved)
        approval = Approval(proposal.by, by, proposal.hash)
        record = self._accept(waiting.request, cleared, proposal.parts, approval)
        self.go.refresh()
        return record

    def _needs_two(self) -> GoByTwo:
        if self.go.two is None:
            raise RefusedError("a start needs no confirmation here: go.confirmed_by_another is not true")
        return self.go.two

    def _parts(self, request: StartRequest, chosen: Sequence[VehicleId]) -> dict[str, str]:
        """Digest of everything that a start is confirmed for, by name."""
        meant = self.show_player.elsewhere().shows.starting(chosen)
        time = "" if request.at_unix_s is None else digest(request.at_unix_s)
        return {**self.go.hashes(), "vehicles": digest([*meant]), "time": time}

    def _parts_now(self, request: StartRequest) -> dict[str, str]:
        return self._parts(request, self.preflight_gate.meant(request.desired).chosen)

    def _drop_waiting(self, why: str) -> None:
        """Close the command of the start that was proposed, if one was."""
        waiting, self.waiting = self.waiting, None
        if waiting is None:
            return
        for name in waiting.chosen:
            self.book.close(waiting.record.id, name, Outcome.FAILED, f"not confirmed: {why}")
        log.warning("start_not_confirmed", extra={"by": waiting.record.by, "reason": why})
        self.go.refresh()

    def _look_at_proposal(self) -> None:
        """End the proposal once it cannot be confirmed any more."""
        waiting, two, now_s = self.waiting, self.go.two, self.now_s()
        if waiting is None or two is None or now_s - self._proposal_looked_s < PROPOSAL_EVERY_S:
            return
        self._proposal_looked_s = now_s
        if self.vehicles.airborne or uncontrolled(self.vehicles, self.newest):
            two.end("a vehicle is in the air")
        else:
            two.look(self._parts_now(waiting.request), now_s)
        if two.proposal is None:
            self._drop_waiting(two.ended)

    # at its turn, and at its time

    def _take_off(
        self,
        record: CommandRecord,
        cleared: Cleared,
        show_hash: str | None,
        approval: Approval,
    ) -> None:
        chosen, left_out = cleared
        self.go.note_start(record.id, *approval)
        log.info("start_hashes", extra={"command": record.id, **self.hashes(chosen, show_hash)})
        flies = self.show_player.give_parts(chosen)
        for name in chosen[len(flies) :]:
            left_out = left_out | {name: STANDS_BY}
            self.book.close(record.id, name, Outcome.DONE, STANDS_BY)
        self.show.left_behind, self.show.accepted = left_out, tuple(flies)
        self.show.move(ShowEvent.START, "checks every vehicle")
        self.show.move(ShowEvent.CHECKED, f"{len(flies)} vehicles take off one after the other")
        for turn, name in enumerate(flies):
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
        self._look_at_proposal()
        countdown = self.countdown
        if countdown is None:
            return
        late_s = self.unix_s() - countdown.at_unix_s
        if late_s < 0.0 and not self.vehicles.airborne and not uncontrolled(self.vehicles, self.newest):
            self._look_ahead(countdown)
            return
        try:
            cleared = self._still_ready(countdown, late_s)
        except (RefusedError, InvalidError, UnknownError) as error:
            self._end_countdown(countdown, str(error))
            self.show.move(ShowEvent.CHECK_FAILED, f"did not start: {error}")
            return
        self.countdown, self.why_not_ready = None, ""
        self._take_off(countdown.record, cleared, countdown.request.show_hash, countdown.approval)

    def _look_ahead(self, countdown: Countdown) -> None:
        """Note every `LOOKS_EVERY_S` whether the start would be refused now: no countdown is green then."""
        now_s = self.now_s()
        if now_s - self._looked_s < LOOKS_EVERY_S:
            return
        self._looked_s, before = now_s, self.why_not_ready
        try:
            self._still_ready(countdown, 0.0)
        except (RefusedError, InvalidError, UnknownError) as error:
            self.why_not_ready = str(error)
            self.show.reason = f"NOT READY: {error}"
        else:
            self.why_not_ready = ""
            left_s = countdown.at_unix_s - self.unix_s()
            if before:
                self.show.reason = f"{len(countdown.chosen)} vehicles take off in {left_s:.0f} s"

    def _still_ready(self, countdown: Countdown, late_s: float) -> Cleared:
        """Check again, at take-off time. Raises: RefusedError, InvalidError, UnknownError."""
        if self.vehicles.airborne:
            raise RefusedError("a vehicle is in the air already")
        if others := uncontrolled(self.vehicles, self.newest):
            raise RefusedError(uncontrolled_reason(others))
        if late_s > LATE_MAX_S:
            raise RefusedError(f"its time was missed by {late_s:.1f} s: this machine, or its clock, stood")
        if countdown.parts is not None and (
            what := changes(countdown.parts, self._parts_now(countdown.request))
        ):
            raise RefusedError(f"{what} changed since the start was confirmed; propose it again")
        if why := self.show_player.elsewhere().why_apart():
            raise RefusedError(why)
        return self.preflight_gate.need(countdown.request.show_hash, countdown.chosen)

    def _end_countdown(self, countdown: Countdown, reason: str) -> None:
        self.countdown, self.why_not_ready = None, ""
        for name in countdown.chosen:
            self.book.close(countdown.record.id, name, Outcome.FAILED, reason)

    @property
    def can_call_off(self) -> bool:
        """Whether a start is proposed or counted down."""
        return self.countdown is not None or self.waiting is not None

    def call_off(self, action: ShowAction) -> CommandRecord:
        """End the countdown and the proposal: anyone may."""
        if self.go.two is not None:
            self.go.two.end(f"called off by {CALLER.get()}")
            self._drop_waiting(self.go.two.ended)
        if self.countdown is not None:
            self._end_countdown(self.countdown, "called off")
            self.show.move(ShowEvent(action.value), "the countdown was called off")
        return self.book.open(action, [], {})
