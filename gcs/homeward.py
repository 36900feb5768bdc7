"""Ways home for a whole fleet that do not cross: found and checked before anybody leaves. Pure.

Everybody flies level or slanting to a place above its own pad, then straight down. One after the other (who
has the longest way first) each takes the way and the waiting time that bring it down soonest without meeting
those already planned. Who finds none chooses earlier in the next round. The filter watches as ever.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.compiled import kernel
from gcs.errors import ShapeError
from gcs.safety.filter import Limits
from gcs.safety.separation import Floor
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array

STEP_S = 0.2
"""Between two moments at which the ways are compared."""

SLANTS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Heights above the pad where the slanting part ends: shares between `over_m` and one's own."""

RISES_M = (0.0, 3.0, 6.0)
"""Or one first climbs by so much, and flies level."""

ASIDES_M = (-9.0, -4.5, 4.5, 9.0)
"""Or one passes the middle of the straight way so far to its right."""

ROUNDS = 40
"""So often everything is planned, at most."""

PATIENT_ROUNDS = 25
"""After so many, pairs may close faster, although the filter will slow some of them down."""

HASTY_SHARE = 0.4

MORE_S = 60.0
"""So much later may the last round let everybody be down."""

LONGEST_SHARE = 1.4
"""Of the longest way: nobody comes down later than that and `spare_s`, if that can be."""

SPEED_SHARE = 0.95
"""Of the limits: who is late must be able to catch up."""

TAIL = 10
"""Steps by which a vehicle trails behind what it is drawn to, at most."""

NEARLY_M = 0.05
"""A pair that began as close as is kept may be so much closer."""

FAR_M = 25.0
"""Farther away, nobody is met within a stop's time."""

TOUCH_DOWN_M_S = 0.6
"""Below the handover its autopilot lands it, slower than the limits."""


class Homeward(Settings):
    """How ways home are planned."""

    spare_m: NotNegative = 0.1  # on top of the floor's margin, for what the plan does not know
    spare_s: Positive = 6.0
    reaction_s: NotNegative = 0.5  # two close no faster than the safety filter lets them, see `Braking`
    deceleration_m_s2: Positive = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """One way home, step by step."""

    goal_m: Array  # (k, 3) what the vehicle is drawn to
    path_m: Array  # (k + TAIL, 3) where it will be
    over: int  # the step at which it is above its pad


@dataclass(frozen=True, slots=True, eq=False)
class Ways:
    """A plan for the whole fleet. Rows as it was asked for."""

    path_m: Array  # (n, t, 3) every STEP_S, show frame: what each is drawn to
    over_s: Array  # (n,) when each is above its pad, from where it comes straight down
    down_s: Array  # (n,) when each is down
    unplanned: tuple[int, ...]  # rows that found no way: they wait for all others, and the filter leads them

    def goal_m(self, row: int, time_s: float) -> Array:
        """(3,) where that vehicle shall be `time_s` after the order."""
        path_m = self.path_m[row]
        at = min(max(time_s / STEP_S, 0.0), len(path_m) - 1.0)
        first = min(int(at), len(path_m) - 2)
        goal_m: Array = path_m[first] + (at - first) * (path_m[first + 1] - path_m[first])
        return goal_m


