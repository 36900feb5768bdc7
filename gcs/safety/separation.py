"""Constraints between vehicles: how fast two may close in."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel, kernel_within
from gcs.model.response import FleetResponse
from gcs.model.state import TINY, Array, Mask
from gcs.safety.binding_pairs import Worst, pairs_that_could_bind
from gcs.safety.constraints import (
    DECELERATION,
    ESCAPE,
    LEAD,
    NO_ROW,
    REACTION,
    Braking,
    allowed_speed_m_s,
)
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows
from gcs.safety.passing import best_plane


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """k constraints between vehicles, as `Constraints`, without reasons. Owns its arrays."""

    first: Rows  # (k,) row i, commanded
    second: Rows  # (k,) row j if it is commanded, else NO_ROW
    other: Rows  # (k,) row j
    normal: Array  # (k, 3)
    bound_m_s: Array  # (k,)

    def __len__(self) -> int:
        return len(self.first)

    def joined(self, others: "Pairs") -> "Pairs":
        """These, then others."""
        return Pairs(
            np.concatenate([self.first, others.first]),
            np.concatenate([self.second, others.second]),
            np.concatenate([self.other, others.other]),
            np.concatenate([self.normal, others.normal]),
            np.concatenate([self.bound_m_s, others.bound_m_s]),
        )

    def not_in(self, others: "Pairs", count: int) -> "Pairs":
        """Return the pairs, of `count` vehicles, that are not among `others`."""
        new = _not_among(self.first, self.other, others.first, others.other, count)
        return Pairs(
            self.first[new], self.second[new], self.other[new], self.normal[new], self.bound_m_s[new]
        )


@kernel
def _not_among(first: Rows, other: Rows, known_first: Rows, known_other: Rows, count: int) -> Mask:
    """(k,) which pairs of rows, of `count`, are not among the known ones (m,), in either order."""
    pair, new = np.empty(len(first), np.intp), np.ones(len(first), np.bool_)
    for k in range(len(first)):
        pair[k] = min(first[k], other[k]) * count + max(first[k], other[k])
    order = np.argsort(pair)
    pair = pair[order]
    for k in range(len(known_first)):
        key = min(known_first[k], known_other[k]) * count + max(known_first[k], known_other[k])
        place = np.searchsorted(pair, key)
        if place < len(pair) and pair[place] == key:
            new[order[place]] = False
    return new


def separation_constraints(
    position_m: Array,
    velocity_m_s: Array,
    commanded: Mask,
    airborne: Mask,
    *,
    floor: Floor,
    braking: Braking,
    uncertainty_m: Array,
    course_m_s: Array,
    spare_m_s: Array,
    wander_m: Array | None = None,
    only: Mask | None = None,
    drawn: Mask | None = None,
    desired_m_s: Array | None = None,
    response: FleetResponse | None = None,
    low_counts: Mask | None = None,
    goes: Mask | None = None,
) -> Pairs:
    """Bound the closing speed of every pair that could come too close to the speed that can still be braked.

    Where both are commanded, both are restrained, as the projection finds cheapest. Where one is not (held by
    its autopilot, flown by a pilot), the other gives way completely to its measured velocity. The speed is
    bounded along the line between both; of two on drawn trajectories across the best plane, see `passing`.

    Args:
        position_m: (n, 3), show frame; NaN rows take no part.
        velocity_m_s: (n, 3) measured. Its closing part continues for ``braking.lead_s``.
        commanded: (n,) True where this tick sends a setpoint, or another station that keeps apart likewise.
        airborne: (n,) True where a vehicle is in the air or may be.
        floor: ellipsoid and margin.
        braking: how vehicles stop.
        uncertainty_m: (n,) standard deviations of the positions, sideways.
        course_m_s: (n, 3) velocities of the commanded vehicles that are checked: at first, those desired.
        spare_m_s: (n,) by how much each velocity may come to differ from that. Pairs whose constraint no such
            velocities break are left out.
        wander_m: (n,) standard deviations of where velocities that are not commanded lead, in any direction;
            pairs in the air keep farther apart by them. None: nowhere.
        only: (n,) pairs without one of these may also be left out.
        drawn: (n,) commanded here, on drawn trajectories; None: none of them.
        desired_m_s: (n, 3) velocities for which planes are chosen; None: `course_m_s`.
        response: (n,) in what vehicles differ from `braking`; None: in nothing. A pair stops as the slower
            of both.
        low_counts: (n,) kept apart from others on and near the ground as well: it does not land. A pair of
            others, both below `floor.pad_height_m`, is left out, as pads are near; None: all are such.
        goes: (n,) on the way to goals of their own. Of these, one behind a vehicle that is not commanded
            expects that to stop: the speed that both share counts for `braking.follow_s`. None: none are.
    """
    # numba compiles frozen arrays as another type
    position_m, uncertainty_m = np.array(position_m), np.array(uncertainty_m)
    commanded, airborne = np.array(commanded), np.array(airborne)
    wander_m = np.zeros(len(position_m)) if wander_m is None else np.array(wander_m)
    return Pairs(
        *_found(
            position_m,
            np.array(velocity_m_s),
            np.array(course_m_s),
            np.array(course_m_s if desired_m_s is None else desired_m_s),
            spare_m_s,
            commanded,
            airborne,
            uncertainty_m,
            wander_m,
            np.ones(len(position_m), np.bool_) if only is None else only,
            np.zeros(len(position_m), np.bool_) if drawn is None else drawn & airborne,
            np.zeros(len(position_m), np.bool_) if low_counts is None else low_counts,
            np.zeros(len(position_m), np.bool_) if goes is None else np.array(goes),
            braking.of_each(len(position_m), response),
            _numbers_of(floor, braking.follow_s),
        )
    )


Numbers: TypeAlias = tuple[float, float, float, float, float, float, float, float]
"""Floor (sideways, up, factor of uncertainty up, pad height), one vehicle's part of the margin (sideways,
up), the deviations that a margin covers, and for how long the speed counts that one shares with
another, not commanded, in front of it.
"""


WIDER = 1.0 + 1e-9
"""For the rounding of these quotients."""


def _numbers_of(floor: Floor, follow_s: float) -> Numbers:
    own_m = floor.margin_m / 2.0
    return (
        *floor.kept_m(0.0),
        floor.vertical_uncertainty,
        floor.pad_height_m,
        own_m,
        own_m * floor.vertical_m / floor.horizontal_m,
        floor.deviations,
        follow_s,
    )


@kernel
def _looks(
    position_m: Array,
    velocity_m_s: Array,
    commanded: Mask,
    uncertainty_m: Array,
    wander_m: Array,
    course_m_s: Array,
    spare_m_s: Array,
    each: Array,
    numbers: Numbers,
) -> tuple[Mask, Array, Array, Array, Array, Array, Worst]:
    """Which vehicles are known, their velocities, and where and how far to search for pairs that could bind.

    With the ellipsoid made a sphere by a factor f of heights, the gap is at least the distance to the sphere,
    divided by f where f is above 1. Every pair's f is between `thin` and `thick`; `thin` makes no distance
    too long. Each is searched for as if all stopped as the slowest in `each` (4, n).

    Returns: (n,) known, (n, 3) measured, (n, 3) course, (n,) spare, (n, 3) positions, (n,) half distances, m;
        and what holds for every pair.
    """
    wide_m, deviations, follow_s, n = numbers[0], numbers[6], numbers[7], len(position_m)
    reaction_s, lead_s, deceleration_m_s2 = 0.0, 0.0, np.inf
    for i in range(n):
        reaction_s, lead_s = max(reaction_s, each[REACTION, i]), max(lead_s, each[LEAD, i])
        deceleration_m_s2 = min(deceleration_m_s2, each[DECELERATION, i])
    is_known, measured, course = np.empty(n, np.bool_), velocity_m_s.copy(), course_m_s.copy()
    spare, look_m, place_m, mean = np.zeros(n), np.empty(n), position_m.copy(), np.zeros(3)
    thin, thick = _flatness(uncertainty_m, wander_m, numbers)
    for i in range(n):
        is_known[i] = True
        for k in range(3):
            is_known[i] &= np.isfinite(position_m[i, k])
            if not np.isfinite(measured[i, k]):
                measured[i, k] = 0.0  # unknown: others at least keep away
            if not commanded[i]:
                course[i, k] = measured[i, k]
            if np.isfinite(course[i, k]):
                mean[k] += course[i, k] / n  # the common velocity brings no pair closer
        spare[i] = spare_m_s[i] if commanded[i] else 0.0
    for i in range(n):
        drift2, stray2, speed2 = 0.0, 0.0, 0.0
        for k in range(3):
            speed2 += 0.0 if commanded[i] else measured[i, k] ** 2
            drift2 += (measured[i, k] - mean[k]) ** 2
            stray2 += (course[i, k] - mean[k]) ** 2
        stray_m_s = np.sqrt(stray2) + spare[i]
        reach_m = stray_m_s * reaction_s + stray_m_s**2 / deceleration_m_s2 + lead_s * np.sqrt(drift2)
        reach_m += follow_s * np.sqrt(speed2)  # what another shares with it is no more
        margin_m = deviations * (uncertainty_m[i] + wander_m[i])  # two are at least their hypotenuse
        look_m[i] = wide_m / 2.0 + margin_m + max(thick, 1.0) * reach_m + TINY
        if np.isnan(look_m[i]):
            look_m[i] = np.inf  # what is not known is searched for everywhere: NaN would hide all pairs
        place_m[i, 2] *= thin
    worst = thin, thick, reaction_s, lead_s, deceleration_m_s2
    return is_known, measured, course, spare, place_m, look_m, worst


@kernel
def _flatness(uncertainty_m: Array, wander_m: Array, numbers: Numbers) -> tuple[float, float]:
    """The least and the greatest quotient of the semi-axes, sideways by up, of all pairs there may be.

    Growing uncertainty moves it one way only, and so does growing wander.
    """
    wide_m, tall_m, taller, _, own_wide_m, own_tall_m, deviations, _ = numbers
    thin, thick = np.inf, 0.0
    if len(uncertainty_m) == 0:
        return 1.0, 1.0
    surest_m, least_sure_m = np.sqrt(2.0) * deviations * uncertainty_m.min(), uncertainty_m.max()
    for unsure_m in (surest_m, np.sqrt(2.0) * deviations * least_sure_m):
        for led_m in (0.0, np.sqrt(2.0) * deviations * wander_m.max()):
            for stands in (0.0, 1.0):
                across_m = wide_m + unsure_m + led_m - stands * own_wide_m
                flat = across_m / (tall_m + taller * unsure_m + led_m - stands * own_tall_m)
                if not np.isfinite(flat):  # of the floor, of uncertainty, and of wander alone
                    return min(wide_m / tall_m, 1.0 / taller, 1.0), max(wide_m / tall_m, 1.0 / taller, 1.0)
                thin, thick = min(thin, flat), max(thick, flat)
    return thin / WIDER, thick * WIDER


@kernel
def _found(
    position_m: Array,
    velocity_m_s: Array,
    course_m_s: Array,
    desired_m_s: Array,
    spare_m_s: Array,
    commanded: Mask,
    airborne: Mask,
    uncertainty_m: Array,
    wander_m: Array,
    only: Mask,
    drawn: Mask,
    low_counts: Mask,
    goes: Mask,
    each: Array,
    numbers: Numbers,
) -> tuple[Rows, Rows, Rows, Array, Array]:
    """As `separation_constraints`."""
    is_known, measured_m_s, course_m_s, spare_m_s, place_m, look_m, worst = _looks(
        position_m,
        velocity_m_s,
        commanded,
        uncertainty_m,
        wander_m,
        course_m_s,
        spare_m_s,
        each,
        numbers,
    )
    motion = position_m, course_m_s, measured_m_s
    bounding = _bounding(measured_m_s, uncertainty_m, wander_m, spare_m_s, commanded, numbers)
    first, second = pairs_that_could_bind(
        commanded & only, is_known, place_m, look_m, motion, bounding, worst
    )
    count = len(first)
    rows, shared, others = np.empty(count, np.intp), np.empty(count, np.intp), np.empty(count, np.intp)
    normals, bounds_m_s = np.empty((count, 3)), np.empty(count)
    sides, seen = np.empty((2, BLOCK), np.intp), np.empty((PAIR_ROWS, BLOCK))
    answers, kept = np.empty((5, BLOCK)), 0
    own = uncertainty_m, wander_m, spare_m_s
    about, done = _side_by_side(first, second, (*motion, desired_m_s), own, each), 0
    masks = commanded, airborne, low_counts, goes
    while done < count:
        many, done = _relative(first, second, done, about, masks, numbers[3], numbers[7], sides, seen)
        _answers(many, seen, numbers, answers)
        for k in range(many):
            if answers[0, k] > answers[1, k]:
                continue
            i, j = sides[0, k], sides[1, k]
            x, y, z, allowed_m_s = answers[2, k], answers[3, k], answers[4, k], answers[0, k]
            x_m_s, y_m_s, z_m_s = seen[DESIRED, k], seen[DESIRED + 1, k], seen[DESIRED + 2, k]
            if drawn[i] and drawn[j] and allowed_m_s + x * x_m_s + y * y_m_s + z * z_m_s < 0.0:
                _, allowed_m_s, (x, y, z) = best_plane(
                    (seen[OFFSET, k], seen[OFFSET + 1, k], seen[OFFSET + 2, k]),
                    (x_m_s, y_m_s, z_m_s),
                    (seen[MEASURED, k], seen[MEASURED + 1, k], seen[MEASURED + 2, k]),
                    _pair_size_m(k, seen, numbers),
                    (seen[REACTS, k], seen[LATER, k], seen[BRAKES, k], seen[ESCAPES, k]),
                )
                apart_m_s = x * seen[COURSE, k] + y * seen[COURSE + 1, k] + z * seen[COURSE + 2, k]
                if allowed_m_s + apart_m_s > seen[SPARE, k]:
                    continue
            rows[kept], others[kept] = i, j
            shared[kept] = j if commanded[j] else NO_ROW
            normals[kept, 0], normals[kept, 1], normals[kept, 2] = x, y, z
            theirs_m_s = x * measured_m_s[j, 0] + y * measured_m_s[j, 1] + z * measured_m_s[j, 2]
            bounds_m_s[kept] = -allowed_m_s if commanded[j] else theirs_m_s - allowed_m_s
            kept += 1
    return rows[:kept], shared[:kept], others[:kept], normals[:kept], bounds_m_s[:kept]


OFFSET, COURSE, MEASURED, DESIRED, UNSURE, LED, SPARE, STANDS = 0, 3, 6, 9, 12, 13, 14, 15
REACTS, LATER, BRAKES, ESCAPES, FLOWN, SHARES, PAIR_ROWS = 16, 17, 18, 19, 20, 23, 24
"""Rows of `_relative`. Of i relative to j, three rows each: offset,
course that is checked, measured and desired velocity. Squares of uncertainty and wander; spare speed; whether
one of both stands; reaction, lead, deceleration and escape rate of the slower one; three rows of the measured
velocity of i; for how long the speed counts that i shares with j in front of it.
"""

BLOCK = 128
"""Near pairs that are computed at a time: few enough to stay in the processor's nearest memory."""

