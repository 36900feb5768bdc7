"""A flight that was cut off: its pads are known again, and its vehicles are taken on when that is ordered."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from gcs.errands import Errands
from gcs.errors import GcsError, RefusedError
from gcs.feasibility import check_formation, check_orbit, check_target, followed
from gcs.flight import Flight
from gcs.interrupted import (
    TAKEN_OVER_FROM,
    Before,
    Interrupted,
    Interruption,
    Offer,
    Remaining,
    mismatches,
    remaining,
)
from gcs.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.orders import OrderBook
from gcs.plan import Plan
from gcs.records.plans import plan_of
from gcs.service import OrderRecord, Outcome
from gcs.stage import Stage
from gcs.state import VehicleId
from gcs.vehicle import Vehicle

log = logging.getLogger(__name__)

BEGUN_ANEW = frozenset({ShowPhase.PREFLIGHT, ShowPhase.ARMING})
"""Whoever starts a show has settled what was before."""


@dataclass(slots=True, eq=False)
class _Batch:
    """Vehicles that are handed back together, for an order."""

    record: OrderRecord
    offer: Offer
    awaited: set[VehicleId]
    handed: list[Vehicle] = field(default_factory=list)


class Takeover:
    """Knows what was cut off until everybody is accounted for. Changed only on the event loop."""

    def __init__(
        self,
        flight: Flight,
        errands: Errands,
        book: OrderBook,
        stage: Stage,
        found: Interruption | None,
        send_home: Callable[[OrderRecord, Sequence[Vehicle]], None],
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
        self._no_plan = ""  # why the formation cannot go on
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
            if found.written is not None:
                self._stage.find(found.written.name, found.written.hash)
            else:
                self._plan(found)
        except GcsError as error:
            return f"take-over is not offered: {error}"
        return ""

    # once a tick

    def advance(self) -> None:
        """Go on with a batch that holds; forget what is settled."""
        found, batch = self._found, self._batch
        if batch is not None and not batch.awaited:
            self._batch = None
            self._go_on(batch)
        if found is None:
            return
        if self._flight.show in BEGUN_ANEW or (found.vehicles and self._all_settled(found)):
            log.info("interruption_over", extra={"of_session": found.session})
            self._found = None

    def _all_settled(self, found: Interruption) -> bool:
        """Nobody is unheard or waits for an order, and nobody who was handed back is yet to be sent on."""
        if self._batch is not None:
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
        )

    def _remaining(self, name: VehicleId, before: Before) -> Remaining:
        vehicle = self._flight.vehicles.get(name)
        if vehicle is None:
            return Remaining(name, before.phase, before.pad_m is not None, waits=False, text="not configured")
        mode, action = self._flight.mode(vehicle), self._flight.config.operation.setpoint_loss_action
        return remaining(name, before, vehicle.phase, mode, action)

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
        chosen = [vehicle for name, vehicle in self._flight.vehicles.items() if name in waiting]
        if offer is Offer.BRING_HOME:
            chosen += [vehicle for vehicle in self._flight.airborne if vehicle.id not in waiting]
        left_out = {one.id: one.text for one in shown.vehicles if one.id not in {each.id for each in chosen}}
        record = self._book.open(offer.value, [vehicle.id for vehicle in chosen], left_out)
        batch = _Batch(record, offer, {vehicle.id for vehicle in chosen})
        self._batch = batch
        for vehicle in chosen:
            if vehicle.phase is Phase.PILOT:
                done = partial(self._note, batch, vehicle)
                self._errands.start(vehicle, self._errands.take_control, done)
            else:
                self._note(batch, vehicle, Outcome.DONE, "")
        return record

    def _note(self, batch: _Batch, vehicle: Vehicle, outcome: Outcome, reason: str) -> None:
        """One of a batch holds, or could not be had."""
        batch.awaited.discard(vehicle.id)
        if outcome is Outcome.DONE:
            batch.handed.append(vehicle)
        else:
            self._book.close(batch.record.id, vehicle.id, outcome, reason)

    def _go_on(self, batch: _Batch) -> None:
        """All of a batch hold: send them on, together."""
        ours = [vehicle for vehicle in batch.handed if vehicle.phase in AIRBORNE]
        for vehicle in batch.handed:
            if vehicle not in ours:
                reason = f"{vehicle.id} is {vehicle.phase} now: {vehicle.reason}"
                self._book.close(batch.record.id, vehicle.id, Outcome.FAILED, reason)
        self._sent_on |= {vehicle.id for vehicle in ours}
        if batch.offer is Offer.BRING_HOME:
            if ours:
                self._send_home(batch.record, ours)
            return
        for vehicle in ours:
            if self._rejoins(vehicle):
                closer = self._book.closer(batch.record, vehicle.id)
                self._errands.start(vehicle, self._errands.join, closer)
            else:
                self._book.close(batch.record.id, vehicle.id, Outcome.DONE, "holds, as before")

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
