"""Leads vehicles with goals of their own, and those far from their slots, round obstacles (decision 0064).

The tangent of one obstacle leads into the corner of several, and stops before the middle of a wide one. Each
tick takes the first corner of the shortest way: nothing is remembered, and a box that moves changes the way.
Out of the way of a box that moves, a vehicle flies straight; boxes then count as boxes, and not as ellipses.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.inputs import ControlSettings, TickInputs
from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.ways_round import (
    GAP_M,
    HORIZON_S,
    PUT_OFF_S,
    away_m,
    climb_over,
    free_s,
    is_pinched,
    passes,
    way_between,
    way_out,
    way_round,
)
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.enclosures import CREEPS_M_S, Enclosures
from gcs.safety.enclosures import warm_up as enclosures_warm_up

SPARE_M: Final = 1.0
"""A way keeps this much more than the distance at which the tangent pushes."""

BEYOND_M: Final = 2.0
"""A vehicle farther than this from a corner aims as far beyond it, a nearer one at the next place: it need
not stop there, and a corner that moves is not pursued.
"""

AHEAD_S: Final = 8.0
"""A box that moves counts where it will be when the vehicle can be there, but no later than this."""

OVER_M: Final = 1.0
"""Where no way leads round, a vehicle climbs so far above the obstacles on its straight way."""

BETWEEN_M: Final = 0.5
"""Where no way leads round the ellipses of obstacles, nor over them, a way between boxes keeps this much more
than their margins: a vehicle flies it straight, and the filter's walls are the same boxes.
"""

INSIDE_FENCE_M: Final = 1.0

OUT_SHARE: Final = 0.7
"""Share of the law's speed that counts for a vehicle on its way out: it speeds up first."""


def round_obstacles(
    now: TickInputs,
    aim_m: Array,
    aiming: NDArray[np.intp],
    slot_m: Array,
    lead: Lead,
    no_way_s: Array | None,
) -> tuple[Array, NDArray[np.intp], Mask]:
    """Where vehicles aim at, (n, 3), and which do so, (k,): as of `follow_routes`, led round obstacles.

    Vehicles that descend or follow a planned path aim where they did.

    Args:
        now: inputs of this tick.
        aim_m: (n, 3).
        aiming: (k,) rows.
        slot_m: (m, 3) of the m vehicles in formation.
        lead: the formation's centre. While it stands, a vehicle farther than the lookahead from its slot goes
            round to it; where it stands because no way leads anywhere, each vehicle finds its own.
        no_way_s: (n,) as of `without_way`: for those without a way none is looked for.

    Returns: also (n,) which fly straight there: out of the way of a box that moves, see `way_out`,
        or between boxes of which the ellipses leave no way, see `way_between`.
    """
    straight = np.zeros(len(aim_m), np.bool_)
    if not now.ellipses:
        return aim_m, aiming, straight
    outlines, fence, law = Outlines.of(now.ellipses), now.settings.safety.fence, now.settings.law
    moving, within_m = not outlines.stand.all(), fence.distance_max_m - INSIDE_FENCE_M
    goal_m, rows, go_round = _goals(now, aim_m, aiming, slot_m, lead, moving=moving)
    held = _held(now, rows, slot_m) if moving else rows[:0]
    if len(rows) + len(held) == 0:
        return aim_m, aiming, straight
    goal_m[held] = slot_m[np.searchsorted(now.rows, held)]
    aims_m, top_m = np.array(aim_m), np.array(outlines.top_height_m)
    places = np.array(outlines.center_m), np.array(outlines.velocity_m_s)
    if moving:
        some, boxes = np.concatenate([rows, held]), (*places, outlines.half_length_m)
        highest_m = fence.height_max_m - INSIDE_FENCE_M if law.avoidance.climbs else 0.0
        up_m_s = OUT_SHARE * now.settings.safety.limits.up_m_s
        out_m, leaves = _ways_out(
            now.position_m[some],
            goal_m[some],
            _soon_m(now, goal_m, lead)[some],
            np.arange(len(some)) >= len(rows),
            boxes,
            top_m,
            (OUT_SHARE * law.speed_m_s, up_m_s),
            (within_m, highest_m),
        )
        straight[some], aims_m[some[leaves]] = leaves, out_m[leaves]
    if no_way_s is not None:
        go_round &= ~np.isfinite(no_way_s)
    rows = rows[go_round[rows] & ~straight[rows]]
    round_m, led_round, straight[rows] = _aims(
        now.position_m[rows],
        goal_m[rows],
        places,
        (outlines.semi_m + law.avoidance.near_m + SPARE_M, outlines.half_length_m + BETWEEN_M),
        top_m,
        law.speed_m_s,
        (within_m, fence.height_max_m - INSIDE_FENCE_M),
        law.avoidance.climbs,
    )
    aims_m[rows[led_round]] = round_m[led_round]
    changed = np.concatenate([rows[led_round], np.flatnonzero(straight)])
    return aims_m, np.union1d(aiming, changed), straight


