"""A flight that was cut off: its pads are known again, and its vehicles are taken on when that is ordered.

The service ended, and the record knows what was flown; or it stalled, and what was flown when the stall began
is known from memory. Both are an `Interruption`, and both offer the same two commands.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from gcs.control_refusal import why_never, why_not_without_heartbeat
from gcs.errands import Errands
from gcs.errors import GcsError, RefusedError
from gcs.failsafe_cause import FailsafeCause
from gcs.feasibility import check_formation, check_orbit, check_target, followed
from gcs.flight import Flight
from gcs.interrupted import (
    TAKEN_OVER_FROM,
    Before,
    Interrupted,
    Interruption,
    Offer,
    Remaining,
    Triple,
    Written,
    is_left_alone,
    left_by,
    mismatches,
    remaining,
    triple,
)
from gcs.lifecycle import AIRBORNE, FLOWN, Phase, ShowPhase
from gcs.orders import OrderBook
from gcs.plan import Plan
from gcs.records.plans import plan_of
from gcs.service import OrderRecord, Outcome
from gcs.stage import Stage
from gcs.state import Mode, VehicleId
from gcs.vehicle import Vehicle

log = logging.getLogger(__name__)

BEGUN_ANEW = frozenset({ShowPhase.PREFLIGHT, ShowPhase.ARMING})
"""Whoever starts a show has settled what was before."""

STALL_EXPLAINS_S = 3.0
"""So long after a stall it explains modes: heartbeats come once a second, and the oldest are read first."""

STALL_SHARE = 0.7
"""A stall explains a setpoint-loss failsafe from this share of `operation.setpoint_loss_s` on: the last
setpoint may have been late, and vehicles may be set to less.
"""


RECEIVED_WITHIN_S: Final = 3.0
"""So long a command for the interrupted flight awaits vehicles of which nothing was received yet."""

REPLACED: Final = "replaced by another command"

COMES_DOWN: Final = frozenset({ShowPhase.RETURNING, ShowPhase.ABORTING})

OTHER_FAILSAFES = frozenset(FailsafeCause) - {
    FailsafeCause.SETPOINT_LOSS,
    FailsafeCause.DATA_LINK_LOSS,
    FailsafeCause.OTHER,
    FailsafeCause.UNKNOWN,
}
"""What a stall does not explain."""


@dataclass(slots=True, eq=False)
class _Batch:
    """Vehicles that are handed back together, for an order."""

    record: OrderRecord
    awaited: set[VehicleId]
    handed: list[Vehicle] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class _Expected:
    """Vehicles of the interrupted flight that a command means, and of which nothing was received yet."""

    vehicles: dict[VehicleId, Vehicle]
    until_s: float
    reached: Callable[[Vehicle], None]  # it was received, and waits for a command
    missed: Callable[[Vehicle, Outcome, str], None]  # it was not, or it may not be commanded


@dataclass(frozen=True, slots=True)
class _Stall:
    """What was flown when a stall began, and until when a mode is explained by it."""

    flown: Interruption
    until_s: float


class Takeover:
    """Knows what was cut off until everybody is accounted for. Changed only on the event loop."""

    def __init__(
        self,
        flight: Flight,
        errands: Errands,
        book: OrderBook,
        stage: Stage,
        found: Interruption | None,
        send_home: Callable[[str], OrderRecord],
        unix_s: Callable[[], float],
    ) -> None:
        """Restores the pads, nothing else. `send_home` brings vehicles that hold home together."""
        self._flight = flight
        self._errands = errands
        self._book = book
        self._stage = stage
        self._found = found
        self._send_home = send_home
        self._unix_s = unix_s
        self._batch: _Batch | None = None
        self._wrong: tuple[str, ...] = ()  # with the whole record
        self._sent_on: set[VehicleId] = set()
        self._expected: _Expected | None = None
        self._restored: set[Offer] = set()  # what was wanted then is wanted again: only once
        self._no_plan = ""  # why the formation cannot go on
        self._stall: _Stall | None = None
        self._under_setpoints: set[VehicleId] = set()  # as of the tick before
        self._regained: set[VehicleId] = set()  # of what was found, those that were under control since
        if found is not None:
            self._restore_pads(found)

    def _restore_pads(self, found: Interruption) -> None:
        config, vehicles = self._flight.config, self._flight.vehicles
        ids = {name: vehicle.system_id for name, vehicle in vehicles.items()}
        self._wrong = tuple(mismatches(found, config.show_frame.model_dump(), ids))
        if not self._wrong:
            for name, before in found.vehicles.items():
                if before.pad_m is not None:
                    vehicles[name].home_m = np.array(before.pad_m)
            self._no_plan = self._why_no_plan(found)
        told = {"of_session": found.session, "was": found.show.value, "mismatches": list(self._wrong)}
        log.warning("found_interrupted", extra=told)

    def _why_no_plan(self, found: Interruption) -> str:
        """Why nobody can be sent back into the formation; empty when they can."""
        if found.show not in TAKEN_OVER_FROM:
            return f"take-over is not offered: the show was {found.show}"
        try:
            if found.stalled_s is not None and found.plan is None:
                return ""  # the plan that was flown still stands
            if found.written is not None:
                self._stage.find(found.written.name, found.written.hash)
            else:
                self._plan(found)
        except GcsError as error:
            return f"take-over is not offered: {error}"
        return ""

    # a stall

    def note_setpoints(self) -> None:
        """Once a tick, at its end: remember which vehicles fly under setpoints until the next."""
        self._under_setpoints = {
            vehicle.id
            for vehicle in self._flight.vehicles.values()
            if vehicle.engaging or (vehicle.phase in FLOWN and not vehicle.handed_over)
        }

    def stalled(self, gap_s: float) -> None:
        """No tick came for `gap_s`: remember what was flown. To be called before telemetry changes phases."""
        flight = self._flight
        now_s = flight.fleet.time_s
        if gap_s < STALL_SHARE * flight.config.operation.setpoint_loss_s:
            return
        log.warning("service_stalled", extra={"stalled_s": round(gap_s, 1), "show": flight.show.value})
        if not self._under_setpoints:
            return
        flown = Interruption(
            session="",
            unix_s=self._unix_s() - gap_s,
            show=flight.show,
            reason=flight.reason,
            frame=flight.config.show_frame.model_dump(),
            vehicles={
                name: Before(vehicle.system_id, vehicle.phase, vehicle.reason, _place(vehicle))
                for name, vehicle in flight.vehicles.items()
                if name in self._under_setpoints
            },
            written=self._written(),
            plan=None,
            stalled_s=gap_s,
        )
        self._stall = _Stall(flown, now_s + STALL_EXPLAINS_S)

    def _written(self) -> Written | None:
        performance = self._flight.performance
        if performance is None:
            return None
        shown = performance.view(self._flight.fleet.time_s)
        return Written(shown.name, shown.hash, shown.cue, shown.clock_s, dict(performance.parts))

    def _explain(self, stall: _Stall) -> None:
        """Count those that the stall took out of control to what was cut off."""
        flight = self._flight
        action = flight.config.operation.setpoint_loss_action
        fallen = {}
        for name, before in stall.flown.vehicles.items():
            vehicle, known = flight.vehicles[name], self._found is not None and name in self._found.vehicles
            if vehicle.phase is not Phase.PILOT or (known and name not in self._regained):
                continue
            mode = flight.mode(vehicle)
            if vehicle.cause in OTHER_FAILSAFES:
                continue
            if mode is not Mode.OFFBOARD and is_left_alone(Phase.FORMATION, mode, action):
                vehicle.reason = left_by(stall.flown.cause, mode)
                fallen[name] = before
        if not fallen:
            return
        self._regained -= fallen.keys()
        if self._found is None:
            self._found = replace(stall.flown, vehicles=fallen)
            self._wrong, self._sent_on = (), set()
            self._no_plan = self._why_no_plan(stall.flown)
        else:
            vehicles = {**self._found.vehicles, **fallen}
            plan = None if Offer.TAKE_OVER in self._restored else self._found.plan  # flown since
            self._found = replace(self._found, vehicles=vehicles, stalled_s=stall.flown.stalled_s, plan=plan)
        self._sent_on -= fallen.keys()
        log.warning("interrupted", extra={**self._found.to_json(), "cause": self._found.cause})

    @property
    def reclaimable(self) -> list[Vehicle]:
        """Airborne out of control, as the stall or the restart explains: a command may take control first."""
        shown = self.view()
        waiting = () if shown is None or self._wrong else (one.id for one in shown.vehicles if one.waits)
        vehicles = [self._flight.vehicles[name] for name in waiting]
        return [one for one in vehicles if one.phase is Phase.PILOT and not self._why_not(one)]

    def _why_not(self, vehicle: Vehicle) -> str:
        """Why no command to all takes control of it; empty when one may."""
        return why_never(self._flight, vehicle) or why_not_without_heartbeat(self._flight, vehicle)

    @property
    def unreceived(self) -> list[Vehicle]:
        """Of the interrupted flight, those of which nothing was received yet: a command means them."""
        if self._found is None or self._wrong:
            return []
        vehicles = [self._flight.vehicles[name] for name in self._found.vehicles]
        return [one for one in vehicles if one.phase is Phase.OFFLINE]

    def expect(
        self,
        vehicles: Sequence[Vehicle],
        reached: Callable[[Vehicle], None],
        missed: Callable[[Vehicle, Outcome, str], None],
    ) -> None:
        """Await `vehicles` for a command, instead of those that an earlier one awaits.

        Args:
            vehicles: of `unreceived`.
            reached: called once for each that is received in time, and that the command may take control of.
            missed: called once for each other, with the outcome and the reason.
        """
        self._expect_no_more()
        if vehicles:
            until_s = self._flight.fleet.time_s + RECEIVED_WITHIN_S
            self._expected = _Expected({one.id: one for one in vehicles}, until_s, reached, missed)

    def _expect_no_more(self) -> None:
        expected, self._expected = self._expected, None
        if expected is not None:
            for vehicle in expected.vehicles.values():
                expected.missed(vehicle, Outcome.FAILED, REPLACED)

    def _receive(self, expected: _Expected) -> None:
        """Hand on those that were received meanwhile; name those that were not received in time."""
        late = self._flight.fleet.time_s > expected.until_s
        waiting = {one.id for one in self.reclaimable}
        shown = self.view()
        texts = {} if shown is None else {one.id: one.text for one in shown.vehicles}
        for vehicle in list(expected.vehicles.values()):
            if vehicle.phase is Phase.OFFLINE and not late:
                continue
            del expected.vehicles[vehicle.id]
            if vehicle.phase is Phase.OFFLINE:
                why = f"not received within {RECEIVED_WITHIN_S:g} s of the command"
                expected.missed(vehicle, Outcome.FAILED, why)
            elif vehicle.id in waiting:
                expected.reached(vehicle)
            else:
                why_not = self._why_not(vehicle) if vehicle.phase is Phase.PILOT else ""
                expected.missed(
                    vehicle, Outcome.NOT_INCLUDED, why_not or texts.get(vehicle.id, vehicle.reason)
                )
        if not expected.vehicles and self._expected is expected:
            self._expected = None

    # once a tick

    def advance(self) -> None:
        """Go on with a batch that holds; forget what is settled."""
        if self._stall is not None:
            self._explain(self._stall)
            if self._flight.fleet.time_s > self._stall.until_s:
                self._stall = None
        found, batch = self._found, self._batch
        if found is not None:
            self._keep_true(found)
        if self._expected is not None:
            self._receive(self._expected)
        if batch is not None and not batch.awaited:
            self._batch = None
            self._go_on(batch)
        if found is None:
            return
        if self._flight.show in BEGUN_ANEW or (found.vehicles and self._all_settled(found)):
            log.info("interruption_over", extra={"of_session": found.session})
            self._found, self._regained, self._restored = None, set(), set()

    def _keep_true(self, found: Interruption) -> None:
        """Remember which vehicles came under control again, and say why the others are not."""
        for name, before in found.vehicles.items():
            vehicle = self._flight.vehicles.get(name)
            if vehicle is None:
                continue
            if vehicle.phase in AIRBORNE:
                self._regained.add(name)
            elif vehicle.phase is Phase.PILOT and not self._wrong:
                shown = self._remaining(name, before)
                if shown.waits:
                    vehicle.reason = left_by(found.cause, self._flight.mode(vehicle))
                elif vehicle.reason.startswith(found.cause):
                    vehicle.reason = shown.text

    def _all_settled(self, found: Interruption) -> bool:
        """Nobody is unheard or waits for an order, and nobody who was handed back is yet to be sent on."""
        if self._batch is not None or self._expected is not None:
            return False
        open_phases = {Phase.OFFLINE, Phase.PILOT, Phase.HOLD}
        left = [one for name in found.vehicles if (one := self._flight.vehicles.get(name)) is not None]
        return all(one.id in self._sent_on or one.phase not in open_phases for one in left)

    def view(self) -> Interrupted | None:
        """What an operator is shown."""
        found = self._found
        if found is None:
            return None
        vehicles = tuple(self._remaining(name, before) for name, before in found.vehicles.items())
        problems = [*self._wrong, *([self._no_plan] if self._no_plan and found.vehicles else [])]
        offers = []
        if not self._wrong and any(one.waits for one in vehicles):
            if not self._no_plan:
                offers.append(Offer.TAKE_OVER)
            if any(one.waits and one.pad_known for one in vehicles):
                offers.append(Offer.BRING_HOME)
            else:
                problems.append("bring-home is not offered: where they took off is not known")
        return Interrupted(
            found.session,
            found.unix_s,
            found.show,
            found.written,
            vehicles,
            tuple(offers),
            tuple(problems),
            found.cause,
            stalled=found.stalled_s is not None,
        )

    def _remaining(self, name: VehicleId, before: Before) -> Remaining:
        vehicle = self._flight.vehicles.get(name)
        if vehicle is None:
            return Remaining(name, before.phase, before.pad_m is not None, waits=False, text="not configured")
        mode, action = self._flight.mode(vehicle), self._flight.config.operation.setpoint_loss_action
        taken_again = name in self._regained
        return remaining(name, before, vehicle.phase, mode, action, taken_again=taken_again)

    # orders

    def settle(self, offer: Offer) -> OrderRecord:
        """Carry out an offer. Raises: RefusedError when it is not offered."""
        found, shown = self._found, self.view()
        if found is None or shown is None:
            raise RefusedError("no flight was cut off, or all of it is settled")
        if offer not in shown.offers:
            raise RefusedError(f"{offer} is not offered: {shown.notice}")
        self._restore(found, offer)
        waiting = {one.id for one in shown.vehicles if one.waits}
        refused = {
            name: why
            for name in waiting
            if (vehicle := self._flight.vehicles[name]).phase is Phase.PILOT
            and (why := self._why_not(vehicle))
        }
        waiting -= refused.keys()
        if offer is Offer.BRING_HOME:
            return self._send_home(f"brought home: {shown.cause}")
        chosen = [vehicle for name, vehicle in self._flight.vehicles.items() if name in waiting]
        unreceived = self.unreceived
        meant = [vehicle.id for vehicle in (*chosen, *unreceived)]
        left_out = {one.id: one.text for one in shown.vehicles if one.id not in meant} | refused
        record = self._book.open(offer.value, meant, left_out)
        if self._batch is not None:
            self._close(self._batch)
        batch = _Batch(record, set(meant))
        self._batch = batch
        self.expect(unreceived, partial(self._take_one, batch), partial(self._note, batch))
        for vehicle in chosen:
            if vehicle.phase is Phase.PILOT:
                self._take_one(batch, vehicle)
            else:
                self._note(batch, vehicle, Outcome.DONE, "")
        return record

    def _take_one(self, batch: _Batch, vehicle: Vehicle) -> None:
        self._errands.start(vehicle, self._errands.take_control, partial(self._note, batch, vehicle))

    def _close(self, batch: _Batch) -> None:
        """Another take-over begins before all of this batch hold."""
        for vehicle in batch.handed:
            self._book.close(batch.record.id, vehicle.id, Outcome.FAILED, REPLACED)

    def _note(self, batch: _Batch, vehicle: Vehicle, outcome: Outcome, reason: str) -> None:
        """One of a batch holds, or could not be had."""
        batch.awaited.discard(vehicle.id)
        if outcome is Outcome.DONE:
            batch.handed.append(vehicle)
        else:
            self._book.close(batch.record.id, vehicle.id, outcome, reason)

    def _go_on(self, batch: _Batch) -> None:
        """All of a batch hold: send them on, together."""
        ours = [one for one in batch.handed if one.phase is Phase.HOLD and not self._is_commanded(one)]
        for vehicle in batch.handed:
            if vehicle not in ours:
                changed = f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}"
                reason = REPLACED if vehicle.phase is Phase.HOLD else changed
                self._book.close(batch.record.id, vehicle.id, Outcome.FAILED, reason)
        self._sent_on |= {vehicle.id for vehicle in ours}
        for vehicle in ours:
            if self._rejoins(vehicle):
                closer = self._book.closer(batch.record, vehicle.id)
                self._errands.start(vehicle, self._errands.join, closer)
            else:
                self._book.close(batch.record.id, vehicle.id, Outcome.DONE, "holds, as before")

    def _is_commanded(self, vehicle: Vehicle) -> bool:
        """Whether another command has come since it holds: that one counts."""
        return self._errands.running(vehicle) or self._flight.show in COMES_DOWN

    def _rejoins(self, vehicle: Vehicle) -> bool:
        found = self._found
        before = None if found is None else found.vehicles.get(vehicle.id)
        if found is None or before is None or vehicle.phase is not Phase.HOLD:
            return False
        on_its_way = before.phase is Phase.HOLD and found.show is ShowPhase.ARMING
        return on_its_way or before.phase in {Phase.FORMATION, Phase.TAKEOFF, Phase.LOST}

    # what was flown

    def _restore(self, found: Interruption, offer: Offer) -> None:
        """Want again what was wanted: all of it, or for the way home the obstacles. Raises: RefusedError."""
        if found.plan is None and found.stalled_s is not None:
            return  # it was never forgotten
        if not self._restored.isdisjoint({offer, Offer.TAKE_OVER}):
            return  # what was changed since then is wanted now
        self._restore_first(found, offer)
        self._restored.add(offer)

    def _restore_first(self, found: Interruption, offer: Offer) -> None:
        if offer is Offer.BRING_HOME:
            if found.plan is not None and self._flight.performance is None:
                obstacles = self._recorded(found).obstacles
                self._flight.plan = replace(self._flight.plan, obstacles=obstacles)
            return
        plan = self._plan(found)
        if found.written is None:
            self._flight.plan = plan
        elif self._flight.performance is None:
            self._stage.resume(found.written, plan)

    def _recorded(self, found: Interruption) -> Plan:
        """The plan, where it has got to meanwhile. Raises: RefusedError when it is none."""
        if found.plan is None:
            raise RefusedError("what was flown is not in the record")
        now_s = self._flight.fleet.time_s
        try:
            shift_s = now_s - (self._unix_s() - found.unix_s) - float(found.plan["time_s"])
            return plan_of(found.plan, shift_s)
        except (GcsError, KeyError, TypeError, ValueError) as error:
            raise RefusedError(f"the plan of the record cannot be read: {error!r}") from None

    def _plan(self, found: Interruption) -> Plan:
        """The same, if it may be flown. Raises: RefusedError."""
        plan, control = self._recorded(found), self._flight.control
        if found.written is not None:
            return plan  # checked as a whole, under its own limits
        try:
            check_formation(plan.formation, max(1, len(found.vehicles)), control.safety)
            check_orbit(plan.orbit, control.law)
            target = followed(plan, self._flight.fleet.time_s, control.safety.fence)
            check_target(target, plan.orbit, plan.formation, control)
        except GcsError as error:
            raise RefusedError(f"what was flown cannot be flown now: {error}") from None
        return plan


def _place(vehicle: Vehicle) -> Triple | None:
    return None if vehicle.home_m is None else triple(vehicle.home_m.tolist())
