"""Which pairs of vehicles could come too close: many at a time, in single precision, and rather too many.

In a crowd tens of thousands of pairs are near each other, and a few thousand of them close in. What is left
is computed exactly in `separation`.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel, kernel_in_any_order
from gcs.model.state import Array, Mask
from gcs.safety.neighbours import CELLS_MAX, FEW, WIDER, Rows, cell_of, sorted_into_cells

Worst: TypeAlias = tuple[float, float, float, float, float]
"""What holds for every pair: the least and greatest quotient of its semi-axes, sideways by up, the longest
reaction and lead, and the least deceleration.
"""

Singles: TypeAlias = NDArray[np.float32]

SLACK_M, SLACK_SHARE = 1e-3, 1e-5
"""Pairs that are clear by less are kept, and by less than this share of the fleet's extent: for rounding."""

LEAST_M2 = 1e-12
"""Square of the least distance: nearer vehicles have no direction."""

WHOLE = 2_000
"""With more vehicles than this a vehicle is not compared with all of its slabs of cells, but with the strips
within reach.
"""

ROOM = 8
"""Pairs per vehicle for which memory is allocated first; with more pairs it is doubled."""


@kernel
def pairs_that_could_bind(
    some: Mask,
    takes_part: Mask,
    place_m: Array,
    look_m: Array,
    motion: tuple[Array, Array, Array],
    own: tuple[Array, Array, Array],
    worst: Worst,
) -> tuple[Rows, Rows]:
    """Rows (k,) and (k,) of pairs that velocities within their spare could bring too close; each pair once.

    There may be others among them. Their order is that of `near_pairs`.

    Args:
        some: (n,) pairs without one of these are left out.
        takes_part: (n,) the positions of these are finite.
        place_m: (n, 3) positions in which distances are no longer than they count for any pair.
        look_m: (n,) in these, pairs farther apart than the sum of both do not bind.
        motion: positions, course that is checked and measured velocities, (n, 3) each.
        own: (n,) each: no less than a vehicle's part of the semi-axis sideways; by how much its velocity may
            differ from its course; how many metres its velocity takes from the gap to one behind it.
        worst: what holds for every pair.
    """
    if len(place_m) <= FEW:
        rows, cells = np.flatnonzero(takes_part), (np.zeros(1, np.intp), np.zeros(3), 1.0, 0)
    else:
        rows, start, low_m, cell_m, across = sorted_into_cells(place_m, takes_part, look_m)
        cells = (start, low_m, cell_m, across)
    count, is_some = len(rows), some[rows]
    each, slack_m = _side_by_side(rows, motion, own)
    every, longest_m = is_some.all(), look_m[rows].max() if count else 0.0
    first, second = np.empty(ROOM * count + 1, np.intp), np.empty(ROOM * count + 1, np.intp)
    spans, over_m, written = np.empty((CELLS_MAX + 1, 2), np.intp), np.empty(count, np.float32), 0
    for a in range(count):
        if not is_some[a]:
            continue
        while written + count > len(first):
            first, second = np.append(first, first), np.append(second, second)
        far_m = (look_m[rows[a]] + longest_m) * WIDER
        for span in range(_write_spans(place_m[rows[a]], far_m, cells, count, spans)):
            begin, end = max(spans[span, 0], every * (a + 1)), spans[span, 1]
            if begin < end:
                _write_over(each, a, begin, end, worst, slack_m, over_m)
            for b in range(begin, end):
                if not over_m[b - begin] < 0.0 and (b > a or not is_some[b]):
                    first[written], second[written] = rows[a], rows[b]
                    written += 1
    return first[:written], second[:written]


COURSE, MEASURED, SIZE, SPARE, SHARED, WIDE = 3, 6, 9, 10, 11, 12
"""Rows of what is compared: three rows each of position, course and measured velocity, then one each."""


@kernel
def _side_by_side(
    rows: Rows, motion: tuple[Array, Array, Array], own: tuple[Array, Array, Array]
) -> tuple[Singles, float]:
    """(WIDE, m) what is compared of those rows (m,), and what is added for rounding, m."""
    (position_m, course_m_s, measured_m_s), (size_m, spare_m_s, shared_m) = motion, own
    each, middle_m, extent_m = np.empty((WIDE, len(rows)), np.float32), np.zeros(3), 0.0
    for i in rows:
        for axis in range(3):
            middle_m[axis] += position_m[i, axis] / len(rows)
    for a in range(len(rows)):
        i = rows[a]
        for axis in range(3):
            off_m = position_m[i, axis] - middle_m[axis]
            extent_m = max(extent_m, abs(off_m))
            each[axis, a] = off_m
            each[COURSE + axis, a], each[MEASURED + axis, a] = course_m_s[i, axis], measured_m_s[i, axis]
        is_finite = np.isfinite(course_m_s[i, 0] + course_m_s[i, 1] + course_m_s[i, 2])
        each[SIZE, a] = size_m[i] if is_finite else np.inf  # what is not known is kept
        each[SPARE, a], each[SHARED, a] = spare_m_s[i], shared_m[i]
    return each, SLACK_M + SLACK_SHARE * extent_m


