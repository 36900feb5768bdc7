"""How long each vehicle that comes down has got neither lower nor nearer to its place."""

from collections.abc import Callable
from typing import Final

import numpy as np

from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Mask

HEADWAY_M: Final = 0.5
"""Lower, or nearer to its place, by so much a vehicle gets on: positions wander by decimetres."""

AT_GOAL_M: Final = 5.0
"""A vehicle that waits on purpose is this near to its goal, over the ground; one carried off waits not."""

LED_M_S: Final = 0.5
LED_SHARE: Final = 0.5
"""A vehicle that is led at least so fast, and flies this share of that or more, goes its way as it is led."""

ROUND_S: Final = {Phase.LANDING: 60.0, Phase.RETURN: 120.0}
"""So long a way round something may lead no nearer."""

PAUSED_S: Final = 1.0
"""Time without a tick does not count."""

_NOWHERE: Final = np.full(3, np.nan)


class Headway:
    """Of one flight, on the event loop only. A new maneuver begins anew."""

    def __init__(
        self,
        newest: Newest,
        vehicles: FlightVehicles,
        waits: Callable[[Vehicle], bool],
        maneuver_of: Callable[[Vehicle], object],
    ) -> None:
        """`waits`: whether a vehicle waits on purpose; `maneuver_of`: what it executes, None: nothing."""
        self._newest, self._vehicles = newest, vehicles
        self._waits, self._maneuver_of = waits, maneuver_of
        n = len(vehicles)
        self._least_m = np.full(n, np.inf)  # of what was left of its way
        self._nearer_s, self._since_s = np.full(n, np.inf), np.full(n, np.inf)
        self._maneuvers: list[object] = [None] * n
        self._looked_s = -np.inf
        self.off_m = np.full(n, np.nan)
        """(n,) how far each is from its place over the ground; NaN: its autopilot leads it."""

    @property
    def stands_s(self) -> Array:
        """(n,) how long each has made no headway; minus infinity where it does not come down."""
        return np.asarray(self._newest.state.time_s - self._since_s)

    def begin(self, vehicle: Vehicle) -> None:
        """Count from now on: it is led otherwise."""
        self._since_s[vehicle.row] = np.inf

    def look(self) -> None:
        """Compare with before; several times a second."""
        now_s = self._newest.state.time_s
        paused_s, self._looked_s = now_s - self._looked_s, now_s
        if np.isfinite(paused_s) and paused_s > PAUSED_S:
            self._since_s += paused_s
            self._nearer_s += paused_s
        coming = self._vehicles.in_phase(Phase.RETURN, Phase.LANDING)
        rows = [vehicle.row for vehicle in coming]
        rest = np.ones(len(self._vehicles), np.bool_)
        rest[rows] = False
        self._least_m[rest] = self._nearer_s[rest] = self._since_s[rest] = np.inf
        if rows:
            self._compare(coming, rows, now_s)

    def _compare(self, coming: list[Vehicle], rows: list[int], now_s: float) -> None:
        here_m = self._newest.state.position_m[rows]
        goals = [
            _NOWHERE if each.goal_m is None or each.flags.handed_over else each.goal_m for each in coming
        ]
        offset_m = np.array(goals) - here_m
        off_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
        self.off_m[rows] = off_m
        left_m = np.where(np.isnan(off_m), 0.0, off_m) - here_m[:, 2]
        near = (off_m <= AT_GOAL_M).tolist()
        waits = [is_near and self._waits(each) for each, is_near in zip(coming, near, strict=True)]
        begins = (
            np.array(waits)
            | np.array([self._is_new(each) for each in coming])
            | np.isinf(self._since_s[rows])
        )
        nearer = left_m < self._least_m[rows] - HEADWAY_M
        round_s = np.array([ROUND_S[each.phase] for each in coming])
        led = self._led(rows) & (now_s - self._nearer_s[rows] < round_s)
        self._least_m[rows] = np.where(
            begins | nearer, np.nan_to_num(left_m, nan=np.inf), self._least_m[rows]
        )
        self._nearer_s[rows] = np.where(begins | nearer, now_s, self._nearer_s[rows])
        self._since_s[rows] = np.where(begins | nearer | led, now_s, self._since_s[rows])

    def _led(self, rows: list[int]) -> Mask:
        """(k,) Which go as they are led: a way round an obstacle leads away from the place at first."""
        asked_m_s, flown_m_s = self._newest.memory.asked_m_s[rows], self._newest.state.velocity_m_s[rows]
        squared = (asked_m_s**2).sum(axis=1)
        goes = (asked_m_s * flown_m_s).sum(axis=1) >= LED_SHARE * squared  # False for NaN
        return np.asarray((squared >= LED_M_S**2) & goes)

    def _is_new(self, vehicle: Vehicle) -> bool:
        """Whether it was given another maneuver since the last look."""
        now, before = self._maneuver_of(vehicle), self._maneuvers[vehicle.row]
        if now is None or now is before:
            return False
        self._maneuvers[vehicle.row] = now
        return True
