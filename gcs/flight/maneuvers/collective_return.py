"""The collective return: all vehicles stop, paths are planned beside the flight, all fly home together."""

import logging
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, Future
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.control import ellipses_of
from gcs.control.round_obstacles import shut_in_by
from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.state.elsewhere import Returning, ReturnsElsewhere
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.errors import cut
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.return_paths.closed_ways import closed_paths
from gcs.planning.return_paths.paths import LATE_S, PATIENCE_S, PathProgress, ReturnPaths
from gcs.planning.return_paths.planner import Planner, plan_return_paths, return_planner
from gcs.shows.following import assigned

log = logging.getLogger(__name__)

STANDS_M_S = 0.4
STOPPED_WITHIN_S = 5.0
"""A vehicle that has not stopped or is not under control by then returns without a planned path."""

PLANNED_WITHIN_S = 10.0
"""The best plan at that time is flown; the first is always completed. 50 vehicles take less than a second."""

LONGEST_S: Final = 60.0
"""The first plan is not waited for any longer: the vehicles return one by one."""

OVERDUE_S: Final = 30.0
"""A plan by which a vehicle waits for so much longer than it may is not followed any more."""

LEAD_FOLLOWS_S = 2.0
"""A lead that does not return as well by then plans nothing for this flight."""

SHARED_WITHIN_S = 90.0
"""By then another flight's plan must have arrived; otherwise each plans for its own vehicles."""

TOGETHER_MAX = 1500
"""Larger fleets return without planned paths: their first plan would take more than half a minute."""

LOOKS: Final = 2
"""So many vehicles a tick are examined for whether a way still leads home."""

PATHS_COMPARED: Final = 10
"""So many planned paths a tick are compared with the space of vehicles that were lost since."""

FLYING = frozenset({Phase.FORMATION, Phase.HOLD, Phase.RETURN})


