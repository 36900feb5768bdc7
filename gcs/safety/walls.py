"""Walls: obstacles, lowest and greatest height, and greatest distance."""

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.model.jit import kernel, kernel_within
from gcs.model.response import FleetResponse
from gcs.model.settings import Positive, Settings
from gcs.model.state import Array, Mask
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
)
from gcs.safety.fenced_areas import AREAS_MAX, FencedArea, too_many
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
    if len(rows) == 0:
        return Constraints.none()
    return Constraints(rows, np.zeros_like(rows) + NO_ROW, normal, bound_m_s, FENCE_REASONS[sides])


WIDER = 1.001
"""For the rounding of the way in which the possible speed could be braked."""

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
        _still_where_unknown(velocity_m_s, i)
        x_m, y_m, height_m = position_m[i, 0], position_m[i, 1], -position_m[i, 2]
        distance_m = np.sqrt(x_m * x_m + y_m * y_m)
        stop_m = WIDER * possible_m_s * (each[REACTION, i] + 0.5 * possible_m_s / each[DECELERATION, i])
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
            allowed_m_s = np.inf
            if not gap_m > stop_m:
                response = each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i]
                allowed_m_s = allowed_speed_m_s(gap_m, *response)
            if not allowed_m_s <= possible_m_s:
                continue
            rows[kept], sides[kept], bound_m_s[kept] = i, side, -allowed_m_s
            kept += 1
    return rows[:kept], sides[:kept], normal[:kept], bound_m_s[:kept]


@kernel_within
def _still_where_unknown(velocity_m_s: Array, i: int) -> None:
    for axis in range(3):
        if not np.isfinite(velocity_m_s[i, axis]):
            velocity_m_s[i, axis] = 0.0


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
