"""The paths that lost vehicles may fly, which no other vehicle enters. Pure."""

import numpy as np

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import NO_ROW, Braking, Constraints, true_bound
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows


def keepout_constraints(
    position_m: Array,
    commanded: Mask,
    segments_m: Array,
    *,
    floor: Floor,
    braking: Braking,
    uncertainty_m: Array,
    segments_uncertainty_m: Array | None = None,
    segments_of: Rows | None = None,
    drift: tuple[Array, Array] | None = None,
    passage: Mask | None = None,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Keep the commanded vehicles away from the space that lost vehicles may sweep.

    A vehicle ahead of a lost one that still drifts is not slowed down along that drift, as the lost one
    would run into it: it leaves the paths sideways or ahead.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        segments_m: (m, 2, 3) straight pieces of the paths that lost vehicles may take.
        floor: as between vehicles.
        braking: how vehicles stop.
        uncertainty_m: (n,) standard deviations of the positions, sideways.
        segments_uncertainty_m: (m,) those of the lost vehicles; None: the widest of all.
        segments_of: (m,) row of each path's lost vehicle. A vehicle too near to one of its paths leaves that
            one; its other paths do not slow it down, as it may fly beside the lost one. None: not known.
        drift: (n, 3) expected positions and (n, 3) velocities of the lost vehicles that still drift, else
            NaN; None: of none. Needs `segments_of`.
        passage: (n,) vehicles that keep floor and reserve from the paths, without margin; None: none does.
        response: (n,) in what vehicles differ from `braking`; None: in nothing.
        fastest_m_s: as in `separation_constraints`; constraints that twice this speed cannot break are left
        out.
    """
    if len(segments_m) == 0 or not commanded.any():
        return Constraints.none()
    rows = np.flatnonzero(commanded)
    which, piece = _nearest_paths(position_m[rows] * floor.scale, segments_m * floor.scale, segments_of)
    row = rows[which]
    start, end = segments_m[piece, 0] * floor.scale, segments_m[piece, 1] * floor.scale
    along = end - start
    offset = position_m[row] * floor.scale - start
    share = (offset * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), TINY)
    scaled = offset - np.clip(share, 0.0, 1.0)[:, None] * along
    distance_m = np.linalg.norm(scaled, axis=1)
    apart = np.where(distance_m[:, None] > TINY, scaled / np.maximum(distance_m, TINY)[:, None], (1.0, 0, 0))
    onward = np.zeros_like(apart)
    if drift is not None and segments_of is not None:
        lost = segments_of[piece]
        onward = _onward(position_m[row], drift[0][lost], drift[1][lost])
        apart = _not_backward(apart, onward)
    if segments_uncertainty_m is None:
        segments_uncertainty_m = np.full(len(segments_m), np.max(uncertainty_m))
    reserve_m = floor.reserve_m(uncertainty_m[row], segments_uncertainty_m[piece])
    kept_m = floor.horizontal_m + floor.margin_m + reserve_m
    if passage is not None:
        kept_m -= floor.margin_m * passage[row]
    each = braking.of_each(len(position_m), response)[:, row]
    normal, bound_m_s = true_bound(apart * floor.scale, distance_m - kept_m, each)
    scaled_m = position_m[rows] * floor.scale
    own_kept_m = np.full((len(rows), len(segments_m)), -np.inf)
    own_kept_m[which, piece] = kept_m
    _one_way_out(normal, bound_m_s, which, scaled_m, segments_m * floor.scale, own_kept_m, onward)
    kept = bound_m_s >= -2.0 * fastest_m_s
    if segments_of is not None:
        kept &= ~_beside_a_broken_one(bound_m_s > 0.0, which, segments_of[piece])
    row, normal, bound_m_s = row[kept], normal[kept], bound_m_s[kept]
    reasons = np.full(len(row), "the path of a lost vehicle", dtype=object)
    return Constraints(row, np.full(len(row), NO_ROW), normal, bound_m_s, reasons)


OWNERS_MOST = 8
"""Lost or silent vehicles whose paths constrain one vehicle: the nearest ones. Where half of a large fleet
falls silent at once, the paths of all would take seconds, in which the other half would be lost as well.
"""


def _nearest_paths(place_m: Array, segments_m: Array, segments_of: Rows | None) -> tuple[Rows, Rows]:
    """Return (k,) places and (k,) paths that belong together, place by place: paths of the nearest owners.

    Args:
        place_m: (r, 3) in the floor's metric.
        segments_m: (m, 2, 3) likewise.
        segments_of: (m,) row of each path's owner; None: not known, all belong to every place.
    """
    owners, owner = np.unique(
        np.zeros(0, np.intp) if segments_of is None else segments_of, return_inverse=True
    )
    if len(owners) <= OWNERS_MOST:
        grid = np.meshgrid(np.arange(len(place_m)), np.arange(len(segments_m)), indexing="ij")
        return grid[0].ravel(), grid[1].ravel()
    by_owner = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[by_owner], np.arange(len(owners) + 1))
    nearest = np.sort(_nearest_owners(place_m, segments_m[by_owner], first, OWNERS_MOST), axis=1).ravel()
    count = np.diff(first)[nearest]
    places = np.repeat(np.arange(len(place_m)), OWNERS_MOST)
    begin = np.repeat(first[nearest] - np.append(0, np.cumsum(count)[:-1]), count)
    return np.repeat(places, count), by_owner[begin + np.arange(len(begin))]


def _onward(place_m: Array, lost_m: Array, velocity_m_s: Array) -> Array:
    """(k, 3) Level directions of the drifts of lost vehicles behind the places (k, 3), else zero.

    Args:
        place_m: (k, 3).
        lost_m: (k, 3) expected positions of the lost vehicles.
        velocity_m_s: (k, 3) their expected velocities; NaN or slower than DRIFTS_M_S: they do not drift.
    """
    level = np.column_stack([velocity_m_s[:, :2], np.zeros(len(velocity_m_s))])
    speed_m_s = np.linalg.norm(level, axis=1)
    ahead = (speed_m_s > DRIFTS_M_S) & (((place_m - lost_m) * level).sum(axis=1) > 0.0)
    return np.where(ahead[:, None], level / np.maximum(speed_m_s, TINY)[:, None], 0.0)


def _not_backward(apart: Array, onward: Array) -> Array:
    """Unit directions (k, 3) without their part against `onward` (k, 3); sideways where no other is left."""
    backward = np.minimum((apart * onward).sum(axis=1), 0.0)
    left = apart - backward[:, None] * onward
    length = np.linalg.norm(left, axis=1)
    sideways = np.column_stack([-onward[:, 1], onward[:, 0], onward[:, 2]])
    return np.where((length < 0.1)[:, None], sideways, left / np.maximum(length, TINY)[:, None])


def _beside_a_broken_one(broken: Mask, which: Rows, owner: Rows) -> Mask:
    """(k,) paths that are not `broken` (k,), while another one of the same owner is for the same place.

    Args:
        broken: (k,).
        which: (k,) place of each.
        owner: (k,) row of the lost vehicle whose path it is.
    """
    pair = which * (owner.max(initial=0) + 1) + owner
    beside: Mask = np.isin(pair, pair[broken]) & ~broken
    return beside


DRIFTS_M_S = 0.5
"""From this expected level velocity on a lost vehicle drifts."""

AGREED = 0.9
"""Constraints agree when the sum of their velocities is at least this share of the sum of their speeds."""

LOOK_M, LOOK_STEP_M = 15.0, 0.5
"""How far the way out of the paths is searched, and how finely."""

TURN_RAD = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
OUTWARD = np.column_stack([np.cos(TURN_RAD), np.sin(TURN_RAD), np.zeros(24)])
"""(24, 3) directions in which it is searched. Not up: a vehicle that climbs by itself comes after."""


def _one_way_out(
    normal: Array,
    bound_m_s: Array,
    constrained: Rows,
    place_m: Array,
    segments_m: Array,
    kept_m: Array,
    onward: Array,
) -> None:
    """Give all constraints of a row that require a speed away one normal and one bound, in place.

    Paths on two sides would else hold a vehicle between them: a wall of columns, or two walls. Where their
    normals contradict, the new one points the shortest straight way out of all paths, else it is their mean.

    Args:
        normal: (k, 3) of the constraints; changed.
        bound_m_s: (k,) changed.
        constrained: (k,) the row of each.
        place_m: (r, 3) of the r rows, in the floor's metric.
        segments_m: (m, 2, 3) paths, likewise.
        kept_m: (r, m) distance to be kept from each; -inf: none.
        onward: (k, 3) directions against which no way out leads; zero: there is none.
    """
    inside = np.flatnonzero(bound_m_s > 0.0)
    if len(inside) < 2:
        return
    which = constrained[inside]
    total, size, greatest_m_s = (np.zeros((len(place_m), width)) for width in (3, 1, 1))
    flown = np.zeros_like(place_m)
    np.add.at(flown, which, onward[inside])
    np.add.at(total, which, bound_m_s[inside, None] * normal[inside])
    np.add.at(size, which, bound_m_s[inside, None])
    np.maximum.at(greatest_m_s, which, bound_m_s[inside, None])
    length = np.linalg.norm(total, axis=1)
    opposed = np.flatnonzero((length < AGREED * size[:, 0]) & (size[:, 0] > 0.0))
    way = total / np.maximum(length, TINY)[:, None]
    if len(opposed):
        shortest = _shortest_ways_out(
            place_m[opposed], np.ascontiguousarray(segments_m), kept_m[opposed], OUTWARD, flown[opposed]
        )
        way[opposed] = np.where((shortest != 0.0).any(axis=1)[:, None], shortest, way[opposed])
    way[np.linalg.norm(way, axis=1) < 0.5] = (1.0, 0.0, 0.0)
    normal[inside], bound_m_s[inside] = way[which], greatest_m_s[which, 0]


@kernel
def _shortest_ways_out(
    place_m: Array, segments_m: Array, kept_m: Array, outward: Array, onward: Array
) -> Array:
    """(r, 3) of `outward` (d, 3) the direction that leads out of all paths soonest; zero: none does.

    None of them leads against `onward` (r, 3).
    """
    ways, near, off_m = np.zeros_like(place_m), np.empty(len(segments_m), np.int64), np.empty(3)
    for i in range(len(place_m)):
        count = 0
        for k in range(len(segments_m)):
            own = kept_m[i, k] > -np.inf
            if own and from_path_m(place_m[i], segments_m[k], off_m) < kept_m[i, k] + LOOK_M:
                near[count] = k
                count += 1
        best_m = LOOK_M
        for d in range(len(outward)):
            if outward[d, 0] * onward[i, 0] + outward[d, 1] * onward[i, 1] < -TINY:
                continue
            gone_m, free = LOOK_STEP_M, False
            while gone_m < best_m and not free:
                there_m = place_m[i] + gone_m * outward[d]
                free = True
                for k in near[:count]:
                    if from_path_m(there_m, segments_m[k], off_m) < kept_m[i, k]:
                        free = False
                        break
                if free:
                    best_m = gone_m
                    ways[i] = outward[d]
                gone_m += LOOK_STEP_M
    return ways


@kernel
def _nearest_owners(place_m: Array, segments_m: Array, first: Rows, most: int) -> Rows:
    """(r, most) owners with the paths nearest to each place (r, 3).

    Owner i has the paths `first[i]` to `first[i + 1]` - 1 of `segments_m` (m, 2, 3); there are at least
    `most` owners.
    """
    owners = len(first) - 1
    low_m, high_m = np.empty((owners, 3)), np.empty((owners, 3))  # boxes about their paths
    for j in range(owners):
        for axis in range(3):
            ends_m = segments_m[first[j] : first[j + 1], :, axis]
            low_m[j, axis], high_m[j, axis] = ends_m.min(), ends_m.max()
    nearest, away_m, off_m = np.empty((len(place_m), most), np.intp), np.empty(most), np.empty(3)
    for i in range(len(place_m)):
        away_m[:] = np.inf
        for j in range(owners):
            beyond_m2 = 0.0
            for axis in range(3):
                beyond_m = max(low_m[j, axis] - place_m[i, axis], place_m[i, axis] - high_m[j, axis], 0.0)
                beyond_m2 += beyond_m * beyond_m
            if beyond_m2 >= away_m[-1] * away_m[-1]:
                continue
            least_m = np.inf
            for k in range(first[j], first[j + 1]):
                least_m = min(least_m, from_path_m(place_m[i], segments_m[k], off_m))
            if least_m >= away_m[-1]:
                continue
            at = most - 1
            while at > 0 and away_m[at - 1] > least_m:
                away_m[at], nearest[i, at] = away_m[at - 1], nearest[i, at - 1]
                at -= 1
            away_m[at], nearest[i, at] = least_m, j
    return nearest


@kernel
def from_path_m(place_m: Array, segment_m: Array, off_m: Array) -> float:
    """Distance of a place (3,) from a straight path (2, 3); `off_m` (3,) is set to the way from the path."""
    along2, share, away2 = 0.0, 0.0, 0.0
    for axis in range(3):
        step_m = segment_m[1, axis] - segment_m[0, axis]
        along2 += step_m * step_m
        share += (place_m[axis] - segment_m[0, axis]) * step_m
    share = min(max(share / max(along2, TINY), 0.0), 1.0)
    for axis in range(3):
        on_m = segment_m[0, axis] + share * (segment_m[1, axis] - segment_m[0, axis])
        off_m[axis] = place_m[axis] - on_m
        away2 += off_m[axis] ** 2
    away_m: float = np.sqrt(away2)
    return away_m