BACKS_M_S = 2.0
"""Behind another that may stop, what a vehicle shares with it asks for no more than to back off so fast."""

OWN_UNCERTAINTY, OWN_WANDER, OWN_SPARE, STOPS, WIDE = 12, 13, 14, 15, 19
"""Columns of `_side_by_side` after those of a pair's first rows, and their number."""


@kernel
def _side_by_side(
    first: Rows,
    second: Rows,
    motion: tuple[Array, Array, Array, Array],
    own: tuple[Array, Array, Array],
    each: Array,
) -> Array:
    """(n, WIDE) all that a pair needs of a vehicle, in one place of memory: pairs are in no order.

    Rows in no pair are not written.

    Args:
        first: (k,) rows.
        second: (k,) rows.
        motion: positions, course, measured and desired velocities, (n, 3) each.
        own: uncertainty, wander and spare speed, (n,) each.
        each: (4, n) as of `Braking.of_each`.
    """
    (position_m, course_m_s, measured_m_s, desired_m_s), (uncertainty_m, wander_m, spare_m_s) = motion, own
    about, in_pair = np.empty((len(position_m), WIDE)), np.zeros(len(position_m), np.bool_)
    for k in range(len(first)):
        in_pair[first[k]], in_pair[second[k]] = True, True
    for i in range(len(position_m)):
        if not in_pair[i]:
            continue
        for axis in range(3):
            about[i, OFFSET + axis] = position_m[i, axis]
            about[i, COURSE + axis] = course_m_s[i, axis]
            about[i, MEASURED + axis] = measured_m_s[i, axis]
            about[i, DESIRED + axis] = desired_m_s[i, axis]
        about[i, OWN_UNCERTAINTY], about[i, OWN_WANDER] = uncertainty_m[i], wander_m[i]
        about[i, OWN_SPARE] = spare_m_s[i]
        for k in range(4):
            about[i, STOPS + k] = each[k, i]
    return about


