"""Everybody comes home together: they stop, their ways are planned a little every tick, and they set out."""

from collections.abc import Callable, Iterable

import numpy as np

from gcs.control import ellipses_of
from gcs.flight import Flight
from gcs.homeward import Planner, Ways
from gcs.landing import CLEAR_M
from gcs.lifecycle import Phase
from gcs.state import Array, VehicleId
from gcs.vehicle import Vehicle

STANDS_M_S = 0.4
STOPPED_WITHIN_S = 5.0
"""Who does not stand by then, or is not under control, comes home without the plan, through the filter."""

PLANNED_WITHIN_S = 2.0
"""Then the best plan so far is flown; the first is always finished."""

SHARE_S = 0.01
"""Of a tick may be spent on the plan."""

INSIDE_FENCE_M = 1.0

TOGETHER_MAX = 100
"""For more the first plan takes too long; they come home through the filter alone."""

FLYING = frozenset({Phase.FORMATION, Phase.HOLD, Phase.RETURN})


class Homecoming:
    """One collective return. Changed only on the event loop."""

    def __init__(self, flight: Flight, vehicles: Iterable[Vehicle], clock_s: Callable[[], float]) -> None:
        """`vehicles` know where they started; `clock_s` goes on while a tick is at work."""
        self._flight = flight
        self._clock_s = clock_s
        self._expected = {vehicle.id: vehicle for vehicle in vehicles}
        self._stopping: dict[VehicleId, Vehicle] = {}
        self._asked_s = flight.fleet.time_s
        self._planner: Planner | None = None
        self._rows: dict[VehicleId, int] = {}
        self._ways: Ways | None = None
        self._begun_s = 0.0  # of the planning, then of the flight

    @property
    def is_planned(self) -> bool:
        """Whether they have set out."""
        return self._ways is not None

    def stopping(self, vehicle: Vehicle) -> None:
        """It is under control, and stops."""
        self._stopping[vehicle.id] = vehicle

    def takes_part(self, vehicle: Vehicle) -> bool:
        """Whether it is, or may still be, part of the plan."""
        return vehicle.id in self._rows if self._planner is not None else vehicle.id in self._expected

    def advance(self) -> None:
        """Go on planning; once a tick."""
        now_s = self._flight.fleet.time_s
        if self._ways is not None:
            return
        if self._planner is None:
            if self._all_stand() or now_s - self._asked_s > STOPPED_WITHIN_S:
                self._begin(now_s)
            return
        until_s = self._clock_s() + SHARE_S
        done = False
        while not done and self._clock_s() < until_s:
            done = self._planner.step()
        late = now_s - self._begun_s > PLANNED_WITHIN_S and self._planner.ways is not None
        if done or late:
            self._ways, self._begun_s = self._planner.ways, now_s

    def goal_m(self, vehicle: Vehicle) -> Array | None:
        """(3,) where it shall be now; None: it waits for the plan."""
        if self._ways is None:
            return None
        return self._ways.goal_m(self._rows[vehicle.id], self._flight.fleet.time_s - self._begun_s)

    def has_way(self, vehicle: Vehicle) -> bool:
        """Whether a way was found for it that meets nobody."""
        return self._ways is not None and self._rows[vehicle.id] not in self._ways.unplanned

    def is_over(self, vehicle: Vehicle) -> bool:
        """Whether its way has led it above its start."""
        if self._ways is None:
            return False
        return self._flight.fleet.time_s - self._begun_s >= float(self._ways.over_s[self._rows[vehicle.id]])

    def _all_stand(self) -> bool:
        """Everybody that is still ours is under control, and hardly moves."""
        ours = [vehicle for vehicle in self._expected.values() if vehicle.phase in FLYING]
        speed_m_s = np.linalg.norm(self._flight.fleet.velocity_m_s, axis=1)
        return all(
            vehicle.id in self._stopping and bool(speed_m_s[vehicle.row] < STANDS_M_S) for vehicle in ours
        )

    def _begin(self, now_s: float) -> None:
        flight = self._flight
        ready = [vehicle for vehicle in self._stopping.values() if vehicle.phase is Phase.RETURN]
        homes = [(vehicle, vehicle.home_m) for vehicle in ready if vehicle.home_m is not None]
        if not homes or len(homes) > TOGETHER_MAX:
            self._expected = {}
            return
        rows = [vehicle.row for vehicle, _ in homes]
        control, operation = flight.control, flight.config.operation
        self._rows = {vehicle.id: row for row, (vehicle, _) in enumerate(homes)}
        self._planner = Planner(
            flight.fleet.position_m[rows].copy(),
            np.array([home_m for _, home_m in homes]),
            operation.takeoff_height_m,
            operation.handover_height_m,
            speed_m_s=control.law.speed_m_s,
            goal_rate_per_s=control.law.goal_rate_per_s,
            limits=control.safety.limits,
            floor=control.safety.floor,
            uncertainty_m=2.0 * float(flight.traits.uncertainty_m[rows].max()),
            is_free=self._is_free,
        )
        self._begun_s = now_s

    def _is_free(self, path_m: Array) -> bool:
        """Whether a way (k, 3) is inside the fence and clear of obstacles."""
        flight, fence = self._flight, self._flight.control.safety.fence
        inside_m = min(
            fence.distance_max_m - float(np.hypot(path_m[:, 0], path_m[:, 1]).max()),
            fence.height_max_m + float(path_m[:, 2].min()),
        )
        if inside_m < INSIDE_FENCE_M:
            return False
        for ellipse in ellipses_of(flight.plan, flight.control, flight.fleet.time_s).values():
            low = -path_m[:, 2] < ellipse.top_height_m
            if low.any() and float(ellipse.distance_m(path_m[low]).min()) < CLEAR_M:
                return False
        return True