class Planner:
    """Finds the ways, a vehicle at a time: between two ticks there is no time for all of them."""

    def __init__(
        self,
        start_m: Array,
        pad_m: Array,
        over_m: float,
        handover_m: float,
        *,
        speed_m_s: float,
        goal_rate_per_s: float,
        limits: Limits,
        floor: Floor,
        uncertainty_m: float,
        settings: Homeward | None = None,
        is_free: Callable[[Array], bool] | None = None,
    ) -> None:
        """Nothing is planned yet.

        Args:
            start_m: (n, 3) where they hover, show frame.
            pad_m: (n, 3) where each comes down.
            over_m: least height above the pads for anybody on its way.
            handover_m: height above the pad from which its autopilot lands it.
            speed_m_s: sideways, at most.
            goal_rate_per_s: at which a vehicle is drawn to its goal.
            limits: up and down.
            floor: that no pair may be inside.
            uncertainty_m: of a pair's positions, added up.
            settings: of the plan.
            is_free: whether a way (k, 3) meets nothing that stands; who has no such way is led by the filter.
        """
        settings = settings or Homeward()
        wide_m, tall_m = (kept_m + settings.spare_m for kept_m in floor.kept_m(uncertainty_m))
        self._start_m, self._scale = start_m, np.array([1.0, 1.0, wide_m / tall_m])
        self._low_m = floor.pad_height_m * wide_m / tall_m
        apart_m = np.linalg.norm((start_m[:, None] - start_m[None]) * self._scale, axis=2)
        # a pair that is closer than that already only may come no closer
        self._kept_m = np.minimum(wide_m, np.maximum(0.98 * apart_m, floor.horizontal_m))
        self._braking = settings.reaction_s, settings.deceleration_m_s2
        self._pad_m, self._heights_m = pad_m, (over_m, handover_m)
        self._speeds = SPEED_SHARE * np.array([speed_m_s, limits.up_m_s, limits.down_m_s])
        self._goal_rate_per_s, self._free = goal_rate_per_s, is_free
        self._ways_of: dict[int, list[_Way]] = {}
        way_m = pad_m - start_m
        level_s = np.hypot(way_m[:, 0], way_m[:, 1]) / self._speeds[0]
        self._quickest_s = np.maximum(level_s, way_m[:, 2] / self._speeds[2])
        longest_s = float(self._quickest_s.max(initial=STEP_S))
        self._count = int((LONGEST_SHARE * longest_s + settings.spare_s) / STEP_S) + TAIL
        self._fails, self._rounds = np.zeros(len(start_m)), 0
        self._best: Ways | None = None
        self._begin()

    @property
    def ways(self) -> Ways | None:
        """The best plan so far; None: there is none yet."""
        return self._best

    def step(self) -> bool:
        """Plan for one more vehicle. Returns: whether there is nothing left to find."""
        if self._queue:
            self._plan(self._queue.pop(0))
        if self._queue:
            return False
        self._finish()
        if not self._left or self._rounds >= ROUNDS:
            return True
        if self._rounds == ROUNDS - 1:
            self._count += int(MORE_S / STEP_S)
        self._fails[self._left] += 1  # who found no way chooses earlier in the next round
        self._begin()
        return False

    def _begin(self) -> None:
        n = len(self._start_m)
        self._rounds += 1
        self._queue = sorted(range(n), key=lambda row: (-self._fails[row], -self._quickest_s[row]))
        self._planned, self._left = list[int](), list[int]()
        self._path_m = np.repeat(self._start_m[:, None], self._count, axis=1)
        self._scaled_m = self._path_m * self._scale
        self._over_s, self._down_s = np.zeros(n), np.zeros(n)

    def _options(self, row: int) -> list[_Way]:
        """The ways of one vehicle, quickest first; those that meet something standing only if all do."""
        if row not in self._ways_of:
            ways = _options(
                self._start_m[row], self._pad_m[row], *self._heights_m, self._speeds, self._goal_rate_per_s
            )
            free = [way for way in ways if self._free is None or self._free(way.path_m)]
            self._ways_of[row] = free or ways
        return self._ways_of[row]

    def _plan(self, row: int) -> None:
        """The soonest way that is free."""
        ways_m, lengths = _padded([way.path_m * self._scale for way in self._options(row)])
        others_m, kept_m = self._scaled_m[self._planned], self._kept_m[row, self._planned]
        reaction_s, deceleration_m_s2 = self._braking
        if self._rounds > PATIENT_ROUNDS:
            reaction_s *= HASTY_SHARE
        which, wait = _soonest(
            ways_m, lengths, others_m, kept_m, reaction_s, deceleration_m_s2, self._low_m, self._count
        )
        if which < 0:
            self._left.append(row)
        else:
            self._take(row, which, wait)

    def _take(self, row: int, which: int, wait: int) -> None:
        self._planned.append(row)
        way = self._options(row)[which]
        _lay(self._path_m[row], way.goal_m, wait)
        _lay(self._scaled_m[row], way.path_m * self._scale, wait)
        self._over_s[row] = (wait + way.over) * STEP_S
        self._down_s[row] = (wait + len(way.path_m)) * STEP_S

    def _finish(self) -> None:
        """Keep this round's plan if it is better. Who found no way follows when all the others are down."""
        unplanned = tuple(self._left)
        if self._best is not None and len(self._best.unplanned) <= len(unplanned):
            return
        if unplanned:
            longest = max(len(self._options(row)[0].path_m) for row in unplanned)
            last = int(self._down_s.max(initial=0.0) / STEP_S)
            more = max(0, last + longest - self._count)
            self._path_m = np.concatenate(
                [self._path_m, np.repeat(self._path_m[:, -1:], more, axis=1)], axis=1
            )
            self._scaled_m = self._path_m * self._scale
            for row in unplanned:
                self._take(row, 0, last)
        self._best = Ways(self._path_m, self._over_s, self._down_s, unplanned)


