"""A start, now or at a clock time: what speaks against it, and who takes off when."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.columns import column_m, most_overlapping
from gcs.columns import told as told_columns
from gcs.errands import Errands
from gcs.errors import InvalidError, RefusedError, UnknownError
from gcs.feasibility import check_formation, check_obstacle
from gcs.flight import Flight
from gcs.foresight import PREDICTED_MAX, check_setpoint_loss, formation_m
from gcs.inspection import Inspection
from gcs.lifecycle import Phase, ShowEvent, advance_show
from gcs.orders import OrderBook
from gcs.preflight import check_fleet, told
from gcs.service import OrderRecord, Outcome, ShowAction
from gcs.stage import Stage
from gcs.state import VehicleId

log = logging.getLogger(__name__)

AHEAD_MAX_S = 24 * 3600.0
"""Nobody schedules a start for another day."""

SWAYS_M = 0.5
"""By which two vehicles may be nearer to each other than their places."""

LATE_MAX_S = 2.0
"""A start that this machine missed by more (asleep, or its clock was set) is not made up for."""


@dataclass(frozen=True, slots=True)
class Countdown:
    """A start that is ordered for a clock time."""

    at_unix_s: float
    record: OrderRecord
    chosen: tuple[VehicleId, ...]
    show_hash: str | None


class Starting:
    """Carries out orders to start, and counts down to those that are for later."""

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

    def order(
        self, wanted: Sequence[VehicleId] | None, show_hash: str | None, at_unix_s: float | None
    ) -> OrderRecord:
        """Take off now, or at a clock time: everything is checked now, and then once more.

        Raises: RefusedError, UnknownError, InvalidError.
        """
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
            self._flight.move_show(ShowEvent.SCHEDULE, f"{len(chosen)} vehicles take off in {ahead_s:.0f} s")
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
        self._look_at_columns(chosen)
        pads_m = {name: flight.position_m(flight.vehicles[name]) for name in chosen}
        for obstacle in self._stage.obstacles():
            check_obstacle(obstacle, flight.control.law.avoidance, {}, pads_m)

    def _look_at_columns(self, chosen: Sequence[VehicleId]) -> None:
        """Say how many will stand above others, as far as that can be known."""
        flight = self._flight
        home_m = np.array([flight.position_m(flight.vehicles[name]) for name in chosen])
        width_m = column_m(flight.control.safety.floor)
        plan = min((plan for _, plan in self._stage.plans()), key=lambda each: each.formation.radius_m)
        words = ""
        if len(chosen) <= PREDICTED_MAX:
            formed_m = formation_m(tuple(chosen), home_m, plan, flight.control)
            words = told_columns(most_overlapping(formed_m, width_m + SWAYS_M))
        if words and words != flight.columns:
            log.info("columns_overlap", extra={"reason": words})
        flight.columns = words

    def _take_off(self, record: OrderRecord, chosen: Sequence[VehicleId]) -> None:
        flight = self._flight
        self._stage.begin(chosen)
        flight.move_show(ShowEvent.START, "checks every vehicle")
        flight.move_show(ShowEvent.CHECKED, f"{len(chosen)} vehicles take off one after the other")
        for turn, name in enumerate(chosen):
            vehicle = flight.vehicles[name]
            vehicle.home_m = flight.position_m(vehicle).copy()
            delay_s = turn * flight.config.operation.takeoff_stagger_s
            errand = self._errands.take_off(delay_s, lambda one: self._check([one.id]))
            self._errands.start(vehicle, errand, self._book.closer(record, vehicle.id))

    def count_down(self) -> None:
        """Once a tick: take off when it is time, if everybody still may; else say why not."""
        countdown = self.countdown
        if countdown is None:
            return
        late_s = self._unix_s() - countdown.at_unix_s
        if late_s < 0.0 and not self._flight.airborne:
            return
        try:
            self._still_ready(countdown, late_s)
        except (RefusedError, InvalidError, UnknownError) as error:
            self._end_countdown(countdown, str(error))
            self._flight.move_show(ShowEvent.CHECK_FAILED, f"did not start: {error}")
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

    def call_off(self, action: ShowAction) -> OrderRecord:
        """Nobody has left the ground, and nobody will."""
        if self.countdown is not None:
            self._end_countdown(self.countdown, "called off")
        self._flight.move_show(ShowEvent(action.value), "the countdown was called off")
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
            flight.vehicle(name)
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