@kernel
def _bounding(
    measured_m_s: Array,
    uncertainty_m: Array,
    wander_m: Array,
    spare_m_s: Array,
    commanded: Mask,
    numbers: Numbers,
) -> tuple[Array, Array, Array]:
    """What `pairs_that_could_bind` is given of each vehicle, (n,) each; arguments as of `_looks`."""
    wide_m, deviations, follow_s = numbers[0], numbers[6], numbers[7]
    size_m, shared_m = np.empty(len(commanded)), np.zeros(len(commanded))
    for i in range(len(commanded)):
        size_m[i] = wide_m / 2.0 + deviations * (uncertainty_m[i] + wander_m[i])
        x, y, z = measured_m_s[i, 0], measured_m_s[i, 1], measured_m_s[i, 2]
        if not commanded[i]:
            shared_m[i] = follow_s * np.sqrt(x * x + y * y + z * z)
    return size_m, spare_m_s, shared_m


@kernel
def _relative(
    first: Rows,
    second: Rows,
    done: int,
    about: Array,
    masks: tuple[Mask, Mask, Mask, Mask],
    pad_height_m: float,
    follow_s: float,
    sides: NDArray[np.intp],
    seen: Array,
) -> tuple[int, int]:
    """Write what `_answers` needs of the next pairs that count, of (k,), and their rows.

    Args:
        first: (k,) rows.
        second: (k,) rows.
        done: so many pairs were looked at before.
        about: (n, WIDE) of `_side_by_side`.
        masks: commanded, airborne, which count on and near the ground, and which fly to goals, (n,) each.
        pad_height_m: below this height both may be on their pads.
        follow_s: for how long the speed counts that a vehicle shares with one ahead that holds.
        sides: (2, BLOCK) rows i, commanded, and j; changed.
        seen: (PAIR_ROWS, BLOCK) changed.

    Returns: how many count, and how many pairs were looked at then.
    """
    commanded, airborne, low_counts, goes = masks
    many = 0
    for k in range(done, len(first)):
        if many == BLOCK:
            return many, k
        i, j = first[k], second[k]
        if not commanded[i]:
            i, j = j, i
        low = -about[i, OFFSET + 2] < pad_height_m and -about[j, OFFSET + 2] < pad_height_m
        low = low and not (low_counts[i] or low_counts[j])
        if low or not commanded[i] or not (airborne[i] or airborne[j]):
            continue
        mine_m, theirs_m = about[i, OWN_UNCERTAINTY], about[j, OWN_UNCERTAINTY]
        spare_m_s = about[i, OWN_SPARE] + about[j, OWN_SPARE]
        shared_s = follow_s if goes[i] and not commanded[j] else 0.0
        one_stands, led_m2 = 0.0, about[i, OWN_WANDER] ** 2 + about[j, OWN_WANDER] ** 2
        # A vehicle that stands has no tracking error, and its receiver keeps no other from its pad.
        if not (airborne[i] and airborne[j]):
            one_stands, led_m2 = 1.0, 0.0
            if airborne[i]:
                theirs_m = min(theirs_m, mine_m)
            else:
                mine_m = min(mine_m, theirs_m)
        sides[0, many], sides[1, many] = i, j
        for column in range(UNSURE):  # position, course, measured, desired
            seen[column, many] = about[i, column] - about[j, column]
        for axis in range(3):
            seen[FLOWN + axis, many] = about[i, MEASURED + axis]
        seen[SHARES, many] = shared_s
        seen[UNSURE, many], seen[LED, many] = mine_m**2 + theirs_m**2, led_m2
        seen[SPARE, many], seen[STANDS, many] = spare_m_s, one_stands
        seen[REACTS, many] = max(about[i, STOPS + REACTION], about[j, STOPS + REACTION])
        seen[LATER, many] = max(about[i, STOPS + LEAD], about[j, STOPS + LEAD])
        seen[BRAKES, many] = min(about[i, STOPS + DECELERATION], about[j, STOPS + DECELERATION])
        seen[ESCAPES, many] = min(about[i, STOPS + ESCAPE], about[j, STOPS + ESCAPE])
        many += 1
    return many, len(first)


