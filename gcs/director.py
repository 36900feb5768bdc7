"""What is done with the fleet on an order, and what follows by itself."""

import asyncio
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.control import ellipses_of
from gcs.errand_tasks import Errand
from gcs.errands import Errands
from gcs.errors import InvalidError, OrderError, RefusedError, UnknownError
from gcs.feasibility import check_formation, check_obstacle
from gcs.flight import Flight
from gcs.foresight import check_setpoint_loss
from gcs.homecoming import Homecoming
from gcs.inspection import Inspection
from gcs.landing import distinct_places_m
from gcs.lifecycle import (
    AIRBORNE,
    FLOWN,
    IN_THE_AIR,
    ON_THE_GROUND,
    Event,
    Phase,
    ShowEvent,
    ShowPhase,
    advance_show,
)
from gcs.links import Order, Verb
from gcs.orders import OrderBook
from gcs.preflight import check_fleet, told
from gcs.service import OrderRecord, Outcome, ShowAction, VehicleAction
from gcs.stage import Stage
from gcs.state import Array, VehicleId
from gcs.vehicle import Vehicle, require_phase
from gcs.watch import Watch

log = logging.getLogger(__name__)

STOPS_WITHIN_S = 0.8
"""On pause, everybody's place is where their velocity takes them in this time."""

EVENT_OF = {
    VehicleAction.HOLD: Event.HOLD,
    VehicleAction.JOIN: Event.ENGAGE,
    VehicleAction.RETURN: Event.COME_HOME,
    VehicleAction.LAND: Event.DESCEND,
    VehicleAction.KILL: Event.KILL,
    VehicleAction.HAND_BACK: Event.HANDED_BACK,
    VehicleAction.CONFIRM_DOWN: Event.CONFIRMED_DOWN,
}

AHEAD_MAX_S = 24 * 3600.0
"""Nobody schedules a start for another day."""

LATE_MAX_S = 2.0
"""A start that this machine missed by more (asleep, or its clock was set) is not made up for."""


@dataclass(frozen=True, slots=True)
class Countdown:
    """A start that is ordered for a clock time."""

    at_unix_s: float
    record: OrderRecord
    chosen: tuple[VehicleId, ...]
    show_hash: str | None