def plan_ways(planner: Planner) -> Ways:
    """All at once, where nothing else has to be done meanwhile."""
    while not planner.step():
        pass
    if planner.ways is None:
        raise ShapeError("a plan for nobody")
    return planner.ways


def _lay(path_m: Array, way_m: Array, wait: int) -> None:
    """Write a way (k, 3) into a path (t, 3), begun after so many steps; before and after, it stands."""
    path_m[wait : wait + len(way_m)] = way_m
    path_m[wait + len(way_m) :] = way_m[-1]


def _options(
    start_m: Array, pad_m: Array, over_m: float, handover_m: float, speeds: Array, goal_rate_per_s: float
) -> list[_Way]:
    """Ways by which one may come home, quickest first."""
    lowest_z_m = pad_m[2] - over_m
    own_z_m = min(start_m[2], lowest_z_m)

    def over(slant: float) -> Array:
        return np.array([pad_m[0], pad_m[1], lowest_z_m + slant * (own_z_m - lowest_z_m)])

    corners = [[start_m, over(slant)] for slant in SLANTS]
    for rise_m in RISES_M:
        above = (0.0, 0.0, rise_m)
        corners.append([start_m, np.array([*start_m[:2], own_z_m]) - above, over(1.0) - above])
    way_m = pad_m[:2] - start_m[:2]
    right = np.array([-way_m[1], way_m[0], 0.0]) / max(float(np.hypot(*way_m)), 1.0)
    for aside_m in ASIDES_M:
        for slant in (0.0, 0.5):
            middle_m = (start_m + over(slant)) / 2.0 + aside_m * right
            corners.append([start_m, middle_m, over(slant)])
    handover_at_m = pad_m - (0.0, 0.0, handover_m)
    slow = speeds.copy()
    slow[2] = TOUCH_DOWN_M_S
    found = []
    for way in corners:
        before = _sampled(way, speeds)
        sink = _sampled([way[-1], handover_at_m], speeds)
        goal_m = np.vstack([before, sink, _sampled([handover_at_m, pad_m], slow)])
        found.append(
            _Way(goal_m, _followed(goal_m, start_m, goal_rate_per_s, speeds / SPEED_SHARE), len(before))
        )
    return sorted(found, key=lambda option: len(option.goal_m))


@kernel
def _followed(goal_m: Array, start_m: Array, rate_per_s: float, speeds: Array) -> Array:
    """(k + TAIL, 3) where a vehicle is that is drawn to goals (k, 3), one a step: it rounds the corners."""
    count = len(goal_m)
    path_m = np.empty((count + TAIL, 3))
    here = start_m.copy()
    for k in range(count + TAIL):
        wanted = rate_per_s * (goal_m[min(k, count - 1)] - here)
        level = np.sqrt(wanted[0] ** 2 + wanted[1] ** 2)
        share = min(1.0, speeds[0] / max(level, 1e-9))
        share = min(share, speeds[1] / max(-wanted[2], 1e-9), speeds[2] / max(wanted[2], 1e-9))
        here = here + STEP_S * share * wanted
        path_m[k] = here
    return path_m