@kernel
def _answers(many: int, seen: Array, numbers: Numbers, answers: Array) -> None:
    """Speeds (BLOCK,) at which `many` pairs may close in, at which they could, and unit normals (3, BLOCK).

    Without branches, so that it is vectorised. `seen` is that of `_relative`.
    """
    for k in range(many):
        pair_wide_m, pair_tall_m = _pair_size_m(k, seen, numbers)
        offset_m = seen[OFFSET, k], seen[OFFSET + 1, k], seen[OFFSET + 2, k]
        gap_m, x, y, z = _gap(*offset_m, pair_wide_m, pair_tall_m)
        closing_m_s = -(x * seen[MEASURED, k] + y * seen[MEASURED + 1, k] + z * seen[MEASURED + 2, k])
        behind_m_s = -(x * seen[FLOWN, k] + y * seen[FLOWN + 1, k] + z * seen[FLOWN + 2, k])
        front_m_s = max(behind_m_s - closing_m_s, 0.0)
        gap_m -= seen[LATER, k] * max(closing_m_s, 0.0)
        backs_m = min(gap_m, -(front_m_s + BACKS_M_S) / seen[ESCAPES, k])
        gap_m = max(gap_m - seen[SHARES, k] * max(min(behind_m_s, front_m_s), 0.0), backs_m)
        answers[0, k] = allowed_speed_m_s(gap_m, seen[REACTS, k], seen[BRAKES, k], seen[ESCAPES, k])
        apart_m_s = x * seen[COURSE, k] + y * seen[COURSE + 1, k] + z * seen[COURSE + 2, k]
        answers[1, k] = seen[SPARE, k] - apart_m_s
        answers[2, k], answers[3, k], answers[4, k] = x, y, z


@kernel_within
def _pair_size_m(k: int, seen: Array, numbers: Numbers) -> tuple[float, float]:
    """Semi-axes, sideways and up, that pair k of `seen` keeps."""
    wide_m, tall_m, taller, _, own_wide_m, own_tall_m, deviations, _ = numbers
    unsure_m, led_m = deviations * np.sqrt(seen[UNSURE, k]), deviations * np.sqrt(seen[LED, k])
    return (
        wide_m + unsure_m + led_m - seen[STANDS, k] * own_wide_m,
        tall_m + taller * unsure_m + led_m - seen[STANDS, k] * own_tall_m,
    )


@kernel
def _gap(x: float, y: float, z: float, wide_m: float, tall_m: float) -> tuple[float, float, float, float]:
    """Distance in true metres from (x, y, z) to the ellipsoid about 0, along the unit normal that follows."""
    flat = wide_m / tall_m
    z *= flat
    scaled_m = np.sqrt(x * x + y * y + z * z)
    z *= flat
    share = 1.0 / np.sqrt(x * x + y * y + z * z)
    if scaled_m < TINY:
        return -tall_m, 0.0, 0.0, 1.0
    return (scaled_m - wide_m) * scaled_m * share, share * x, share * y, share * z