@kernel
def _write_spans(
    place_m: Array, far_m: float, cells: tuple[Rows, Array, float, int], count: int, spans: Rows
) -> int:
    """Write from where to where, in the order of the cells, all are that are nearer than `far_m`.

    Of up to `WHOLE` vehicles it is one span; of more, one for each slab of cells.

    Args:
        place_m: (3,).
        far_m: the spans may hold others as well.
        cells: start of each cell, low corner (3,), width and number along an axis; 0: there are none.
        count: of vehicles in them.
        spans: (CELLS_MAX + 1, 2) changed.

    Returns: how many spans.
    """
    start, low_m, cell_m, across = cells
    if across == 0:
        spans[0, 0], spans[0, 1] = 0, count
        return 1
    from_x = cell_of(place_m[0] - far_m, low_m[0], cell_m, across)
    to_x = cell_of(place_m[0] + far_m, low_m[0], cell_m, across) + 1
    if count <= WHOLE:
        spans[0, 0], spans[0, 1] = start[from_x * across * across], start[to_x * across * across]
        return 1
    from_y = cell_of(place_m[1] - far_m, low_m[1], cell_m, across)
    to_y = cell_of(place_m[1] + far_m, low_m[1], cell_m, across) + 1
    for x in range(from_x, to_x):
        spans[x - from_x, 0] = start[(x * across + from_y) * across]
        spans[x - from_x, 1] = start[(x * across + to_y) * across]
    return to_x - from_x


@kernel_in_any_order
def _write_over(
    each: Singles, a: int, begin: int, end: int, worst: Worst, slack_m: float, over_m: Singles
) -> None:
    """Write by how much the pairs of `a` with those from `begin` to `end` could be too close, m.

    Negative: no velocities within their spare break the pair's bound. The ellipsoid that a pair keeps is
    between two: of the least and of the greatest quotient of semi-axes.

    Args:
        each: (WIDE, m) what is compared.
        a: the vehicle.
        begin: the first that it is compared with.
        end: the one after the last.
        worst: what holds for every pair.
        slack_m: added, for rounding.
        over_m: (m,) changed: from the first element on.
    """
    single = np.float32
    thin, thick, reaction_s, lead_s, deceleration_m_s2 = worst
    thin2, thick2, none, half = single(thin * thin), single(thick * thick), single(0.0), single(0.5)
    flat2, tall2, least_m2 = single(thin**4), single(thick**4), single(LEAST_M2)
    later_s, lasts_s, slack = single(reaction_s), single(lead_s), single(slack_m)
    per_m_s2, grown = single(1.0 / deceleration_m_s2), single(max(thick, 1.0))
    x_m, y_m, z_m = each[0, a], each[1, a], each[2, a]
    x_m_s, y_m_s, z_m_s = each[COURSE, a], each[COURSE + 1, a], each[COURSE + 2, a]
    u_m_s, v_m_s, w_m_s = each[MEASURED, a], each[MEASURED + 1, a], each[MEASURED + 2, a]
    own_m, own_m_s, own_shared_m = each[SIZE, a], each[SPARE, a], each[SHARED, a]
    x_of, y_of, z_of = each[0, begin:end], each[1, begin:end], each[2, begin:end]
    x_to, y_to, z_to = each[COURSE, begin:end], each[COURSE + 1, begin:end], each[COURSE + 2, begin:end]
    u_of, v_of, w_of = each[MEASURED, begin:end], each[MEASURED + 1, begin:end], each[MEASURED + 2, begin:end]
    size_of, spare_of, shared_of = each[SIZE, begin:end], each[SPARE, begin:end], each[SHARED, begin:end]
    for b in range(end - begin):
        dx, dy, dz = x_m - x_of[b], y_m - y_of[b], z_m - z_of[b]
        level_m2, high_m2 = dx * dx + dy * dy, dz * dz
        per_near = single(1.0) / np.sqrt(max(level_m2 + flat2 * high_m2, least_m2))
        per_far = single(1.0) / np.sqrt(max(level_m2 + tall2 * high_m2, least_m2))
        upright = dz * (z_m_s - z_to[b])
        apart = dx * (x_m_s - x_to[b]) + dy * (y_m_s - y_to[b]) + min(thin2 * upright, thick2 * upright)
        needed_m_s = max(own_m_s + spare_of[b] - min(apart * per_near, apart * per_far), none)
        upright = dz * (w_m_s - w_of[b])
        apart = dx * (u_m_s - u_of[b]) + dy * (v_m_s - v_of[b]) + min(thin2 * upright, thick2 * upright)
        used_m = lasts_s * max(-apart * per_near, none) + max(own_shared_m, shared_of[b])
        used_m += needed_m_s * (later_s + half * per_m_s2 * needed_m_s)
        away_m = np.sqrt(level_m2 + thin2 * high_m2)
        over_m[b] = grown * used_m + own_m + size_of[b] + slack - away_m