def _sampled(corners_m: list[Array], speeds: Array) -> Array:
    """(k, 3) along straight lines, as fast as the speeds (sideways, up, down) allow, to the last corner."""
    parts = []
    for begin_m, end_m in pairwise(corners_m):
        way_m = end_m - begin_m
        vertical_s = -way_m[2] / speeds[1] if way_m[2] < 0.0 else way_m[2] / speeds[2]
        time_s = max(float(np.hypot(way_m[0], way_m[1])) / speeds[0], float(vertical_s))
        steps = max(1, int(np.ceil(time_s / STEP_S)))
        parts.append(begin_m + (np.arange(1, steps + 1) / steps)[:, None] * way_m)
    return np.vstack(parts)


def _padded(ways_m: list[Array]) -> tuple[Array, NDArray[np.intp]]:
    """Ways (k, 3) of different lengths in one array, and their lengths."""
    lengths = np.array([len(way) for way in ways_m])
    padded_m = np.zeros((len(ways_m), lengths.max(), 3))
    for row, way in enumerate(ways_m):
        padded_m[row, : len(way)] = way
    return padded_m, lengths


@kernel
def _soonest(
    ways_m: Array,
    lengths: NDArray[np.intp],
    others_m: Array,
    kept_m: Array,
    reaction_s: float,
    deceleration_m_s2: float,
    low_m: float,
    count: int,
) -> tuple[int, int]:
    """The way that ends soonest without meeting anybody, and after how many steps it begins; -1: none."""
    for end in range(lengths.min(), count):
        for k in range(len(ways_m)):
            wait = end - lengths[k]
            if wait < 0:
                continue
            free = True
            for j in range(len(others_m)):
                if _meets(
                    ways_m[k], lengths[k], wait, others_m[j], kept_m[j], reaction_s, deceleration_m_s2, low_m
                ):
                    free = False
                    break
            if free:
                return k, wait
    return -1, 0


@kernel
def _meets(
    way_m: Array,
    length: int,
    wait: int,
    other_m: Array,
    kept_m: float,
    reaction_s: float,
    deceleration_m_s2: float,
    low_m: float,
) -> bool:
    """Whether a way (k, 3) begun after `wait` steps meets another's (t, 3): too close, or too fast."""
    for t in range(wait + length - 1):
        at, then = max(t - wait, 0), max(t + 1 - wait, 0)
        if -way_m[at, 2] < low_m and -other_m[t, 2] < low_m:
            continue
        before2, after2 = 0.0, 0.0
        for axis in range(3):
            before2 += (other_m[t, axis] - way_m[at, axis]) ** 2
            after2 += (other_m[t + 1, axis] - way_m[then, axis]) ** 2
        if before2 > FAR_M * FAR_M:
            continue
        distance_m = np.sqrt(before2)
        closing_m_s = (distance_m - np.sqrt(after2)) / STEP_S
        gap_m = distance_m - kept_m
        if gap_m < 0.0 and (closing_m_s > 0.0 or gap_m < -NEARLY_M):
            return True
        if closing_m_s > 0.0:
            needed_m = closing_m_s * reaction_s + closing_m_s**2 / (2.0 * deceleration_m_s2)
            if needed_m > gap_m:
                return True
    return False


@cache
def warm_up() -> None:
    """Compile or load the kernels, so that nothing is compiled in the air."""
    start_m, pad_m = (
        np.array([[0.0, 0.0, -10.0], [9.0, 0.0, -10.0]]),
        np.array([[4.0, 0.0, 0.0], [0.0, 0, 0]]),
    )
    plan_ways(
        Planner(
            start_m,
            pad_m,
            5.0,
            1.5,
            speed_m_s=4.0,
            goal_rate_per_s=0.8,
            limits=Limits(),
            floor=Floor(),
            uncertainty_m=0.7,
        )
    )
