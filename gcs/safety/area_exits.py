"""Where a vehicle on the wrong side of areas comes out of all of them. Pure.

Source: boundary of a union of polygons; freeness changes along an edge only where others' edges cross it.
"""

from typing import Final

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask
from gcs.safety.fenced_areas import ON_EDGE_M, Shapes, inward

ACROSS_M: Final = 0.5
"""So far behind an edge there must be no other wall, or no vehicle is led over it."""

ASIDE_M: Final = 1.0
"""So far beside the end of another wall a vehicle is led past it."""


@kernel
def way_out(place: tuple[float, float, float], shapes: Shapes, wrong: Mask, way: Array) -> float:
    """Write the direction (2,) of the nearest place where one comes out of all areas. Returns its distance.

    It lies on an edge of an area of `wrong` (a,), every other area allows the place behind it, and the
    straight way there enters none that the vehicle is rightly outside of, and leaves none that it is
    rightly inside of; infinite: there is none. Areas at other heights do not count. `place`: x, y and height.
    """
    x_m, y_m, _ = place
    edges, first = shapes.edge, shapes.first
    counted, right = _sides(place, shapes, wrong)
    nearest_m2 = np.inf
    for area in range(len(wrong)):
        if not wrong[area]:
            continue
        turn = shapes.turn[area] if shapes.inside[area] else -shapes.turn[area]
        counted[area] = False  # behind its own edge it is left
        for edge in range(first[area], first[area + 1]):
            share = (x_m - edges[edge, 0]) * edges[edge, 2] + (y_m - edges[edge, 1]) * edges[edge, 3]
            share = min(max(share * edges[edge, 4], 0.0), 1.0)
            nearest_m2 = _nearer(place, shapes, (counted, right), (edge, share, turn), nearest_m2, way)
            aside = ASIDE_M * np.sqrt(edges[edge, 4])
            for other in range(len(edges)):
                if first[area] <= other < first[area + 1]:
                    continue
                crossed = _share_crossed(edges, edge, turn, other)
                if not np.isfinite(crossed):
                    continue
                for share in (crossed - aside, crossed + aside):
                    if 0.0 <= share <= 1.0:
                        nearest_m2 = _nearer(
                            place, shapes, (counted, right), (edge, share, turn), nearest_m2, way
                        )
        counted[area] = True
    away_m: float = np.sqrt(nearest_m2)
    return away_m


@kernel
def _sides(place: tuple[float, float, float], shapes: Shapes, wrong: Mask) -> tuple[Mask, Mask]:
    """(a,) which areas count at the height of a place, and on the right side of which it is."""
    x_m, y_m, height_m = place
    counted, right = np.zeros(len(wrong), np.bool_), np.zeros(len(wrong), np.bool_)
    for area in range(len(wrong)):
        within = is_within(x_m, y_m, shapes.edge, shapes.first[area], shapes.first[area + 1])
        if shapes.inside[area]:
            counted[area], right[area] = True, within
        elif shapes.heights_m[area, 0] <= height_m <= shapes.heights_m[area, 1]:
            counted[area], right[area] = wrong[area] or not within, not within
    return counted, right


@kernel
def is_within(x_m: float, y_m: float, edges: Array, begin: int, end: int) -> bool:
    """Whether a place is inside the polygon of the edges `begin` to `end` of (m, 5)."""
    is_inside = False
    for edge in range(begin, end):
        from_x, from_y, along_y = x_m - edges[edge, 0], y_m - edges[edge, 1], edges[edge, 3]
        if (from_y < 0.0) != (from_y < along_y) and from_x < from_y * edges[edge, 2] / along_y:
            is_inside = not is_inside
    return is_inside


@kernel
def _nearer(
    place: tuple[float, float, float],
    shapes: Shapes,
    sides: tuple[Mask, Mask],
    point: tuple[int, float, float],
    nearest_m2: float,
    way: Array,
) -> float:
    """Take the way to a point of an edge if it is shorter, free behind, and straight. Returns the least m^2.

    `sides` are those of `_sides`, `point` the edge, the share of it, and the turn towards its allowed side.
    """
    (x_m, y_m, _), (counted, right), (edge, share, turn), edges = place, sides, point, shapes.edge
    off_x = x_m - edges[edge, 0] - share * edges[edge, 2]
    off_y = y_m - edges[edge, 1] - share * edges[edge, 3]
    square_m2: float = off_x * off_x + off_y * off_y
    if square_m2 >= nearest_m2:
        return nearest_m2
    across_x, across_y = inward(edges, edge, turn)
    end = min(ACROSS_M * np.sqrt(edges[edge, 4]), 0.5)
    inner = min(max(share, end), 1.0 - end)  # not on the line of the edge beside it
    behind_x = edges[edge, 0] + inner * edges[edge, 2] + ACROSS_M * across_x
    behind_y = edges[edge, 1] + inner * edges[edge, 3] + ACROSS_M * across_y
    for area in range(len(counted)):
        begin, last = shapes.first[area], shapes.first[area + 1]
        if counted[area] and is_within(behind_x, behind_y, edges, begin, last) != shapes.inside[area]:
            return nearest_m2
        if right[area] and _crosses(x_m, y_m, -off_x, -off_y, edges, begin, last):
            return nearest_m2
    away_m = np.sqrt(square_m2)
    way[0], way[1] = across_x, across_y
    if away_m > ON_EDGE_M:
        way[0], way[1] = -off_x / away_m, -off_y / away_m
    return square_m2


@kernel
def _share_crossed(edges: Array, edge: int, turn: float, other: int) -> float:
    """At which share an edge, moved to its allowed side by `ACROSS_M`, another crosses it; NaN: nowhere."""
    across_x, across_y = inward(edges, edge, turn)
    from_x = edges[other, 0] - edges[edge, 0] - ACROSS_M * across_x
    from_y = edges[other, 1] - edges[edge, 1] - ACROSS_M * across_y
    along_x, along_y, way_x, way_y = edges[edge, 2], edges[edge, 3], edges[other, 2], edges[other, 3]
    area_m2 = along_x * way_y - along_y * way_x
    if abs(area_m2) < TINY:
        return np.nan
    reached = (from_x * along_y - from_y * along_x) / area_m2
    share: float = (from_x * way_y - from_y * way_x) / area_m2
    return share if -ON_EDGE_M <= reached <= 1.0 + ON_EDGE_M else np.nan


@kernel
def _crosses(x_m: float, y_m: float, way_x: float, way_y: float, edges: Array, begin: int, end: int) -> bool:
    """Whether the straight way from a place crosses one of the edges `begin` to `end`."""
    for edge in range(begin, end):
        from_x, from_y = edges[edge, 0] - x_m, edges[edge, 1] - y_m
        along_x, along_y = edges[edge, 2], edges[edge, 3]
        start = way_x * from_y - way_y * from_x
        stop = start + way_x * along_y - way_y * along_x
        here = along_x * from_y - along_y * from_x
        there = here - along_x * way_y + along_y * way_x
        if start * stop < 0.0 and here * there < 0.0:
            return True
    return False
