"""Areas of the ground that vehicles stay inside of, or outside: polygons of any shape. Pure.

Sources: even-odd rule for the inside; the nearest point of each edge, by projection.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from gcs.model.jit import kernel
from gcs.model.response import FleetResponse
from gcs.model.settings import Settings
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
)
from gcs.safety.neighbours import Rows

CORNERS_MAX = 60
AREAS_MAX = 4

Corner: TypeAlias = tuple[float, float]


class FencedArea(Settings):
    """A polygon on the ground, show frame: x along the heading, y to its right."""

    corners_m: Annotated[tuple[Corner, ...], Field(min_length=3, max_length=CORNERS_MAX)]
    """x and y of each corner, in order, in m."""
    inside: bool = True
    """Vehicles stay inside; false: outside."""


class _Seen(NamedTuple):
    """n places and the m edges of an area."""

    off_m: Array  # (n, m, 2) from the nearest point of each edge
    away_m: Array  # (n, m)
    allowed: Mask  # (n,) on the side on which vehicles stay


def _seen(area: FencedArea, place_m: Array) -> _Seen:
    begin_m = np.array(area.corners_m)
    along_m = np.roll(begin_m, -1, axis=0) - begin_m
    from_m = place_m[:, None] - begin_m
    squared_m2 = np.maximum((along_m**2).sum(axis=1), TINY)
    share = np.clip((from_m * along_m).sum(axis=2) / squared_m2, 0.0, 1.0)
    off_m = from_m - share[:, :, None] * along_m
    y_m, to_y_m = begin_m[:, 1], begin_m[:, 1] + along_m[:, 1]
    spans = (y_m > place_m[:, None, 1]) != (to_y_m > place_m[:, None, 1])
    rise_m = np.where(along_m[:, 1] == 0.0, TINY, along_m[:, 1])
    crossed = spans & (from_m[:, :, 0] < from_m[:, :, 1] * along_m[:, 0] / rise_m)
    is_inside = crossed.sum(axis=1) % 2 == 1
    return _Seen(off_m, np.linalg.norm(off_m, axis=2), is_inside == area.inside)


def beyond_m(areas: Sequence[FencedArea], place_m: Array) -> Array:
    """(n,) By how much each place (n, 2) is on the wrong side of an area; negative: how far it is from that.

    Minus infinity without an area. NaN places are on no wrong side.
    """
    most_m = np.full(len(place_m), -np.inf)
    for area in areas:
        seen = _seen(area, place_m)
        nearest_m = seen.away_m.min(axis=1)
        most_m = np.fmax(most_m, np.where(seen.allowed, -nearest_m, nearest_m))
    return most_m


def area_constraints(
    position_m: Array,
    commanded: Mask,
    areas: Sequence[FencedArea],
    braking: Braking,
    *,
    velocity_m_s: Array,
    standoff_m: Array,
    response: FleetResponse | None = None,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Bound the speed towards every edge to the speed that can still be braked, as `fence_constraints` does.

    A vehicle on the wrong side is led over the nearest edge.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        areas: any number.
        braking: how vehicles stop.
        velocity_m_s: (n, 3) measured, finite.
        standoff_m: (n,) how far from the edges each is kept.
        response: (n,) in what they differ from `braking`; None: in nothing.
        fastest_m_s: greatest speed of any vehicle: what it does not break is left out.
    """
    if not areas:
        return Constraints.none()
    sizes = np.array([len(area.corners_m) for area in areas])
    rows, which, normal, bound_m_s = _area_rows(
        (np.array(position_m), np.array(velocity_m_s)),
        np.array(commanded),
        (
            np.array([corner for area in areas for corner in area.corners_m]),
            np.append(0, np.cumsum(sizes)),
            np.array([area.inside for area in areas]),
        ),
        np.array(standoff_m),
        braking.of_each(len(position_m), response),
        fastest_m_s,
    )
    reasons = np.array([f"area {number} of the fence" for number in range(1, len(areas) + 1)], dtype=object)
    return Constraints(rows, np.full(len(rows), NO_ROW), normal, bound_m_s, reasons[which])


@kernel
def _area_rows(
    motion: tuple[Array, Array],
    commanded: Mask,
    shapes: tuple[Array, Rows, Mask],
    standoff_m: Array,
    each: Array,
    possible_m_s: float,
) -> tuple[Rows, Rows, Array, Array]:
    """Rows (k,), areas (k,), normals (k, 3), bounds (k,) of all edges that could bind.

    `motion` are positions and velocities (n, 3). `shapes` are the corners (m, 2) of all areas, the first of
    each (a + 1,), and whether vehicles stay inside (a,). `each` (4, n) is that of `Braking.of_each`.
    """
    position_m, velocity_m_s = motion
    corner_m, first, inside = shapes
    most = len(position_m) * len(corner_m)
    rows, which = np.empty(most, np.intp), np.empty(most, np.intp)
    normal, bound_m_s = np.zeros((most, 3)), np.empty(most)
    off_m, away_m = np.empty((len(corner_m), 2)), np.empty(len(corner_m))
    kept = 0
    for i in range(len(position_m)):
        if not commanded[i]:
            continue
        for area in range(len(inside)):
            is_inside, nearest = False, first[area]
            for edge in range(first[area], first[area + 1]):
                end = edge + 1 if edge + 1 < first[area + 1] else first[area]
                along_x, along_y = corner_m[end, 0] - corner_m[edge, 0], corner_m[end, 1] - corner_m[edge, 1]
                from_x, from_y = position_m[i, 0] - corner_m[edge, 0], position_m[i, 1] - corner_m[edge, 1]
                share = (from_x * along_x + from_y * along_y) / max(
                    along_x * along_x + along_y * along_y, TINY
                )
                share = min(max(share, 0.0), 1.0)
                off_m[edge, 0], off_m[edge, 1] = from_x - share * along_x, from_y - share * along_y
                away_m[edge] = np.sqrt(off_m[edge, 0] ** 2 + off_m[edge, 1] ** 2)
                if away_m[edge] < away_m[nearest]:
                    nearest = edge
                if (from_y < 0.0) != (from_y < along_y) and from_x < from_y * along_x / along_y:
                    is_inside = not is_inside
            allowed = is_inside == inside[area]
            side = 1.0 if allowed else -1.0
            for edge in range(first[area], first[area + 1]):
                if not allowed and edge != nearest:
                    continue
                x = side * off_m[edge, 0] / max(away_m[edge], TINY)
                y = side * off_m[edge, 1] / max(away_m[edge], TINY)
                closing_m_s = max(-(x * velocity_m_s[i, 0] + y * velocity_m_s[i, 1]), 0.0)
                gap_m = side * away_m[edge] - standoff_m[i] - each[LEAD, i] * closing_m_s
                allowed_m_s = allowed_speed_m_s(
                    gap_m, each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i]
                )
                if not allowed_m_s <= possible_m_s:
                    continue
                rows[kept], which[kept], bound_m_s[kept] = i, area, -allowed_m_s
                normal[kept, 0], normal[kept, 1] = x, y
                kept += 1
    return rows[:kept], which[:kept], normal[:kept], bound_m_s[:kept]
