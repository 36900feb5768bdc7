"""An interrupted flight: which vehicles wait for a command, and the two commands offered for all of them.

The service ended, and the record knows what was flown; or it stalled, and
`gcs.flight.commands.stall_recovery` remembers it. Both are an `Interruption`.
"""

import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from gcs.failsafe.autopilot_failsafe import FailsafeInputs
from gcs.flight.commands.plan_editor import RestoredPlan
from gcs.flight.commands.stall_recovery import REPLACED, AwaitedVehicles, Stall, StallRecovery
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.state.newest import Newest
from gcs.flight.state.refusals import Refusals, with_alternative
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import (
    Before,
    InterruptedFlight,
    Interruption,
    Offer,
    Remaining,
    left_by,
    mismatches,
    remaining,
)
from gcs.model.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.service import CommandRecord, Outcome
from gcs.service.commands import CommandLog

log = logging.getLogger(__name__)

BEGUN_ANEW = frozenset({ShowPhase.PREFLIGHT, ShowPhase.ARMING})
"""A start settles every interruption before it."""

COMES_DOWN: Final = frozenset({ShowPhase.RETURNING, ShowPhase.ABORTING})


@dataclass(slots=True, eq=False)
class _Batch:
    """Vehicles that one command hands back together."""

    records: list[CommandRecord]  # the take-over's record, and those of commands that close with it
    awaited: set[VehicleId]
    handed: list[Vehicle] = field(default_factory=list)


