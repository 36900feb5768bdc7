"""Walls: obstacles, lowest and greatest height, greatest distance, and the paths of lost vehicles."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.settings import Positive, Settings
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import (
    DECELERATION,
    ESCAPE,
    LEAD,
    NO_ROW,
    REACTION,
    Braking,
    Constraints,
    allowed_speed_m_s,
    along_m_s,
    stopping_speed_m_s,
)
from gcs.safety.fenced_areas import AREAS_MAX, FencedArea, too_many
from gcs.safety.floor import Floor
from gcs.safety.impact import HEIGHT_MAX_M
from gcs.safety.neighbours import Rows

ABOVE_GROUND_M = 100.0
"""Left of the tables of impacts above the fence, for ground that falls away and vehicles that climb."""


class Fence(Settings):
    """The volume that no vehicle may leave: heights above the show's origin, and distance over the ground."""

    height_min_m: Positive = 3.0
    """Least height above the origin, unless a vehicle lands, in m."""
    height_max_m: Positive = 100.0
    """Greatest height above the origin, in m."""
    distance_max_m: Positive = 300.0
    """Greatest distance from the origin over the ground, in m."""
    areas: Annotated[tuple[FencedArea, ...], Field(max_length=AREAS_MAX)] = ()
    """Areas that no vehicle leaves, or enters; those of a drawing come with the drawing."""
    controlled_ground: FencedArea | None = None
    """Where vehicles may fall if their motors stop: no other people are on it; null: that is not kept."""

    @model_validator(mode="after")
    def _fits(self) -> "Fence":
        if why := too_many(self.areas):
            raise ValueError(f"areas: {why}")
        ground = self.controlled_ground
        if ground is None:
            return self
        if not ground.inside or ground.height_min_m is not None or ground.height_max_m is not None:
            raise ValueError("controlled_ground: inside: true, and no heights: it is ground")
        if self.height_max_m > HEIGHT_MAX_M - ABOVE_GROUND_M:
            most_m = HEIGHT_MAX_M - ABOVE_GROUND_M
            raise ValueError(
                f"height_max_m = {self.height_max_m:g}: with controlled_ground at most {most_m:g}"
            )
        return self

    @property
    def is_plain(self) -> bool:
        """Whether it has neither areas nor controlled ground."""
        return not self.areas and self.controlled_ground is None

    @property
    def heights_m(self) -> tuple[float, float]:
        """Least and greatest height of flight."""
        return self.height_min_m, self.height_max_m