class Director:
    """Turns orders into errands, and lets the show go on by itself where it can."""

    def __init__(
        self,
        flight: Flight,
        errands: Errands,
        book: OrderBook,
        inspection: Inspection,
        stage: Stage,
        unix_s: Callable[[], float],
    ) -> None:
        self._flight = flight
        self._errands = errands
        self._book = book
        self._inspection = inspection
        self._stage = stage
        self._unix_s = unix_s
        self.countdown: Countdown | None = None
        self._homecoming: Homecoming | None = None
        self._watch = Watch(flight, errands, inspection, self._come_back)
        self._came_down_by: ShowPhase | None = None  # how the last show ended, where that was ordered

    # once a tick

    def watch(self) -> None:
        """Let the telemetry change phases, and end errands that no longer apply."""
        self._watch.look()

    async def _come_back(self, vehicle: Vehicle) -> None:
        """From LOST through HOLD; and on, where everybody was ordered home or down meanwhile.

        That order stands for who was lost, also when all the others are down and the show is over.
        """
        await self._errands.hold(vehicle)
        if self._flight.show is ShowPhase.LANDED and self._came_down_by is not None:
            reason = f"{vehicle.id}, which was lost, is back, and comes down as was ordered"
            self._move_show(ShowEvent.TAKEN_ON, reason)
            goes_on = ShowEvent.STOP if self._came_down_by is ShowPhase.RETURNING else ShowEvent.ABORT
            self._move_show(goes_on, reason)
        show = self._flight.show
        if show is ShowPhase.RETURNING and vehicle.home_m is not None:
            await self._errands.come_home(vehicle)
        elif show in {ShowPhase.RETURNING, ShowPhase.ABORTING}:
            await self._errands.descend(self._places_m([vehicle])[vehicle.id])(vehicle)

    def advance(self) -> None:
        """Let the show go on: all up, assembled, all down."""
        flight = self._flight
        if self.countdown is not None:
            self._count_down(self.countdown)
        if self._homecoming is not None:
            self._homecoming.advance()
        busy = [vehicle for vehicle in (*flight.airborne, *self.waiting) if self._errands.running(vehicle)]
        if flight.show in ON_THE_GROUND and flight.airborne:
            names = ", ".join(vehicle.id for vehicle in flight.airborne)
            self._move_show(ShowEvent.TAKEN_ON, f"in the air and ours, waiting for orders: {names}")
        if flight.show is ShowPhase.ARMING:
            # who comes down again does not keep the others waiting
            if all(vehicle.phase in {Phase.RETURN, Phase.LANDING} for vehicle in busy):
                self._all_have_taken_off()
        elif flight.show is ShowPhase.ASSEMBLING and flight.assembled():
            self._move_show(ShowEvent.ASSEMBLED, "the sphere stands")
        elif flight.performance is not None and flight.performance.is_over(flight.fleet.time_s):
            self._stop(f"show {flight.performance.name!r} is over: everybody comes home")
        flying = flight.show in IN_THE_AIR | {ShowPhase.ABORTING} and flight.show is not ShowPhase.ARMING
        if flying and not busy and not flight.airborne:
            was_ordered = flight.show in {ShowPhase.RETURNING, ShowPhase.ABORTING}
            self._came_down_by = flight.show if was_ordered else None
            others = [vehicle.id for vehicle in flight.in_phase(Phase.LOST, Phase.PILOT)]
            named = f"; not ours to land: {', '.join(others)}" if others else ""
            self._move_show(ShowEvent.ALL_DOWN, f"everybody we answer for is down{named}")

    def _all_have_taken_off(self) -> None:
        """Go on with those who are up, if there are any."""
        flight = self._flight
        holding = ", ".join(f"{vehicle.id} ({vehicle.reason})" for vehicle in flight.in_phase(Phase.HOLD))
        if flight.in_phase(Phase.FORMATION):
            self._move_show(ShowEvent.ALL_UP, "everybody who flies is up")
        elif holding:
            self._move_show(ShowEvent.TAKEN_ON, f"nobody flies in formation; waiting for orders: {holding}")
        elif not flight.airborne:
            self._move_show(ShowEvent.ALL_DOWN, "nobody took off")

    def _move_show(self, event: ShowEvent, reason: str) -> None:
        flight = self._flight
        before, flight.show = flight.show, advance_show(flight.show, event)
        flight.reason = reason
        if flight.performance is not None:
            flight.performance.follow(flight.show, flight.fleet.time_s)
        log.info("show_phase", extra={"was": before.value, "phase": flight.show.value, "reason": reason})

    # orders to the show

    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> OrderRecord:
        """Carry out an order to the whole show. Raises: RefusedError, UnknownError, InvalidError."""
        given = {"vehicles": vehicles, "show_hash": show_hash, "at_unix_time_s": at_unix_time_s}
        for field, value in given.items():
            if value is not None and action is not ShowAction.START:
                raise InvalidError(field, value, "only with start")
        orders = {
            ShowAction.STOP: self._stop,
            ShowAction.PAUSE: self._pause,
            ShowAction.RESUME: self._resume,
            ShowAction.ABORT: self._abort,
        }
        if action is ShowAction.START:
            return self._start(vehicles, show_hash, at_unix_time_s)
        if self.countdown is not None and action in {ShowAction.STOP, ShowAction.ABORT}:
            return self._call_off(action)
        return orders[action]()

    def _start(
        self, wanted: Sequence[VehicleId] | None, show_hash: str | None, at_unix_s: float | None
    ) -> OrderRecord:
        """Take off now, or at a clock time: everything is checked now, and then once more."""
        event = ShowEvent.START if at_unix_s is None else ShowEvent.SCHEDULE
        advance_show(self._flight.show, event)
        if at_unix_s is not None:
            ahead_s = at_unix_s - self._unix_s()
            if not 0.0 < ahead_s <= AHEAD_MAX_S:
                allowed = f"ahead by at most {AHEAD_MAX_S / 3600.0:g} h; it is {self._unix_s():.1f} now"
                raise InvalidError("at_unix_time_s", at_unix_s, allowed)
        chosen, left_out = self._choose(wanted)
        self._stage.check_start(chosen, show_hash, named=wanted is not None)
        self._ready(chosen)
        if at_unix_s is not None:
            record = self._book.open("start", chosen, left_out)
            self.countdown = Countdown(at_unix_s, record, tuple(chosen), show_hash)
            self._move_show(ShowEvent.SCHEDULE, f"{len(chosen)} vehicles take off in {ahead_s:.0f} s")
            return record
        if self.countdown is not None:
            self._end_countdown(self.countdown, "started before its time, by another order")
        record = self._book.open("start", chosen, left_out)
        self._take_off(record, chosen)
        return record

    def _ready(self, chosen: Sequence[VehicleId]) -> None:
        """Raises: RefusedError, InvalidError when anything speaks against these taking off now."""
        flight = self._flight
        self._check(chosen)
        check_formation(flight.plan.formation, len(chosen), flight.control.safety)
        self._check_loss(chosen)
        pads_m = {name: flight.position_m(flight.vehicles[name]) for name in chosen}
        for obstacle in self._stage.obstacles():
            check_obstacle(obstacle, flight.control.law.avoidance, {}, pads_m)

    def _take_off(self, record: OrderRecord, chosen: Sequence[VehicleId]) -> None:
        flight = self._flight
        self._came_down_by = None
        self._stage.begin(chosen)
        self._move_show(ShowEvent.START, "checks every vehicle")
        self._move_show(ShowEvent.CHECKED, f"{len(chosen)} vehicles take off one after the other")
        for turn, name in enumerate(chosen):
            vehicle = flight.vehicles[name]
            vehicle.home_m = flight.position_m(vehicle).copy()
            delay_s = turn * flight.config.operation.takeoff_stagger_s
            errand = self._errands.take_off(delay_s, lambda one: self._check([one.id]))
            self._errands.start(vehicle, errand, self._closer(record, vehicle))

    def _count_down(self, countdown: Countdown) -> None:
        """Take off when it is time, if everybody still may; else say why not."""
        late_s = self._unix_s() - countdown.at_unix_s
        if late_s < 0.0 and not self._flight.airborne:
            return
        try:
            self._still_ready(countdown, late_s)
        except (RefusedError, InvalidError, UnknownError) as error:
            self._end_countdown(countdown, str(error))
            self._move_show(ShowEvent.CHECK_FAILED, f"did not start: {error}")
            return
        self.countdown = None
        self._take_off(countdown.record, countdown.chosen)

    def _still_ready(self, countdown: Countdown, late_s: float) -> None:
        """Raises: RefusedError, InvalidError, UnknownError when they may not take off any more."""
        if self._flight.airborne:
            raise RefusedError("a vehicle is in the air already")
        if late_s > LATE_MAX_S:
            raise RefusedError(f"its time was missed by {late_s:.1f} s: this machine, or its clock, stood")
        self._choose(countdown.chosen)
        self._stage.check_start(countdown.chosen, countdown.show_hash, named=True)
        self._ready(countdown.chosen)

    def _end_countdown(self, countdown: Countdown, reason: str) -> None:
        self.countdown = None
        for name in countdown.chosen:
            self._book.close(countdown.record.id, name, Outcome.FAILED, reason)

    def _call_off(self, action: ShowAction) -> OrderRecord:
        """Nobody has left the ground, and nobody will."""
        if self.countdown is not None:
            self._end_countdown(self.countdown, "called off")
        self._move_show(ShowEvent(action.value), "the countdown was called off")
        return self._book.open(action, [], {})

    def _check(self, chosen: Sequence[VehicleId]) -> None:
        """Raises: RefusedError with everything that speaks against their taking off."""
        flight = self._flight
        operation = flight.config.operation
        findings = check_fleet(
            chosen,
            flight.fleet,
            flight.telemetry,
            {name: text for link in flight.links for name, text in link.conflicts.items()},
            age_max_s=flight.control.telemetry_age_max_s,
            floor=flight.control.safety.floor,
            fence=flight.control.safety.fence,
            uncertainty_m=flight.traits.uncertainty_m,
            positioning=flight.config.positioning,
            pads_within_m=operation.pads_within_m if operation.require_parameters else np.inf,
        )
        if operation.require_parameters:
            findings += self._inspection.findings(chosen)
        if findings:
            raise RefusedError(told(findings))

    def _check_loss(self, chosen: Sequence[VehicleId]) -> None:
        """Raises: RefusedError when losing everybody at once would bring some of them together."""
        flight, operation = self._flight, self._flight.config.operation
        if not operation.require_safe_setpoint_loss:
            return
        rows = [flight.vehicles[name].row for name in chosen]
        check_setpoint_loss(
            tuple(chosen),
            flight.fleet.position_m[rows],
            self._stage.plans(),
            flight.control,
            flight.traits.uncertainty_m[rows],
            operation.setpoint_loss_action,
            operation.return_height_m,
        )

    def _choose(self, wanted: Sequence[VehicleId] | None) -> tuple[list[VehicleId], dict[VehicleId, str]]:
        """Who flies, and why the others do not. Raises: UnknownError, RefusedError."""
        flight = self._flight
        for name in wanted or ():
            self.vehicle(name)
        left_out: dict[VehicleId, str] = {}
        chosen: list[VehicleId] = []
        for name, vehicle in flight.vehicles.items():
            if wanted is not None and name not in wanted:
                left_out[name] = "not chosen"
            elif vehicle.phase is Phase.STANDBY:
                chosen.append(name)
            elif wanted is None and vehicle.phase is Phase.OFFLINE:
                left_out[name] = f"offline: {vehicle.reason}"
            else:
                raise RefusedError(f"{name} is {vehicle.phase}: {vehicle.reason}; only standby can start")
        if not chosen:
            raise RefusedError("no vehicle is online")
        return chosen, left_out

    def _stop(self, reason: str = "everybody comes home") -> OrderRecord:
        """Everybody home; who has not left the ground stays there."""
        flying, waiting = self._flight.airborne, self.waiting
        self._move_show(ShowEvent.STOP, reason)
        record = self._book.open("stop", [v.id for v in (*flying, *waiting)], self._not_ours())
        homeless_m = self._places_m([vehicle for vehicle in flying if vehicle.home_m is None])
        together = [v for v in flying if v.home_m is not None and not v.comes_down_alone]
        self._homecoming = Homecoming(self._flight, together, asyncio.get_running_loop().time)
        for vehicle in flying:
            place_m = homeless_m.get(vehicle.id)  # its start is not known: down where it is
            errand = (
                self._errands.come_home_together(self._homecoming, self._stops_m(vehicle))
                if place_m is None
                else self._errands.descend(place_m)
            )
            self._errands.start(vehicle, errand, self._closer(record, vehicle))
        for vehicle in waiting:
            self._errands.start(vehicle, self._errands.stay_down, self._closer(record, vehicle))
        return record

    def _not_ours(self) -> dict[VehicleId, str]:
        """Vehicles that no collective order reaches, and why."""
        out_of_hand = self._flight.in_phase(Phase.LOST, Phase.PILOT, Phase.KILLED)
        return {vehicle.id: f"{vehicle.phase}: {vehicle.reason}" for vehicle in out_of_hand}

    def _pause(self) -> OrderRecord:
        """Everybody of the formation stops in place."""
        flight = self._flight
        advance_show(flight.show, ShowEvent.PAUSE)
        for vehicle in flight.in_phase(Phase.FORMATION):
            vehicle.hold_m = self._stops_m(vehicle)
        self._move_show(ShowEvent.PAUSE, "everybody holds in place")
        return self._done("pause")

    def _stops_m(self, vehicle: Vehicle) -> Array:
        """(3,) where it can stand soon."""
        place_m: Array = (
            self._flight.position_m(vehicle) + self._flight.fleet.velocity_m_s[vehicle.row] * STOPS_WITHIN_S
        )
        return place_m

    def _resume(self) -> OrderRecord:
        performance = self._flight.performance
        if performance is not None and not performance.started:
            raise RefusedError(f"show {performance.name!r} was never started: stop brings home who is up")
        self._move_show(ShowEvent.RESUME, "re-forms, then goes on")
        return self._done("resume")

    def _done(self, action: str) -> OrderRecord:
        """An order that the next tick carries out for all of the formation."""
        formed = self._flight.in_phase(Phase.FORMATION)
        record = self._book.open(action, [vehicle.id for vehicle in formed], {})
        for vehicle in formed:
            self._book.close(record.id, vehicle.id, Outcome.DONE)
        return self._book.get(record.id)

    def _abort(self) -> OrderRecord:
        """A filtered descent of everybody, lowest first, to distinct places."""
        flying, waiting = self._flight.airborne, self.waiting
        self._move_show(ShowEvent.ABORT, "everybody comes down")
        places_m = self._places_m([vehicle for vehicle in flying if not vehicle.comes_down_alone])
        record = self._book.open("abort", [v.id for v in (*flying, *waiting)], self._not_ours())
        for vehicle in flying:
            alone = vehicle.comes_down_alone
            errand = self._errands.autopilot_land if alone else self._errands.descend(places_m[vehicle.id])
            self._errands.start(vehicle, errand, self._closer(record, vehicle))
        for vehicle in waiting:
            self._errands.start(vehicle, self._errands.stay_down, self._closer(record, vehicle))
        return record

    @property
    def waiting(self) -> list[Vehicle]:
        """On the ground, but about to take off."""
        on_ground = self._flight.in_phase(Phase.STANDBY) if self._flight.show is ShowPhase.ARMING else []
        return [vehicle for vehicle in on_ground if self._errands.running(vehicle)]

    def _places_m(self, vehicles: Sequence[Vehicle]) -> dict[VehicleId, Array]:
        """(3,) for each: where it comes down, clear of obstacles, of everybody's pads, and of the others."""
        flight = self._flight
        if not vehicles:
            return {}
        wanted_m = np.array([flight.position_m(vehicle)[:2] for vehicle in vehicles])
        coming_down = {vehicle.id for vehicle in vehicles}
        taken_m = [
            place_m[:2]
            for vehicle in flight.vehicles.values()
            if vehicle.id not in coming_down
            for place_m in (
                vehicle.home_m,
                vehicle.last_m if vehicle.phase not in AIRBORNE or vehicle.handed_over else None,
                vehicle.goal_m if vehicle.phase is Phase.LANDING else None,
            )
            if place_m is not None
        ]
        places_m = distinct_places_m(
            wanted_m,
            np.array(taken_m).reshape(-1, 2),
            flight.config.operation.place_spacing_m,
            ellipses_of(flight.plan, flight.control, flight.fleet.time_s),
        )
        ground_z_m = [0.0 if v.home_m is None else float(v.home_m[2]) for v in vehicles]
        return {
            vehicle.id: np.array([place_m[0], place_m[1], z_m])
            for vehicle, place_m, z_m in zip(vehicles, places_m, ground_z_m, strict=True)
        }

    # orders to one vehicle

    def vehicle(self, vehicle_id: VehicleId) -> Vehicle:
        """Raises: UnknownError."""
        try:
            return self._flight.vehicles[vehicle_id]
        except KeyError:
            known = ", ".join(self._flight.vehicles)
            raise UnknownError(f"there is no vehicle {vehicle_id}; there are {known}") from None

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> OrderRecord:
        """Carry out an order to one vehicle. Raises: RefusedError, UnknownError."""
        vehicle = self.vehicle(vehicle_id)
        if not (action is VehicleAction.HOLD and vehicle.phase is Phase.HOLD):
            require_phase(vehicle, EVENT_OF[action])
        if action is VehicleAction.HOLD and vehicle.pilots:
            raise RefusedError(
                f"{vehicle_id} was taken over before it fell silent: hand-back, once it is heard"
            )
        if action is VehicleAction.KILL:
            return self._kill(vehicle)
        if action is VehicleAction.CONFIRM_DOWN:
            vehicle.apply(Event.CONFIRMED_DOWN, "an operator has seen it on the ground")
            vehicle.last_m = None
            record = self._book.open(action, [vehicle.id], {})
            self._book.close(record.id, vehicle.id, Outcome.DONE)
            return self._book.get(record.id)
        if action is VehicleAction.JOIN and self._flight.show not in IN_THE_AIR - {ShowPhase.RETURNING}:
            raise RefusedError(f"{vehicle_id} has no formation to join: the show is {self._flight.show}")
        if action is VehicleAction.JOIN:
            self._check_room(vehicle)
        if action is VehicleAction.RETURN and vehicle.home_m is None:
            raise RefusedError(f"{vehicle_id} cannot return: where it started is not known; use land")
        if action is VehicleAction.RETURN and vehicle.handed_over:
            raise RefusedError(f"{vehicle_id} cannot return: its autopilot touches it down already")
        errands: dict[VehicleAction, Errand] = {
            VehicleAction.HOLD: self._errands.hold,
            VehicleAction.JOIN: self._errands.join,
            VehicleAction.RETURN: self._errands.come_home,
            VehicleAction.HAND_BACK: self._errands.hand_back,
        }
        if action is VehicleAction.LAND:
            return self._send([vehicle], self._errands.descend(self._places_m([vehicle])[vehicle.id]), action)
        return self._send([vehicle], errands[action], action)

    def _check_room(self, vehicle: Vehicle) -> None:
        """Raises: RefusedError when the sphere is too small for one more."""
        flight = self._flight
        others = [other for other in flight.airborne if other is not vehicle]
        formed = [other for other in others if other.engaging or other.phase is Phase.FORMATION]
        try:
            check_formation(flight.plan.formation, len(formed) + 1, flight.control.safety)
        except InvalidError as error:
            raise RefusedError(f"{vehicle.id} cannot join: {error}") from None

    def _kill(self, vehicle: Vehicle) -> OrderRecord:
        """Motors off. The phase changes at once: nothing else is sent from here on."""
        flown = vehicle.phase in FLOWN
        vehicle.apply(Event.KILL, "motors stopped on order")
        log.warning("kill", extra={"vehicle": vehicle.id, "was_flown": flown})

        async def errand(killed: Vehicle) -> None:
            try:
                await self._flight.execute(Order(killed.id, Verb.KILL))
            except OrderError as error:
                raise RefusedError(f"the kill was sent, but not seen to work: {error}") from None

        return self._send([vehicle], errand, "kill")

    # both

    def _send(
        self,
        vehicles: Iterable[Vehicle],
        errand: Errand,
        action: str,
        left_out: Mapping[str, str] | None = None,
    ) -> OrderRecord:
        """Send vehicles on the same errand, under one order."""
        chosen = list(vehicles)
        record = self._book.open(action, [vehicle.id for vehicle in chosen], left_out or {})
        for vehicle in chosen:
            self._errands.start(vehicle, errand, self._closer(record, vehicle))
        return record

    def _closer(self, record: OrderRecord, vehicle: Vehicle) -> Callable[[Outcome, str], None]:
        return lambda outcome, reason: self._book.close(record.id, vehicle.id, outcome, reason)
