"""The collective return: all vehicles stop, paths are planned beside the flight, all fly home together."""

import logging
from collections.abc import Iterable
from concurrent.futures import Executor, Future

import numpy as np

from gcs.flight.fleet import Fleet
from gcs.flight.landing_places import homes_m
from gcs.flight.vehicle import Vehicle
from gcs.model.errors import ShapeError, cut
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.return_paths.paths import PathProgress, ReturnPaths
from gcs.planning.return_paths.planner import Planner, plan_return_paths, return_planner

log = logging.getLogger(__name__)

STANDS_M_S = 0.4
STOPPED_WITHIN_S = 5.0
"""A vehicle that has not stopped or is not under control by then returns without a planned path."""

PLANNED_WITHIN_S = 10.0
"""The best plan at that time is flown; the first is always completed. 50 vehicles take less than a second."""

TOGETHER_MAX = 1000
"""Larger fleets return without planned paths: their first plan would take too long."""

FLYING = frozenset({Phase.FORMATION, Phase.HOLD, Phase.RETURN})


class CollectiveReturn:
    """One collective return. Changed on the event loop only."""

    def __init__(self, flight: Fleet, vehicles: Iterable[Vehicle], planning: Executor) -> None:
        """`vehicles` know where they started. The planner runs in `planning`, outside the tick."""
        self._flight = flight
        self._planning = planning
        self._expected = {vehicle.id: vehicle for vehicle in vehicles}
        self._stopping: dict[VehicleId, Vehicle] = {}
        self._rows: dict[VehicleId, int] = {}
        self._places: list[int] = []  # rows of FleetState, in the plan's order
        self._home_m = np.zeros((0, 3))  # (n, 3) landing positions, in the same order
        self._is_off = False  # no plan: the vehicles return one by one
        self.problem = ""  # why the planner failed and what follows
        self._planner: Planner | None = None
        self._planned: Future[ReturnPaths] | None = None
        self._enough = False  # read by the planning thread
        self._progress: PathProgress | None = None
        self._led: set[VehicleId] = set()  # vehicles that took their goal since the last tick
        self._since_s = flight.fleet.time_s  # time of the command, the planning, or the last tick

    @property
    def is_planned(self) -> bool:
        return self._progress is not None

    @property
    def left_s(self) -> float | None:
        """Planned time until the last vehicle has landed, in s, without delays; None: no plan yet."""
        if self._progress is None:
            return None
        return max(float(self._progress.return_paths.down_s.max()) - self._progress.time_s, 0.0)

    def give_up(self) -> None:
        self._enough = True
        if self._planner is not None:
            self._planner.halt()

    def stopping(self, vehicle: Vehicle) -> None:
        self._stopping[vehicle.id] = vehicle

    def takes_part(self, vehicle: Vehicle) -> bool:
        """Whether the vehicle is in the plan, or still may be."""
        if self._is_off:
            return False
        return vehicle.id in (self._expected if self._planned is None else self._rows)

    def advance(self) -> None:
        now_s = self._flight.fleet.time_s
        since_s = now_s - self._since_s
        if self._progress is not None:
            self._since_s = now_s
            self._progress.advance(since_s, self._flight.fleet.position_m[self._places], self._flown())
        elif self._is_off:
            return
        elif self._planned is None:
            if self._all_stand() or since_s > STOPPED_WITHIN_S:
                self._since_s = now_s
                self._begin()
        elif self._planned.done():
            self._since_s = now_s
            error = self._planned.exception()
            if error is None:
                self._progress = PathProgress(self._planned.result(), self._home_m)
            else:
                self._fail(error)
        elif since_s > PLANNED_WITHIN_S:
            self.give_up()

    def _fail(self, error: BaseException) -> None:
        """Log any error of the planner, and show it as an alarm: the fleet returns without a plan."""
        self._is_off = True
        detail = f": {cut(str(error))}" if str(error) else ""
        self.problem = f"the planner failed with {type(error).__name__}{detail}"
        log.error("return_planner_failed", extra={"reason": self.problem}, exc_info=error)

    def _flown(self) -> Mask:
        """(n,) Which vehicles follow the plan."""
        flown = np.array([vehicle_id in self._led for vehicle_id in self._rows], dtype=np.bool_)
        self._led.clear()
        return flown

    def goal_m(self, vehicle: Vehicle) -> Array | None:
        """(3,) Goal at this time, show frame; None: the vehicle waits for the plan."""
        if self._progress is None:
            return None
        self._led.add(vehicle.id)
        return np.asarray(self._progress.goal_m[self._rows[vehicle.id]])

    def place_m(self, vehicle: Vehicle) -> Array:
        """(3,) Where a vehicle of the plan lands: its pad, or beside it."""
        return np.asarray(self._home_m[self._rows[vehicle.id]])

    def follows_path(self, vehicle: Vehicle) -> bool:
        """Whether it has a path without conflicts, and is not late at its end."""
        if self._progress is None:
            return False
        row = self._rows[vehicle.id]
        return row not in self._progress.return_paths.unplanned and not self._progress.late[row]

    def has_arrived(self, vehicle: Vehicle) -> bool:
        """Whether its path has led it above its landing place."""
        return self._progress is not None and bool(self._progress.arrived[self._rows[vehicle.id]])

    def _all_stand(self) -> bool:
        """Whether every participating vehicle is under control and nearly at rest."""
        ours = [vehicle for vehicle in self._expected.values() if vehicle.phase in FLYING | {Phase.PILOT}]
        stands = np.linalg.norm(self._flight.fleet.velocity_m_s, axis=1) < STANDS_M_S
        return all(vehicle.id in self._stopping and stands[vehicle.row] for vehicle in ours)

    def _begin(self) -> None:
        flight = self._flight
        ready = [vehicle for vehicle in self._stopping.values() if vehicle.phase is Phase.RETURN]
        known = [vehicle for vehicle in ready if np.isfinite(flight.position_m(vehicle)).all()]
        homing = [vehicle for vehicle in known if vehicle.home_m is not None]
        if not homing or len(homing) > TOGETHER_MAX:
            self._is_off = True
            return
        self._places = rows = [vehicle.row for vehicle in homing]
        operation, uncertainty_m = flight.config.operation, flight.traits.uncertainty_m
        heights_m = operation.takeoff_height_m, operation.handover_height_m
        segments_m, segments_of = flight.swept()
        self._rows = {vehicle.id: row for row, vehicle in enumerate(homing)}
        self._home_m = homes_m(flight, homing)
        fleet = flight.fleet.position_m[rows].copy(), self._home_m, heights_m, flight.control, flight.plan
        lost = segments_m, uncertainty_m[segments_of]
        try:
            self._planner = return_planner(*fleet, flight.fleet.time_s, uncertainty_m[rows], lost)
            self._planned = self._planning.submit(plan_return_paths, self._planner, lambda: self._enough)
        except (ShapeError, RuntimeError) as error:  # RuntimeError: no thread can be started
            self._fail(error)
