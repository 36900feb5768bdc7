"""Plans paths for all vehicles in rounds: a vehicle without a path is planned earlier in the next round."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from gcs.control import ControlSettings, ellipses_of
from gcs.formation.obstacles import Ellipse
from gcs.model.errors import ShapeError
from gcs.model.plan import Plan
from gcs.model.state import Array, Mask
from gcs.planning.landing_sites import CLEAR_M, are_covered, open_places_m
from gcs.planning.return_paths.candidates import (
    EACH,
    LATER_S,
    SPEED_SHARE,
    AreFree,
    Candidates,
    Closed,
    lay,
)
from gcs.planning.return_paths.closed_ways import are_occupied, closed_places, space_of_lost, way_down_apart_m
from gcs.planning.return_paths.conflicts import chosen_paths
from gcs.planning.return_paths.paths import STEP_S, ReturnPaths, ReturnSettings
from gcs.planning.return_paths.round_boxes import WaysRound
from gcs.planning.return_paths.within_areas import in_pieces, keep_off
from gcs.safety.controlled_ground import falls_within, kept_in_m
from gcs.safety.fenced_areas import beyond_m, passable
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows
from gcs.safety.surroundings import Limits

SPARED_FAILS = (5, 8, 3)
"""A vehicle that found no path in this many rounds is not passed while it waits, if possible. Where one
number leads to no complete plan, another does: each starts a new attempt.
"""

ATTEMPT_ROUNDS = 25
"""Most rounds of each attempt."""

ROUNDS = len(SPARED_FAILS) * ATTEMPT_ROUNDS

HASTY_SHARE = 0.4
"""In the last attempt pairs may close faster, although the filter will slow some of them down."""

MORE_S, MORE_FOR_MANY_S, MANY = 60.0, 20.0, 200
"""Additional time until all must be down: in the last round, and at a second try where they are many."""

ROUNDS_SPENT = 4.0e5
"""Rounds times the square of the vehicles: about 10 s of planning, also where no clock is looked at."""

FEW = 50
"""Up to this many the longest path goes first, above it the lowest vehicle (decision 0038)."""

WAITS_TRIED = 250
"""Vehicles for which every step of waiting is tried; with k times as many, every k-th."""

NO_STANDS_M: Array = np.zeros((0, 2))

LONGEST_SHARE = 1.1
"""Of the longest path: no vehicle lands later than that and `spare_s`, if possible."""

LATER_SHARE, LATER_ROUNDS = 1.4, 15
"""Share that replaces it after this many rounds of an attempt."""


class Planner:
    """Finds the paths. Owns all that it reads, so that it may run in a thread of its own."""

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
        reserve_m: float,
        settings: ReturnSettings | None = None,
        are_free: AreFree | None = None,
        closed: Closed | None = None,
        ways: WaysRound | None = None,
    ) -> None:
        """Plans nothing yet.

        Args:
            start_m: (n, 3) where they hover, show frame.
            pad_m: (n, 3) landing positions.
            over_m: least height above the pads on the way.
            handover_m: height above the pad from which its autopilot lands it.
            speed_m_s: sideways, at most.
            goal_rate_per_s: rate at which a vehicle approaches its goal.
            limits: up and down.
            floor: minimum separation of each pair.
            reserve_m: margin for the error of a pair's relative position, sideways.
            settings: of the plan.
            are_free: which places are inside the fence and clear of obstacles; None: all.
            closed: the space that lost vehicles may sweep; None: no vehicle is lost.
            ways: round obstacles; None: there is none.

        Raises: ShapeError if there are no vehicles, or a position is not finite.
        """
        if len(start_m) == 0:
            raise ShapeError("a plan without vehicles")
        for name, place_m in (("start_m", start_m), ("pad_m", pad_m)):
            unknown = np.flatnonzero(~np.isfinite(place_m).all(axis=1))
            if len(unknown):
                raise ShapeError(f"{name} must be finite in every row, and is not in rows {unknown.tolist()}")
        settings = settings or ReturnSettings()
        wide_m, tall_m = (kept_m + settings.spare_m for kept_m in floor.kept_m(reserve_m))
        self._start_m, self._pad_m, self._heights_m = start_m, pad_m, (over_m, handover_m)
        self._scale = np.array([1.0, 1.0, wide_m / tall_m])
        self._low_m = floor.pad_height_m * wide_m / tall_m
        self._kept_range_m = floor.horizontal_m, wide_m
        self._settings = settings
        self._limits_m_s = np.array([speed_m_s, limits.up_m_s, limits.down_m_s])
        self._goal_rate_per_s = goal_rate_per_s
        self._are_free, self._closed, self._round = are_free, closed, ways
        way_m = pad_m - start_m
        level_s = np.hypot(way_m[:, 0], way_m[:, 1]) / (SPEED_SHARE * speed_m_s)
        self._quickest_s = np.maximum(level_s, way_m[:, 2] / (SPEED_SHARE * limits.down_m_s))
        few = len(start_m) <= FEW
        self._rank = -self._quickest_s if few else -start_m[:, 2]  # the lowest of many make room
        self._fails = np.zeros(len(start_m))
        self._rounds = 0
        self._candidates: Candidates | None = None
        self._place_m = self._kept_m = start_m  # both are set in the first round
        self._best: tuple[Rows, Rows, Mask] | None = None  # as returned by `chosen_paths`
        self._halted = np.zeros(1, np.bool_)
        self._rounds_max = max(1, min(ROUNDS, int(ROUNDS_SPENT / len(start_m) ** 2)))

    @property
    def return_paths(self) -> ReturnPaths:
        """The best plan so far. Raises: ShapeError before the first round."""
        if self._best is None or self._candidates is None:
            raise ShapeError("no round has been planned")
        return self._laid(self._candidates, *self._best)

    def halt(self) -> None:
        """End the planning at once, from another thread; the first round is completed."""
        self._halted[0] = self._best is not None

    def round(self) -> bool:
        """Plan all vehicles once more. Returns: whether no further round can improve the plan."""
        candidates = self._candidates
        if candidates is None:
            candidates = self._candidates = self._prepared()
        self._rounds += 1
        settings, last = self._settings, self._rounds >= self._rounds_max
        attempt, before = divmod(self._rounds - 1, ATTEMPT_ROUNDS)
        if before == 0:
            self._fails[:] = 0
        quickest = candidates.quickest
        longest_s = float(self._quickest_s.max(initial=STEP_S))
        if self._round is not None:  # ways round obstacles are longer than straight ones
            longest_s = max(longest_s, quickest * STEP_S)
        share = LONGEST_SHARE if before < LATER_ROUNDS else LATER_SHARE
        many_s = MORE_FOR_MANY_S if len(self._start_m) > MANY else 0.0
        down_s = share * longest_s + settings.spare_s + (MORE_S if last else 0.0)
        later_s = max(down_s, LATER_SHARE * longest_s + settings.spare_s + many_s)
        way, wait, again = chosen_paths(
            np.lexsort((self._rank, -self._fails)),
            self._place_m,
            candidates.first,
            candidates.free,
            self._fails >= SPARED_FAILS[attempt],
            self._kept_m,
            (
                settings.reaction_s * (HASTY_SHARE if attempt == len(SPARED_FAILS) - 1 else 1.0),
                settings.deceleration_m_s2,
                self._low_m,
            ),
            (
                max(int(down_s / STEP_S), quickest) + 1,
                max(int(later_s / STEP_S), quickest) + 1,
                1 + len(self._start_m) // WAITS_TRIED,
                round(LATER_S / STEP_S),
            ),
            self._halted,
        )
        left = (way < 0) | again
        if self._best is None or (
            not self._halted[0] and self._cost(way, again) < self._cost(*self._best[::2])
        ):
            self._best = way, wait, again
        self._fails[left] += 1  # vehicles without a path choose earlier in the next round
        return last or bool(self._halted[0]) or not left.any()

    @staticmethod
    def _cost(way: Rows, again: Mask) -> float:
        """Vehicles without a path count as two that are passed while they wait."""
        return float(2 * (way < 0).sum() + again.sum())

    def _prepared(self) -> Candidates:
        """Return the candidate paths, which all rounds share."""
        candidates = lay(
            self._start_m,
            self._pad_m,
            *self._heights_m,
            speeds_m_s=self._limits_m_s,
            goal_rate_per_s=self._goal_rate_per_s,
            are_free=self._are_free,
            closed=self._closed,
            ways=self._round,
        )
        self._place_m = candidates.path_m * self._scale
        least_m, wide_m = self._kept_range_m
        apart_m = np.linalg.norm((self._start_m[:, None] - self._start_m[None]) * self._scale, axis=2)
        # a pair that is already closer must not come closer
        self._kept_m = np.minimum(wide_m, np.maximum(0.98 * apart_m, least_m))
        return candidates

    def _laid(self, candidates: Candidates, way: Rows, wait: Rows, _: Mask) -> ReturnPaths:
        """Return the plan as positions. Vehicles without a path follow when all others are down."""
        unplanned = np.flatnonzero(way < 0)
        way, wait, length = way.copy(), wait.copy(), candidates.length
        planned = np.flatnonzero(way >= 0)
        last = int((wait[planned] + length[way[planned]]).max(initial=0))
        for row in unplanned.tolist():
            own = slice(row * EACH, (row + 1) * EACH)
            way[row] = row * EACH + int(
                np.argmin(np.where(candidates.free[own].any(axis=1), length[own], length.max() + 1))
            )
            wait[row] = last
        count = int((wait + length[way]).max(initial=1))
        drawn_m, path_m = (np.repeat(self._start_m[:, None], count, axis=1) for _ in range(2))
        for row, (taken, begins) in enumerate(zip(way.tolist(), wait.tolist(), strict=True)):
            whole = slice(candidates.first[taken], candidates.first[taken + 1])
            for moments_m, places_m in (
                (drawn_m, candidates.goal_m[whole]),
                (path_m, candidates.path_m[whole]),
            ):
                moments_m[row, begins : begins + len(places_m)] = places_m
                moments_m[row, begins + len(places_m) :] = places_m[-1]
        return ReturnPaths(
            drawn_m,
            path_m,
            np.multiply(wait + candidates.over[way], STEP_S, dtype=np.float64),
            np.multiply(wait + length[way] - 1, STEP_S, dtype=np.float64),
            tuple(unplanned.tolist()),
        )


def plan_return_paths(planner: Planner, enough: Callable[[], bool] = lambda: False) -> ReturnPaths:
    """Run rounds until nothing is left to improve, or `enough()`; the first is always completed."""
    while not planner.round() and not enough():
        pass
    return planner.return_paths


@cache
def warm_up() -> None:
    """Compile or load the kernels, so that nothing is compiled in flight."""
    start_m = np.array([[0.0, 0.0, -10.0], [9.0, 0.0, -10.0]])
    pad_m = np.array([[4.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    ways = WaysRound((Ellipse(7.0, 0.0, 1.0, 9.0, 50.0),), CLEAR_M, 100.0, 100.0, 4.0)
    planner = Planner(
        start_m,
        pad_m,
        5.0,
        1.5,
        speed_m_s=4.0,
        goal_rate_per_s=0.8,
        limits=Limits(),
        floor=Floor(),
        reserve_m=0.7,
        are_free=lambda place_m, _: np.zeros(len(place_m), np.bool_),
        ways=ways,
    )
    plan_return_paths(planner)
    closed_places(pad_m, 5.0, Floor(), np.zeros(2), (np.zeros((1, 2, 3)), np.zeros(1)))


INSIDE_FENCE_M, OFF_AREAS_M = 1.0, 0.5

AHEAD_S = 60.0
"""Obstacles are taken to move on as they do for so long, and to stand from then on."""


def return_planner(
    position_m: Array,
    home_m: Array,
    heights_m: tuple[float, float],
    control: ControlSettings,
    plan: Plan,
    time_s: float,
    uncertainty_m: Array,
    lost: tuple[Array, Array] | None = None,
) -> Planner:
    """Prepare the planner of a collective return, for a flight or for its rehearsal.

    Args:
        position_m: (n, 3) positions of the vehicles, show frame; owned by the planner.
        home_m: (n, 3) landing positions, show frame.
        heights_m: above home: least height of the paths, and the height from which the autopilots land.
        control: speeds, fence and minimum separation.
        plan: the paths avoid its obstacles at their positions at `time_s`.
        time_s: time of the planning.
        uncertainty_m: (n,) standard deviations of the positions, sideways.
        lost: (m, 2, 3) paths that lost vehicles may take, show frame, and (m,) standard deviations of their
            positions; None: no vehicle is lost.

    Raises: ShapeError if there are no vehicles, or a position is not finite.
    """
    return Planner(
        position_m,
        home_m,
        *heights_m,
        speed_m_s=control.law.speed_m_s,
        goal_rate_per_s=control.law.goal_rate_per_s,
        limits=control.safety.limits,
        floor=control.safety.floor,
        reserve_m=control.safety.floor.worst_reserve_m(uncertainty_m),
        are_free=_are_free(control, ellipses_of(plan, control, time_s)),
        closed=None if lost is None else space_of_lost(control.safety.floor, uncertainty_m, *lost),
        ways=_round_boxes(control, plan, time_s, float(-home_m[:, 2].min()) + heights_m[0]),
    )


def _round_boxes(control: ControlSettings, plan: Plan, time_s: float, least_m: float) -> WaysRound | None:
    """Ways round the obstacles at `time_s`, within areas and controlled ground; None: there is none of these.

    `least_m` is the least height of these ways.
    """
    fence, ellipses = control.safety.fence, tuple(ellipses_of(plan, control, time_s).values())
    within_m, highest_m = fence.distance_max_m - INSIDE_FENCE_M, fence.height_max_m - INSIDE_FENCE_M
    if not ellipses and not fence.areas and fence.controlled_ground is None:
        return None
    ground, impact = None, control.safety.impact
    if fence.controlled_ground is not None:
        ground = fence.controlled_ground, float(kept_in_m(np.array([least_m]), impact)[0])
    areas = passable(fence.areas, fence.heights_m)
    return WaysRound(ellipses, CLEAR_M, within_m, highest_m, control.law.speed_m_s, areas, ground)


def return_places_m(
    home_m: Array,
    taken_m: Array,
    over_m: float,
    spacing_m: float,
    control: ControlSettings,
    ellipses: Mapping[str, Ellipse],
    uncertainty_m: Array,
    lost: tuple[Array, Array],
    *,
    stands_m: Array = NO_STANDS_M,
) -> Array:
    """Return where returning vehicles land: at home, or if that is closed, at the nearest place.

    A lost vehicle closes a place, or an obstacle or vehicle that stands on it or beside it.

    Args:
        home_m: (n, 3) their pads, show frame.
        taken_m: (m, 2) other sites in use or assigned.
        over_m: height from which they come down.
        spacing_m: between any two landing places.
        control: fence and minimum separation.
        ellipses: obstacles that places are clear of.
        uncertainty_m: (n,) standard deviations of their positions, sideways.
        lost: as of `return_planner`.
        stands_m: (j, 2) vehicles on the ground that came down beside their pads; among `taken_m`.

    Returns: (n, 3) show frame; where no place is open, home.
    """
    floor = control.safety.floor
    closed = closed_places(home_m, over_m, floor, uncertainty_m, lost) | are_covered(home_m, ellipses)
    closed |= are_occupied(home_m, stands_m, spacing_m)
    if not closed.any():
        return np.array(home_m)
    space, are_free = space_of_lost(floor, uncertainty_m, *lost), _are_free(control, ellipses)

    def are_open(place_m: Array) -> Mask:
        above_m = place_m - (0.0, 0.0, over_m)
        apart_m = way_down_apart_m(place_m, over_m, space)
        at_once_s = np.zeros(len(place_m))
        within = beyond_m(control.safety.fence.areas, place_m[:, :2]) < 0.0
        free = are_free(place_m, at_once_s) & are_free(above_m, at_once_s)
        return np.asarray((apart_m >= 0.0) & within & free)

    return open_places_m(home_m, closed, taken_m, spacing_m, ellipses, are_open)


def _are_free(control: ControlSettings, ellipses: Mapping[str, Ellipse]) -> AreFree:
    """Return a function for which positions are inside the fence and clear of obstacles that move on."""
    fence, impact, around = control.safety.fence, control.safety.impact, tuple(ellipses.values())

    def are_free(place_m: Array, after_s: Array) -> Mask:
        height_m = -place_m[:, 2]
        free = np.hypot(place_m[:, 0], place_m[:, 1]) <= fence.distance_max_m - INSIDE_FENCE_M
        free &= height_m <= fence.height_max_m - INSIDE_FENCE_M
        free &= keep_off(fence.areas, place_m, OFF_AREAS_M)
        if fence.controlled_ground is not None:
            within = [falls_within(part_m, fence.controlled_ground, impact) for part_m in in_pieces(place_m)]
            free &= np.concatenate(within)
        for ellipse in around:
            low = np.flatnonzero(height_m < ellipse.top_height_m)
            moved_m = np.minimum(after_s[low], AHEAD_S)[:, None] * ellipse.velocity_m_s
            free[low] &= ellipse.distance_m(place_m[low, :2] - moved_m) >= CLEAR_M
        return np.asarray(free)

    return are_free