def _goals(
    now: TickInputs,
    aim_m: Array,
    aiming: NDArray[np.intp],
    slot_m: Array,
    lead: Lead,
    *,
    moving: bool,
) -> tuple[Array, NDArray[np.intp], Mask]:
    """(n, 3) places that vehicles fly to, (k,) rows that obstacles may hinder, (n,) which go round.

    `moving`: whether an obstacle does; the other arguments are those of `round_obstacles`.
    """
    goes_round = now.to_goal & ~now.descending
    if now.tasks.follows_planned_path is not None:
        goes_round &= ~now.tasks.follows_planned_path
    goal_m, rows = np.array(aim_m), np.flatnonzero(goes_round)
    if not (lead.stands or moving):
        return goal_m, rows, goes_round
    off_m = slot_m - now.of_formed(now.position_m)
    far = left_behind(now, slot_m, np.hypot(off_m[:, 0], off_m[:, 1]))
    formed = np.flatnonzero(np.isfinite(off_m[:, 0])) if lead.is_stuck else far
    goal_m[now.rows[formed]] = slot_m[formed]
    goes_round[now.rows[far]] |= lead.stands
    return goal_m, np.concatenate([rows, np.setdiff1d(now.rows[formed], aiming)]), goes_round


def left_behind(now: TickInputs, slot_m: Array, off_m: Array) -> NDArray[np.intp]:
    """Which of the m vehicles in formation are farther than the lookahead from slots that no obstacle covers.

    Such a vehicle goes round obstacles also while the centre stands. One with a covered slot waits there.

    Args:
        now: inputs of this tick.
        slot_m: (m, 3).
        off_m: (m,) distances to them, sideways; not finite by a law without slots.
    """
    left = np.flatnonzero(np.isfinite(off_m) & (off_m > now.settings.law.avoidance.lookahead_m))
    for ellipse in now.ellipses.values():
        left = left[ellipse.distance_m(slot_m[left]) > 0.0]
    return left


def _soon_m(now: TickInputs, goal_m: Array, lead: Lead) -> Array:
    """(n, 3) where vehicles are in `PUT_OFF_S` that follow goals (n, 3) which move with the centre."""
    course_m_s = np.zeros(3) if lead.center is None else lead.center.velocity_m_s
    ahead_m = goal_m + PUT_OFF_S * course_m_s - now.position_m
    reach_m = PUT_OFF_S * now.settings.law.speed_m_s
    away_m = np.maximum(np.linalg.norm(ahead_m, axis=1), reach_m)
    soon_m: Array = now.position_m + ahead_m * (reach_m / away_m)[:, None]
    return soon_m


def _held(now: TickInputs, rows: NDArray[np.intp], slot_m: Array) -> NDArray[np.intp]:
    """(k,) vehicles that follow their slots (m, 3), and are none of `rows`: they leave when pinched."""
    return np.setdiff1d(now.rows[np.isfinite(slot_m[:, 0])], rows)


def shut_in_by(
    ellipses: Mapping[str, Ellipse], place_m: Array, goal_m: Array, settings: ControlSettings
) -> Mask:
    """(k,) Which vehicles at (k, 3) no way leads to (k, 3), round obstacles that stand or over them.

    Obstacles that move do not count: they pass. A vehicle above an obstacle flies over it. What the fence
    closes is compared on a coarser grid of its own.
    """
    fence = settings.safety.fence
    over_m, apart = fence.height_max_m - INSIDE_FENCE_M - OVER_M, np.zeros(len(place_m), np.bool_)
    for closed in (None, fence):
        enclosures = Enclosures.of(ellipses.values(), over_m, closed, flown_m=fence.distance_max_m)
        if enclosures is not None:
            apart |= enclosures.apart(place_m, goal_m)
    return apart & (-place_m[:, 2] <= over_m)