def fence_constraints(
    position_m: Array,
    commanded: Mask,
    descending: Mask,
    fence: Fence,
    braking: Braking,
    *,
    velocity_m_s: Array | None = None,
    standoff_m: Array | None = None,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Bound the speed towards heights and distance of the fence to the speed that can still be braked.

    Vehicles follow a bound that falls late, and would swing beyond the fence by a fifth of a metre: the speed
    towards it that is measured now continues for `braking.lead_s`, as between vehicles.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        descending: (n,) True where a vehicle descends to land and may go below the least height.
        fence: its limits.
        braking: how vehicles stop.
        velocity_m_s: (n, 3) measured; NaN, and None: at rest.
        standoff_m: (n,) how far inside the fence each is kept; None: 0.
        response: (n,) in what they differ from that; None: in nothing.
        fastest_m_s: greatest speed of any vehicle, in any direction. Where twice this speed could still be
            braked, there is no constraint: no velocity within the limits breaks it.
    """
    n = len(position_m)
    measured_m_s = np.zeros((n, 3)) if velocity_m_s is None else np.array(velocity_m_s, order="C")
    rows, sides, normal, bound_m_s = _fence_rows(
        (np.array(position_m), measured_m_s),
        np.array(commanded),
        np.array(descending),
        (fence.height_min_m, fence.height_max_m, fence.distance_max_m),
        np.zeros(n) if standoff_m is None else np.array(standoff_m),
        braking.of_each(n, response),
        2.0 * fastest_m_s,
    )
    return Constraints(rows, np.zeros_like(rows) + NO_ROW, normal, bound_m_s, FENCE_REASONS[sides])


FENCE_REASONS = np.array(["least height", "greatest height", "greatest distance"], dtype=object)


@kernel
def _fence_rows(
    motion: tuple[Array, Array],
    commanded: Mask,
    descending: Mask,
    fence: tuple[float, float, float],
    standoff_m: Array,
    each: Array,
    possible_m_s: float,
) -> tuple[Rows, Rows, Array, Array]:
    """Rows (k,), sides of the fence (k,), inward normals (k, 3), bounds (k,) of all that could bind.

    `motion` are positions and velocities (n, 3), `each` (4, n) is that of `Braking.of_each`. Velocities that
    are not finite become 0.
    """
    position_m, velocity_m_s = motion
    height_min_m, height_max_m, distance_max_m = fence
    most = 3 * len(position_m)
    rows, sides = np.empty(most, np.intp), np.empty(most, np.intp)
    normal, bound_m_s = np.zeros((most, 3)), np.empty(most)
    kept = 0
    for i in range(len(position_m)):
        if not commanded[i]:
            continue
        for axis in range(3):
            if not np.isfinite(velocity_m_s[i, axis]):
                velocity_m_s[i, axis] = 0.0
        x_m, y_m, height_m = position_m[i, 0], position_m[i, 1], -position_m[i, 2]
        distance_m = np.sqrt(x_m * x_m + y_m * y_m)
        for side in range(3):
            if side == 0 and descending[i]:
                continue
            normal[kept, :] = 0.0
            if side == 0:
                gap_m = height_m - height_min_m
                normal[kept, 2] = -1.0
            elif side == 1:
                gap_m = height_max_m - height_m
                normal[kept, 2] = 1.0
            else:
                gap_m = distance_max_m - distance_m
                normal[kept, 0] = -x_m / max(distance_m, 1e-9)
                normal[kept, 1] = -y_m / max(distance_m, 1e-9)
            closing_m_s = max(-along_m_s(velocity_m_s, i, normal, kept), 0.0)
            gap_m -= standoff_m[i] + each[LEAD, i] * closing_m_s
            allowed_m_s = allowed_speed_m_s(gap_m, each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i])
            if not allowed_m_s <= possible_m_s:
                continue
            rows[kept], sides[kept], bound_m_s[kept] = i, side, -allowed_m_s
            kept += 1
    return rows[:kept], sides[:kept], normal[:kept], bound_m_s[:kept]


def obstacle_constraints(
    position_m: Array,
    commanded: Mask,
    ellipses: Mapping[str, Ellipse],
    braking: Braking,
    *,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Bound the speed towards each box grown by its margin and headroom, relative to the box itself.

    The law goes around the ellipse; the wall is the box inside it, which is convex: one half-space along the
    shortest way to it, also over its top and past its edges. A vehicle inside is led out the nearest way, and
    does not descend meanwhile.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        ellipses: by obstacle id; margin and headroom included.
        braking: how vehicles stop.
        response: (n,) in what they differ from that; None: in nothing.
        fastest_m_s: greatest speed of any vehicle, in any direction. Where twice this speed could still be
            braked, there is no constraint: no velocity within the limits breaks it.
    """
    if not ellipses:
        return Constraints.none()
    outlines = Outlines.of(ellipses)
    rows, which, normal, bound_m_s = _obstacle_rows(
        np.array(position_m, order="C"),
        np.array(commanded),
        outlines.center_m,
        outlines.half_length_m,
        outlines.top_height_m,
        outlines.velocity_m_s,
        braking.of_each(len(position_m), response),
        2.0 * fastest_m_s,
    )
    walls = [f"obstacle {name}" for name in outlines.names]
    reasons = np.array([*walls, *(f"{wall} below" for wall in walls)], dtype=object)
    return Constraints(rows, np.full(len(rows), NO_ROW), normal, bound_m_s, reasons[which])


@kernel
def _obstacle_rows(
    position_m: Array,
    commanded: Mask,
    center_m: Array,
    half_length_m: Array,
    top_height_m: Array,
    moving_m_s: Array,
    each: Array,
    possible_m_s: float,
) -> tuple[Rows, Rows, Array, Array]:
    """Rows (k,), boxes (k,), normals (k, 3), bounds (k,) of all that could bind.

    The ways out of the boxes come first. Then, for box j of m as m + j, no way down where a side leads out.
    `each` (4, n) is that of `Braking.of_each`.
    """
    n, m = len(position_m), len(center_m)
    outward, gap_m = nearest_way_out(position_m, center_m, half_length_m, top_height_m)
    rows, which = np.empty(2 * n * m, np.intp), np.empty(2 * n * m, np.intp)
    normal, bound_m_s = np.empty((2 * n * m, 3)), np.empty(2 * n * m)
    kept = 0
    for below in (False, True):
        for i in range(n):
            if not (commanded[i] and np.isfinite(position_m[i]).all()):
                continue
            for j in range(m):
                if below:
                    if not (gap_m[i, j] < 0.0 and outward[i, j, 2] == 0.0):
                        continue
                    rows[kept], which[kept], bound_m_s[kept] = i, m + j, 0.0
                    normal[kept, 0], normal[kept, 1], normal[kept, 2] = 0.0, 0.0, -1.0
                else:
                    drift_m_s = outward[i, j, 0] * moving_m_s[j, 0] + outward[i, j, 1] * moving_m_s[j, 1]
                    bound = drift_m_s - allowed_speed_m_s(
                        gap_m[i, j], each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i]
                    )
                    if not bound >= -possible_m_s:
                        continue
                    rows[kept], which[kept], bound_m_s[kept] = i, j, bound
                    normal[kept] = outward[i, j]
                kept += 1
    return rows[:kept], which[:kept], normal[:kept], bound_m_s[:kept]


