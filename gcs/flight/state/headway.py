"""How long each vehicle that comes down has got neither lower nor nearer to its place."""

from collections.abc import Callable, Sequence
from operator import attrgetter
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

ANEW_M: Final = 2.0
"""A place that is farther from the one before is another one: only the way to it counts from then on."""

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
        place_of: Callable[[Vehicle], Array | None],
    ) -> None:
        """`waits`: whether a vehicle waits on purpose; `maneuver_of`: what it executes, None: nothing.

        `place_of`: (3,) above which it is to come down: its goal, or where a plan leads its goal in the end.
        """
        self._newest, self._vehicles = newest, vehicles
        self._waits, self._maneuver_of, self._place_of = waits, maneuver_of, place_of
        n = len(vehicles)
        self._least_m = np.full(n, np.inf)  # of what was left of its way
        self._place_m = np.full((n, 3), np.nan)  # and where that leads
        self._nearer_s, self._since_s = np.full(n, np.inf), np.full(n, np.inf)
        self._maneuvers: list[object] = [None] * n
        self._looked_s = -np.inf
        self._from_m = np.full((n, 3), np.nan)  # where it was when it made headway last
        self.off_m = np.full(n, np.nan)
        """(n,) how far each is from its place over the ground; NaN: its autopilot leads it."""

    @property
    def stands_s(self) -> Array:
        """(n,) how long each has made no headway; minus infinity where it does not come down."""
        return np.asarray(self._newest.state.time_s - self._since_s)

    def holds(self, vehicle: Vehicle) -> bool:
        """Whether it has stayed where it made headway last: it holds its place, nothing carries it off."""
        here_m, from_m = self._newest.state.position_m[[vehicle.row]], self._from_m[[vehicle.row]]
        return bool(_apart_m(here_m, from_m)[0] <= AT_GOAL_M)  # False for NaN

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
        self._place_m[rest] = np.nan
        if rows:
            self._compare(coming, rows, now_s)

    def _compare(self, coming: list[Vehicle], rows: list[int], now_s: float) -> None:
        here_m = self._newest.state.position_m[rows]
        place_m = _places(coming, self._place_of)
        self.off_m[rows] = off_m = _apart_m(place_m, here_m)
        self._begin_ways(rows, here_m, place_m)
        left_m = np.nan_to_num(off_m) - here_m[:, 2]
        near = (_apart_m(_places(coming, attrgetter("goal_m")), here_m) <= AT_GOAL_M).tolist()
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
        goes_on = begins | nearer | led
        self._since_s[rows] = np.where(goes_on, now_s, self._since_s[rows])
        self._from_m[rows] = np.where(goes_on[:, None], here_m, self._from_m[rows])

    def _begin_ways(self, rows: list[int], here_m: Array, place_m: Array) -> None:
        """Compare on the way to another place (k, 3) with that way: the change itself is no headway."""
        before_m = self._place_m[rows]
        other = np.isnan(place_m[:, 0]) != np.isnan(before_m[:, 0])
        anew = other | (_apart_m(place_m, before_m) > ANEW_M)  # False for NaN
        farther_m = np.nan_to_num(_apart_m(place_m, here_m)) - np.nan_to_num(_apart_m(before_m, here_m))
        self._least_m[rows] += np.where(anew, farther_m, 0.0)
        self._place_m[rows] = np.where(anew[:, None], place_m, before_m)

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


def _places(vehicles: Sequence[Vehicle], of: Callable[[Vehicle], Array | None]) -> Array:
    """(k, 3) where they are led; NaN: nowhere, or their autopilots lead them."""
    places = [None if each.flags.handed_over else of(each) for each in vehicles]
    return np.array([_NOWHERE if place is None else place for place in places])


def _apart_m(place_m: Array, other_m: Array) -> Array:
    """(k,) distances over the ground between (k, 3) and (k, 3)."""
    return np.asarray(np.hypot(*(place_m - other_m)[:, :2].T))