def without_way(now: TickInputs, before_s: Array | None) -> Array | None:
    """(n,) Since when no way leads vehicles with goals of their own there, in s; inf: there may be one.

    Args:
        now: inputs of this tick.
        before_s: as of the tick before; None: each may have one.

    Returns: None without obstacles, or without such vehicles.
    """
    led = now.to_goal & ~now.descending
    if not now.plan.obstacles or not led.any():
        return None
    boxes = {box.id: now.ellipses[box.id] for box in now.plan.obstacles}
    shut = led & shut_in_by(boxes, now.position_m, now.tasks.goal_m, now.settings)
    if before_s is None or len(before_s) != len(led):
        before_s = np.full(len(led), np.inf)
    return np.where(shut, np.minimum(before_s, now.fleet.time_s), np.inf)


def waiting_places(
    now: TickInputs, no_way_s: Array | None, straight: Mask, before_m: Array | None
) -> Array | None:
    """(n, 3) Where vehicles without a way to their goals wait; NaN: it does not wait; None: no vehicle waits.

    It is where each was when that became known: one that only stopped would be carried off by gusts.

    Args:
        now: inputs of this tick.
        no_way_s: (n,) as of `without_way`.
        straight: (n,) which fly out of the way of a box that moves; after that they wait where they are then.
        before_m: (n, 3) as of the tick before, or None.
    """
    if no_way_s is None:
        return None
    waits = np.isfinite(no_way_s) & ~straight
    if not waits.any():
        return None
    place_m = np.full((len(waits), 3), np.nan)
    if before_m is not None and len(before_m) == len(waits):
        place_m[waits] = before_m[waits]
    begins = waits & np.isnan(place_m[:, 0])
    place_m[begins] = now.position_m[begins]
    return place_m


@kernel
def _ways_out(
    place_m: Array,
    goal_m: Array,
    ahead_m: Array,
    held: Mask,
    boxes: tuple[Array, Array, Array],
    top_m: Array,
    speeds_m_s: tuple[float, float],
    fence: tuple[float, float],
) -> tuple[Array, Mask]:
    """(k, 3) where vehicles at (k, 3) aim at, and (k,) which leave: a box will move over their places.

    Those `held` (k,), which else would soon be at (k, 3), leave when no way leads out of there. Where none
    is left, a vehicle climbs over in time.
    The other arguments are those of `climb_over` and `_aims`.
    """
    aim_m, leaves = goal_m.copy(), np.zeros(len(goal_m), np.bool_)
    for i in range(len(place_m)):
        height_m, here_m, there_m = -place_m[i, 2], place_m[i, :2].copy(), goal_m[i, :2].copy()
        beside = np.flatnonzero(top_m > height_m)
        among = boxes[0][beside], boxes[1][beside], boxes[2][beside]
        if held[i]:
            leaves[i] = is_pinched(here_m, ahead_m[i, :2].copy(), speeds_m_s[0], among, fence[0])
        else:
            leaves[i] = free_s(here_m, here_m, speeds_m_s[0], among) < HORIZON_S
        if not leaves[i]:
            continue
        wider = among[0], among[1], among[2] + (GAP_M if held[i] else 0.0)
        out_m, clear_s = way_out(here_m, there_m, speeds_m_s[0], wider, fence[0])
        if held[i] and clear_s < HORIZON_S:
            out_m, clear_s = way_out(here_m, there_m, speeds_m_s[0], among, fence[0])
        aim_m[i, :2] = out_m
        if clear_s < HORIZON_S:
            over_m = climb_over(here_m, out_m, speeds_m_s, among, top_m[beside] + OVER_M, height_m)
            if over_m <= fence[1]:
                aim_m[i, 2] = -over_m
    return aim_m, leaves