@dataclass(eq=False)
class FlightRecovery:
    """Tracks an interrupted flight until all its vehicles are accounted for: `gcs.service.Recovery`."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    book: CommandLog
    inputs: Callable[[Vehicle], FailsafeInputs]
    refusals: Refusals
    maneuvers: Maneuvers
    plans: RestoredPlan
    stalls: StallRecovery
    awaited: AwaitedVehicles
    found: Interruption | None
    send_home: Callable[[str], CommandRecord]

    def __post_init__(self) -> None:
        self._batch: _Batch | None = None
        self._wrong: tuple[str, ...] = ()  # what is wrong with the whole record
        self._sent_on: set[VehicleId] = set()
        self._no_plan = ""  # why the formation cannot go on
        self._regained: set[VehicleId] = set()  # vehicles of the interruption that were under control since
        if self.found is not None:
            self._restore_pads(self.found)

    def _restore_pads(self, interruption: Interruption) -> None:
        vehicles = self.vehicles
        ids = {name: vehicle.system_id for name, vehicle in vehicles.items()}
        self._wrong = tuple(mismatches(interruption, self.stalls.show_frame.model_dump(), ids))
        if not self._wrong:
            for name, before in interruption.vehicles.items():
                if before.pad_m is not None:
                    vehicles[name].home_m = np.array(before.pad_m)
            self.review()

    def review(self) -> None:
        """Find out whether the formation can go on, with all vehicles that take part by now."""
        if self.found is not None and not self._wrong:
            self._no_plan = self.plans.why_not(self.found)

    def log_found(self) -> None:
        """Log the flight that was interrupted before this service began, if there is one."""
        if (interruption := self.found) is not None:
            about = {"of_session": interruption.session, "was": interruption.show.value}
            log.warning("found_interrupted", extra={**about, "mismatches": list(self._wrong)})

    def _explain(self, stall: Stall) -> None:
        """Add the vehicles that the stall took out of control to the interruption."""
        interrupted = set() if self.found is None else self.found.vehicles.keys() - self._regained
        fallen = self.stalls.fallen(interrupted)
        if not fallen:
            return
        self._regained -= fallen.keys()
        if self.found is None:
            self.found = replace(stall.flown, vehicles=fallen)
            self._wrong, self._sent_on = (), set()
            self._no_plan = self.plans.why_not(stall.flown)
        else:
            vehicles = {**self.found.vehicles, **fallen}
            plan = None if self.plans.is_taken_over else self.found.plan  # flown since
            self.found = replace(self.found, vehicles=vehicles, stalled_s=stall.flown.stalled_s, plan=plan)
        self._sent_on -= fallen.keys()
        log.warning("interrupted", extra={**asdict(self.found), "cause": self.found.cause})
        for name in fallen:
            vehicle = self.vehicles[name]
            if not self.maneuvers.running(vehicle):
                self.awaited.falls(vehicle, stall.since_s)

    def reaches_again(self, vehicle: Vehicle) -> bool:
        """Whether the stall has just ended a command of `vehicle` that was given after it.

        Such a command is not over: it reaches the vehicle again once the vehicle's mode is explained.
        """
        stall = self.stalls.stall
        if stall is None or vehicle.phase is not Phase.PILOT or vehicle.id not in stall.flown.vehicles:
            return False
        return self.awaited.falls(vehicle, stall.since_s)

    @property
    def reclaimable(self) -> list[Vehicle]:
        """Airborne vehicles that the stall or restart took out of control; a command may take it first."""
        shown = self.view()
        left = {} if shown is None or self._wrong else shown.vehicles
        vehicles = [self.vehicles[name] for name, vehicle in left.items() if vehicle.waits]
        return [vehicle for vehicle in vehicles if vehicle.phase is Phase.PILOT and not self.why_not(vehicle)]

    def reclaim(self) -> list[Vehicle]:
        """Return `reclaimable` for a command that reaches them now, and restore that flight's obstacles."""
        if self.found is not None and not self._wrong:
            self.plans.restore(self.found, Offer.BRING_HOME)
        return self.reclaimable

    def why_not(self, vehicle: Vehicle) -> str:
        """Why no fleet-wide command takes control of it; empty when one may."""
        return (
            self.refusals.why_never(vehicle)
            or self.refusals.why_not_without_heartbeat(vehicle)
            or self.refusals.why_not_touching_down(vehicle)
        )

    @property
    def unreceived(self) -> list[Vehicle]:
        """Vehicles of the interrupted flight that have sent nothing yet: a command to all includes them."""
        if self.found is None or self._wrong:
            return []
        return [
            self.vehicles[name] for name in self.found.vehicles if self._is_unreceived(self.vehicles[name])
        ]

    def _is_unreceived(self, vehicle: Vehicle) -> bool:
        """Whether it has sent nothing yet; after a stall no heartbeat, which comes within a second."""
        if vehicle.phase is not Phase.PILOT or self.stalls.stall is None:
            return vehicle.phase is Phase.OFFLINE
        never = self.refusals.why_never(vehicle) or self.refusals.why_not_touching_down(vehicle)
        return not never and bool(self.refusals.why_not_without_heartbeat(vehicle))

    def _receive(self) -> None:
        shown = self.view()
        texts = (
            {} if shown is None else {name: reclaimable.text for name, reclaimable in shown.vehicles.items()}
        )

        def why_missed(vehicle: Vehicle) -> str:
            why = self.why_not(vehicle) if vehicle.phase is Phase.PILOT else ""
            return why or texts.get(vehicle.id, vehicle.reason)

        reclaimable = {vehicle.id for vehicle in self.reclaimable}
        self.awaited.receive(reclaimable, self._is_unreceived, why_missed)

    # once a tick

    def advance(self) -> None:
        """Continue a batch whose vehicles hold, and forget interruptions that are settled."""
        stall = self.stalls.stall
        if stall is not None:
            self._explain(stall)
        self.stalls.expire()
        interruption, batch = self.found, self._batch
        if interruption is not None:
            self._keep_true(interruption)
        if self.awaited.any:
            self._receive()
        if batch is not None and not batch.awaited:
            self._batch = None
            self._go_on(batch)
        if interruption is None:
            return
        if self.show.phase in BEGUN_ANEW or (interruption.vehicles and self._all_settled(interruption)):
            log.info("interruption_over", extra={"of_session": interruption.session})
            self.found, self._regained = None, set()
            self.plans.forget()

    def _keep_true(self, interruption: Interruption) -> None:
        """Remember which vehicles came under control again, and report why the others are not."""
        for name, before in interruption.vehicles.items():
            vehicle = self.vehicles.get(name)
            if vehicle is None:
                continue
            if vehicle.phase in AIRBORNE:
                self._regained.add(name)
            elif vehicle.phase is Phase.PILOT and not self._wrong:
                shown = self._remaining(name, before)
                if shown.waits:
                    alone, mode = vehicle.without_setpoints, self.newest.mode(vehicle)
                    vehicle.reason = left_by(interruption.cause, mode, changes_mode=alone.changes_mode)
                elif vehicle.reason.startswith(interruption.cause):
                    vehicle.reason = shown.text

    def _all_settled(self, interruption: Interruption) -> bool:
        """Whether no vehicle is unreceived, waits for a command, or is handed back but not sent on."""
        if self._batch is not None or self.awaited.any:
            return False
        open_phases = {Phase.OFFLINE, Phase.PILOT, Phase.HOLD}
        left = [vehicle for name in interruption.vehicles if (vehicle := self.vehicles.get(name)) is not None]
        return all(vehicle.id in self._sent_on or vehicle.phase not in open_phases for vehicle in left)

    def view(self) -> InterruptedFlight | None:
        interruption = self.found
        if interruption is None:
            return None
        vehicles = {name: self._remaining(name, before) for name, before in interruption.vehicles.items()}
        problems = [*self._wrong, *([self._no_plan] if self._no_plan and interruption.vehicles else [])]
        offers = []
        if not self._wrong and any(left.waits for left in vehicles.values()):
            if not self._no_plan:
                offers.append(Offer.TAKE_OVER)
            if any(left.waits and left.pad_known for left in vehicles.values()):
                offers.append(Offer.BRING_HOME)
            else:
                problems.append("bring-home is not offered: where they took off is not known")
        return InterruptedFlight(
            interruption.session,
            interruption.unix_s,
            interruption.show,
            interruption.written,
            vehicles,
            tuple(offers),
            tuple(problems),
            interruption.cause,
            stalled=interruption.stalled_s is not None,
        )

    def _remaining(self, name: VehicleId, before: Before) -> Remaining:
        vehicle = self.vehicles.get(name)
        if vehicle is None:
            return Remaining(before.phase, before.pad_m is not None, waits=False, text="not configured")
        facts, action = self.inputs(vehicle), vehicle.without_setpoints.action
        about, again = (before, vehicle.phase, facts.mode, action), name in self._regained
        return remaining(*about, in_failsafe=facts.in_failsafe, taken_again=again)

    # commands

    @with_alternative
    def settle(self, offer: Offer) -> CommandRecord:
        interruption, shown = self.found, self.view()
        if interruption is None or shown is None:
            raise RefusedError("no flight was cut off, or all of it is settled")
        if offer not in shown.offers:
            raise RefusedError(f"{offer} is not offered: {shown.notice}")
        self.plans.restore(interruption, offer)
        unreceived = self.unreceived
        waiting = {name for name, left in shown.vehicles.items() if left.waits}
        waiting -= {vehicle.id for vehicle in unreceived}
        refused = {
            name: why
            for name in waiting
            if (vehicle := self.vehicles[name]).phase is Phase.PILOT and (why := self.why_not(vehicle))
        }
        waiting -= refused.keys()
        if offer is Offer.BRING_HOME:
            return self.send_home(f"brought home: {shown.cause}")
        chosen = [vehicle for name, vehicle in self.vehicles.items() if name in waiting]
        meant = [vehicle.id for vehicle in (*chosen, *unreceived)]
        left_out = {name: left.text for name, left in shown.vehicles.items() if name not in meant} | refused
        record = self.book.open(offer.value, meant, left_out)
        if self._batch is not None:  # not all of its vehicles hold yet
            for vehicle in self._batch.handed:
                self._end_part(self._batch, vehicle, Outcome.FAILED, REPLACED)
        batch = _Batch([record], set(meant))
        self._batch = batch
        take_one, note = partial(self._take_one, batch), partial(self._note, batch)
        self.awaited.expect(unreceived, take_one, note, reaches_fallen=False)
        for vehicle in chosen:
            if vehicle.phase is Phase.PILOT:
                self._take_one(batch, vehicle)
            else:
                self._note(batch, vehicle, Outcome.DONE, "")
        return record

    def _take_one(self, batch: _Batch, vehicle: Vehicle) -> None:
        self.maneuvers.start(vehicle, self.maneuvers.take_control, partial(self._note, batch, vehicle))

    def _end_part(self, batch: _Batch, vehicle: Vehicle, outcome: Outcome, reason: str) -> None:
        for record in batch.records:
            if vehicle.id in record.outcomes:
                self.book.close(record.id, vehicle.id, outcome, reason)

    @property
    def taking_over(self) -> list[Vehicle]:
        """Vehicles of a take-over that it has not sent on yet."""
        if self._batch is None:
            return []
        handed = {vehicle.id for vehicle in self._batch.handed}
        return [vehicle for vehicle in self.vehicles.values() if vehicle.id in self._batch.awaited | handed]

    def go_along(self, record: CommandRecord) -> None:
        """Close the parts of `record` together with those of the running take-over."""
        if self._batch is not None:
            self._batch.records.append(record)

    def _note(self, batch: _Batch, vehicle: Vehicle, outcome: Outcome, reason: str) -> None:
        batch.awaited.discard(vehicle.id)
        if outcome is Outcome.DONE:
            batch.handed.append(vehicle)
        else:
            self._end_part(batch, vehicle, outcome, reason)

    def _go_on(self, batch: _Batch) -> None:
        """Send all vehicles of a batch on together once they hold; a newer command counts."""
        holding = [held for held in batch.handed if held.phase is Phase.HOLD]
        comes_down = self.show.phase in COMES_DOWN
        ours = [held for held in holding if not (comes_down or self.maneuvers.running(held))]
        for vehicle in batch.handed:
            if vehicle not in ours:
                changed = f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}"
                reason = REPLACED if vehicle.phase is Phase.HOLD else changed
                self._end_part(batch, vehicle, Outcome.FAILED, reason)
        self._sent_on |= {vehicle.id for vehicle in ours}
        for vehicle in ours:
            if self._rejoins(vehicle):
                self.maneuvers.start(vehicle, self.maneuvers.join, partial(self._end_part, batch, vehicle))
            else:
                self._end_part(batch, vehicle, Outcome.DONE, "holds, as before")

    def _rejoins(self, vehicle: Vehicle) -> bool:
        interruption = self.found
        before = None if interruption is None else interruption.vehicles.get(vehicle.id)
        if interruption is None or before is None or vehicle.phase is not Phase.HOLD:
            return False
        on_its_way = before.phase is Phase.HOLD and interruption.show is ShowPhase.ARMING
        return on_its_way or before.phase in {Phase.FORMATION, Phase.TAKEOFF, Phase.LOST}