class CollectiveReturn:
    """One collective return. Changed on the event loop only."""

    def __init__(
        self,
        newest: Newest,
        in_force: InForce,
        of_flight: FlightVehicles,
        show: ShowState,
        places: LandingPlaces,
        others: ReturnsElsewhere,
        slow_from_m: Callable[[Sequence[Vehicle]], Array],
        vehicles: Iterable[Vehicle],
        planning: Executor,
    ) -> None:
        """Of `vehicles`, which know where they started. The planner runs in `planning`, outside the tick."""
        self._newest, self._in_force, self._vehicles, self._show = newest, in_force, of_flight, show
        self._landing_places, self._others = places, others
        self._slow_from_m = slow_from_m
        self._planning = planning
        self._expected = {vehicle.id: vehicle for vehicle in vehicles}
        self._stopping: dict[VehicleId, Vehicle] = {}
        self._rows: dict[VehicleId, int] = {}
        self._places: list[int] = []  # rows of FleetState, in the plan's order
        self._home_m = np.zeros((0, 3))  # (n, 3) landing positions, in the same order
        self._elsewhere = np.zeros(0, np.intp)  # rows of vehicles flown elsewhere, after the own in the plan
        self._number = self._others.newest  # of an earlier return
        self._is_off = False  # no plan: the vehicles return one by one
        self._closed_m = np.zeros((0, 2, 3))  # paths of lost vehicles that places and paths allow for
        self._left: set[VehicleId] = set()  # left the plan: no way leads home, or place or path was closed
        self._shut_in = np.zeros(0, np.bool_)  # (n,) that no way leads home; written by the planning thread
        self._next_row = 0  # the next of the plan's rows whose way is examined
        self._compared = 0  # the next of the plan's paths that is compared with those of lost vehicles
        self._to_compare = 0  # so many are left to be
        self.problem = ""  # why the planner failed and what follows
        self._planner: Planner | None = None
        self._planned: Future[tuple[ReturnPaths, Array]] | None = None  # with (n, 3) landing positions
        self._enough = False  # read by the planning thread
        self._progress: PathProgress | None = None
        self._followed_s = np.inf  # when the plan began to be followed
        self._led: set[VehicleId] = set()  # vehicles that took their goal since the last tick
        self._since_s = self._newest.state.time_s  # time of the command, the planning, or the last tick

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
        if self._is_off or vehicle.id in self._left:
            return False
        return vehicle.id in (self._expected if self._planned is None else self._rows)

    def advance(self) -> None:
        now_s = self._newest.state.time_s
        since_s = now_s - self._since_s
        if self._progress is not None:
            self._since_s = now_s
            self._follow(self._progress, since_s)
        elif self._is_off or (self._planned is None and self._waits_for_paths(since_s)):
            return
        elif self._planned is None:
            if self._all_stand() or since_s > STOPPED_WITHIN_S:
                self._since_s = now_s
                self._begin()
        elif self._planned.done():
            self._since_s = now_s
            error = self._planned.exception()
            if error is None:
                self._begin_following(*self._planned.result())
            else:
                self._fail(error)
        elif since_s > LONGEST_S:
            self.give_up()
            self._fail(TimeoutError(f"no plan within {LONGEST_S:g} s"))
        elif since_s > PLANNED_WITHIN_S:
            self.give_up()

    def _waits_for_paths(self, since_s: float) -> bool:
        """Whether another flight plans the return; take its paths once they have arrived."""
        if self._others.plans_returns is not False or since_s > SHARED_WITHIN_S:
            return False
        if since_s > LEAD_FOLLOWS_S and not self._others.lead_returns:
            return False
        received = self._others.received_paths(self._number)
        if received is not None:
            paths, rows, home_m = received
            self._places = rows.tolist()
            self._rows = {self._newest.state.ids[row]: at for at, row in enumerate(self._places)}
            if self._exchanges_pads:
                for row, place_m in zip(self._places, home_m, strict=True):
                    self._vehicles.rows[row].home_m = place_m.copy()
            self._planned = Future()
            self._planned.set_result((paths, home_m))
        return True

    def _begin_following(self, paths: ReturnPaths, home_m: Array) -> None:
        self._home_m, self._followed_s = home_m, self._newest.state.time_s
        self._leave(np.flatnonzero(self._shut_in[: len(self._places)]))
        self._progress = PathProgress(paths, self._home_m)
        if len(self._elsewhere):
            self._others.publish_paths(paths, self._elsewhere, self._home_m[len(self._places) :])

    def _follow(self, progress: PathProgress, step_s: float) -> None:
        position_m, flown, led_s = self._newest.state.position_m[self._places], self._flown(), np.nan
        if len(self._elsewhere):
            their_m, under_way = self._others.under_way(self._elsewhere)
            position_m, flown = np.concatenate([position_m, their_m]), np.concatenate([flown, under_way])
        elif self._others.plans_returns is False:
            led_s = self._others.led_s()
        self._others.note_return(progress.time_s)
        progress.advance(step_s, position_m, flown, led_s)
        self._leave_closed(progress)
        self._leave_without_way()

    def _leave_closed(self, progress: PathProgress) -> None:
        """Take vehicles out of the plan where their place or path is closed by now."""
        lost = self._landing_places.closed()
        changed = not np.array_equal(lost[0], self._closed_m)
        if changed:
            self._closed_m, self._to_compare = lost[0], len(self._places)
        if changed or self._landing_places.are_obstructed:
            closed = self._landing_places.closed_to(self._places, self._home_m[: len(self._places)])
            self._leave(np.flatnonzero(closed))
        if self._to_compare:
            self._leave_closed_paths(progress, lost)

    def _leave_closed_paths(self, progress: PathProgress, lost: tuple[Array, Array]) -> None:
        """Of the next few rows: a lost vehicle that is received may change its path in every tick."""
        count = min(PATHS_COMPARED, self._to_compare)
        at = (self._compared + np.arange(count)) % len(self._places)
        self._compared, self._to_compare = self._compared + count, self._to_compare - count
        uncertainty_m = self._newest.traits.uncertainty_m[[self._places[each] for each in at.tolist()]]
        floor = self._in_force.control.safety.floor
        closed = closed_paths(progress.return_paths, at, progress.time_s, floor, uncertainty_m, lost)
        self._leave(at[closed])

    def _leave(self, at: NDArray[np.intp]) -> None:
        """Take the vehicles of rows (k,) of the plan out of it."""
        self._left.update(self._newest.state.ids[self._places[each]] for each in at.tolist())

    def _leave_without_way(self) -> None:
        """Take vehicles out of the plan that obstacles have shut in since: a few in each tick."""
        if not self._in_force.plan.obstacles or not self._places:
            return
        examined = np.unique(np.arange(self._next_row, self._next_row + LOOKS) % len(self._places))
        self._next_row = (self._next_row + LOOKS) % len(self._places)
        control, here_m = self._in_force.control, self._newest.state.position_m[self._places][examined]
        ellipses = ellipses_of(self._in_force.plan, control, self._newest.state.time_s)
        self._leave(examined[shut_in_by(ellipses, here_m, self._home_m[examined], control)])

    def _fail(self, error: BaseException) -> None:
        """Log any error of the planner, and show it as an alarm: the fleet returns without a plan."""
        self._is_off = True
        detail = f": {cut(str(error))}" if str(error) else ""
        self.problem = f"the planner failed with {type(error).__name__}{detail}"
        log.error("return_planner_failed", extra={"reason": self.problem}, exc_info=error)

    def _flown(self) -> Mask:
        """(m,) Which of the own vehicles follow the plan."""
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

    def leads_home(self, vehicle: Vehicle) -> bool:
        """Whether its goal follows a path of the plan."""
        return self.is_planned and self.takes_part(vehicle)

    def leads(self, vehicle: Vehicle) -> bool:
        """Whether it stands where the plan has it wait, or waits for the plan: for a bounded time only."""
        if not self.takes_part(vehicle):
            return False
        if self._progress is None:
            return True
        row = self._rows[vehicle.id]
        over_s = float(self._progress.return_paths.over_s[row]) + PATIENCE_S + LATE_S
        late = self._newest.state.time_s - self._followed_s > over_s + OVERDUE_S
        return not (late or self._progress.late[row] or self._progress.arrived[row])

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
        stands = np.linalg.norm(self._newest.state.velocity_m_s, axis=1) < STANDS_M_S
        if self._others.plans_returns and not self._others.stands(STANDS_M_S):
            return False
        return all(vehicle.id in self._stopping and stands[vehicle.row] for vehicle in ours)

    def _begin(self) -> None:
        ready = [vehicle for vehicle in self._stopping.values() if vehicle.phase is Phase.RETURN]
        located = [vehicle for vehicle in ready if np.isfinite(self._newest.position_m(vehicle)).all()]
        homing = [vehicle for vehicle in located if vehicle.home_m is not None]
        returning = self._others.returning() if self._others.plans_returns else Returning.none()
        if self._exchanges_pads:
            returning = self._exchange_pads(homing, returning)
        self._places = rows = [vehicle.row for vehicle in homing]
        operation, uncertainty_m = self._landing_places.operation, self._newest.traits.uncertainty_m
        start_m, own_m = self._newest.state.position_m[rows], uncertainty_m[rows]
        places_m = self._landing_places.homes_of(homing, returning)
        self._elsewhere = returning.rows
        start_m = np.concatenate([start_m, returning.position_m])
        own_m = np.concatenate([own_m, returning.uncertainty_m])
        if not len(start_m) or len(start_m) > TOGETHER_MAX:
            self._is_off = True
            return
        over_m = operation.takeoff_height_m
        slow_from_m = self._slow_from_m(homing).max(initial=operation.handover_height_m)
        heights_m = over_m, min(float(slow_from_m), over_m)
        self._rows = {vehicle.id: row for row, vehicle in enumerate(homing)}
        lost = self._landing_places.closed()
        self._closed_m = lost[0]
        about = (
            heights_m,
            self._in_force.control,
            self._in_force.plan,
            self._newest.state.time_s,
            own_m,
            lost,
        )

        def planner_for(home_m: Array) -> Planner:
            return return_planner(start_m.copy(), home_m, *about)

        def shut_in_of(home_m: Array) -> Mask:
            return shut_in_by(ellipses, start_m, home_m, control)

        control = self._in_force.control
        ellipses = ellipses_of(self._in_force.plan, control, self._newest.state.time_s)
        try:
            self._planned = self._planning.submit(self._plan, places_m, planner_for, shut_in_of)
        except RuntimeError as error:  # no thread can be started
            self._fail(error)

    @property
    def _exchanges_pads(self) -> bool:
        return self._show.run is not None and self._show.run.exchanges_pads

    def _exchange_pads(self, homing: Sequence[Vehicle], returning: Returning) -> Returning:
        """Assign the pads of all returning vehicles anew; from then on they are their own.

        Returns: `returning` with their new pads.
        """
        count = len(homing)
        home_m = np.array([vehicle.home_m for vehicle in homing]).reshape(-1, 3)
        start_m = np.array([self._newest.position_m(vehicle) for vehicle in homing]).reshape(-1, 3)
        home_m = np.concatenate([home_m, returning.home_m])
        start_m = np.concatenate([start_m, returning.position_m])
        if not len(home_m):
            return returning
        pads = assigned(start_m, home_m)
        for vehicle, pad in zip(homing, pads[:count].tolist(), strict=True):
            vehicle.home_m = home_m[pad].copy()
        moved = int(np.count_nonzero(pads != np.arange(len(pads))))
        log.info("pads_exchanged", extra={"count": moved})
        return returning._replace(home_m=home_m[pads[count:]])

    def _plan(
        self,
        places_m: Callable[[], Array],
        planner_for: Callable[[Array], Planner],
        shut_in_of: Callable[[Array], Mask],
    ) -> tuple[ReturnPaths, Array]:
        """Choose the landing positions (n, 3), and plan the ways to them. Called by the planning thread."""
        home_m = places_m()
        self._planner = planner_for(home_m)
        self._shut_in = shut_in_of(home_m)
        return plan_return_paths(self._planner, lambda: self._enough), home_m