@kernel
def _aims(
    place_m: Array,
    goal_m: Array,
    centers: tuple[Array, Array],
    sizes: tuple[Array, Array],
    top_m: Array,
    speed_m_s: float,
    fence: tuple[float, float],
    climbs: bool,
) -> tuple[Array, Mask, Mask]:
    """(k, 3) where vehicles aim at, (k,) which of these are not their goals, (k,) which fly straight there.

    Args:
        place_m: (k, 3).
        goal_m: (k, 3).
        centers: (m, 2) of the ellipses, and their velocities.
        sizes: (m, 2) their semi-axes, with all that a way keeps, and half-lengths of their boxes, likewise.
        top_m: (m,) heights above which they need not be avoided.
        speed_m_s: of the vehicles.
        fence: greatest distance and height.
        climbs: whether a vehicle may climb over where no way leads round.
    """
    aim_m, led, semi_m = goal_m.copy(), np.zeros(len(goal_m), np.bool_), sizes[0]
    between = np.zeros(len(goal_m), np.bool_)
    stands = np.hypot(centers[1][:, 0], centers[1][:, 1]) <= CREEPS_M_S
    for i in range(len(place_m)):
        height_m, here_m, there_m = -place_m[i, 2], place_m[i, :2].copy(), goal_m[i, :2].copy()
        center_m = _later_m(here_m, *centers, speed_m_s)
        below = np.flatnonzero(top_m > height_m)
        corner_m, is_way = way_round(here_m, there_m, center_m[below], semi_m[below], fence[0])
        if len(corner_m):
            aim_m[i, :2], led[i] = _towards(here_m, corner_m, there_m), True
            continue
        highest_m = 0.0  # of those that the straight way meets
        for k in range(len(top_m)):
            if not passes(here_m, there_m, center_m[k], semi_m[k]):
                highest_m = max(highest_m, top_m[k])
        if is_way and height_m >= highest_m > -goal_m[i, 2]:  # above them, until it is past
            aim_m[i, 2], led[i] = place_m[i, 2], True
        elif not is_way and climbs and highest_m + OVER_M <= fence[1]:
            aim_m[i, :2], aim_m[i, 2], led[i] = here_m, -(highest_m + OVER_M), True
        elif not is_way:
            still = np.flatnonzero((top_m > height_m) & stands)
            moving = len(still) < len(below)
            if moving and way_round(here_m, there_m, center_m[still], semi_m[still], fence[0])[1]:
                continue  # boxes that move pass
            corner_m, between[i] = way_between(here_m, there_m, center_m[below], sizes[1][below], fence[0])
            if between[i]:
                aim_m[i, :2], led[i] = _towards(here_m, corner_m, there_m), True
    return aim_m, led, between


@kernel
def _later_m(here_m: Array, center_m: Array, velocity_m_s: Array, speed_m_s: float) -> Array:
    """(m, 2) where ellipses with these centres and velocities (m, 2) will be when a vehicle can be there."""
    later_m = center_m.copy()
    for k in range(len(center_m)):
        later_m[k] += min(away_m(here_m, center_m[k]) / speed_m_s, AHEAD_S) * velocity_m_s[k]
    return later_m


@kernel
def _towards(here_m: Array, corner_m: Array, goal_m: Array) -> Array:
    """(2,) where a vehicle aims at that flies by corners (k, 2) to a goal."""
    first = 0
    while first < len(corner_m) and away_m(here_m, corner_m[first]) <= BEYOND_M:
        first += 1
    if first == len(corner_m):
        return goal_m
    farther = 1.0 + BEYOND_M / away_m(here_m, corner_m[first])
    aim_m: Array = here_m + farther * (corner_m[first] - here_m)
    return aim_m


def warm_up() -> None:
    """Compile or load the kernels, so that nothing is compiled in flight."""
    place_m, at_m = np.zeros((1, 3)), (np.array([[5.0, 0.0]]), np.zeros((1, 2)))
    box_m, top_m = np.ones((1, 2)), np.full(1, 50.0)
    enclosures_warm_up()
    _aims(place_m, place_m + 10.0, at_m, (box_m, box_m), top_m, 5.0, (100.0, 100.0), True)
    held, fence = np.zeros(1, np.bool_), (100.0, 100.0)
    _ways_out(place_m, place_m + 10.0, place_m, held, (*at_m, box_m), top_m, (5.0, 2.0), fence)