@kernel
def nearest_way_out(
    position_m: Array, center_m: Array, half_length_m: Array, top_height_m: Array
) -> tuple[Array, Array]:
    """Unit vectors (n, m, 3) away from boxes on the ground, and the distance of each vehicle outside, (n, m).

    Inside, the way out is through the nearest side or the top, and the distance is negative.

    Args:
        position_m: (n, 3), show frame.
        center_m: (m, 2) of the boxes.
        half_length_m: (m, 2).
        top_height_m: (m,).
    """
    n, m = len(position_m), len(center_m)
    outward, gap_m = np.zeros((n, m, 3)), np.empty((n, m))
    for i in range(n):
        for j in range(m):
            x_m, y_m = position_m[i, 0] - center_m[j, 0], position_m[i, 1] - center_m[j, 1]
            beside_x, beside_y = abs(x_m) - half_length_m[j, 0], abs(y_m) - half_length_m[j, 1]
            above = -position_m[i, 2] - top_height_m[j]
            out_x, out_y, out_z = max(beside_x, 0.0), max(beside_y, 0.0), max(above, 0.0)
            away = np.sqrt(out_x * out_x + out_y * out_y + out_z * out_z)
            if away > 0.0:
                out_x, out_y, out_z = out_x / away, out_y / away, out_z / away
            else:
                away = max(beside_x, beside_y, above)
                out_x = 1.0 if beside_x == away else 0.0
                out_y = 1.0 if out_x == 0.0 and beside_y == away else 0.0
                out_z = 1.0 - out_x - out_y
            gap_m[i, j] = away
            outward[i, j, 0] = out_x if x_m >= 0.0 else -out_x
            outward[i, j, 1] = out_y if y_m >= 0.0 else -out_y
            outward[i, j, 2] = -out_z
    return outward, gap_m


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


def true_bound(slope: Array, scaled_gap_m: Array, each: Array) -> tuple[Array, Array]:
    """Unit normals (k, 3) and bounds (k,) in true metres a second.

    `slope` (k, 3) is the gradient of the scaled distance; the gap in true metres along it is the scaled
    gap divided by its length. `each` (4, k) is that of `Braking.of_each`.
    """
    length = np.linalg.norm(slope, axis=1)
    return slope / length[:, None], -stopping_speed_m_s(scaled_gap_m / length, each)
