"""Where a vehicle on the wrong side of areas comes out of all of them. Pure.

Source: boundary of a union of polygons; freeness changes along an edge only where others' edges cross it.
"""

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.fenced_areas import ACROSS_M, ON_EDGE_M, Shapes, inward, is_within, surely_clear_m
from gcs.safety.neighbours import Rows


@kernel
def way_out(place: tuple[float, float, float], shapes: Shapes, wrong: Mask, way: Array) -> float:
    """Write the direction (2,) of the nearest place where one comes out of all areas. Returns its distance.

    It lies on an edge of an area of `wrong` (a,), every other area allows the place behind it, and the
    straight way there enters none that the vehicle is rightly outside of, and leaves none that it is
    rightly inside of; infinite: there is none. Areas at other heights do not count. `place`: x, y and height.
    """
    counted, right = _sides(place, shapes, wrong)
    owner, edge, share, away_m2 = _ends(place, shapes, wrong)
    for k in np.argsort(away_m2, kind="mergesort"):  # of equal ones the first
        area = owner[k]
        turn = shapes.turn[area] if shapes.inside[area] else -shapes.turn[area]
        counted[area] = False  # behind its own edge it is left
        is_free = _is_free(place, shapes, (counted, right), (edge[k], share[k], turn), way)
        counted[area] = True
        if is_free:
            away_m: float = np.sqrt(away_m2[k])
            return away_m
    return np.inf


@kernel
def _sides(place: tuple[float, float, float], shapes: Shapes, wrong: Mask) -> tuple[Mask, Mask]:
    """(a,) which areas count at the height of a place, and on the right side of which it is."""
    x_m, y_m, height_m = place
    counted, right = np.zeros(len(wrong), np.bool_), np.zeros(len(wrong), np.bool_)
    for area in range(len(wrong)):
        within = is_within(x_m, y_m, shapes, area)
        if shapes.inside[area]:
            counted[area], right[area] = True, within
        elif shapes.heights_m[area, 0] <= height_m <= shapes.heights_m[area, 1]:
            counted[area], right[area] = wrong[area] or not within, not within
    return counted, right


@kernel
def _ends(place: tuple[float, float, float], shapes: Shapes, wrong: Mask) -> tuple[Rows, Rows, Array, Array]:
    """Where a straight way from a place could end, of all areas of `wrong` (a,): beside which it may be free.

    The nearest point of each edge, and the points beside edges that cross it.

    Returns: (k,) areas, edges, shares of these, and squares of the distances.
    """
    x_m, y_m, _ = place
    edges, first, crossed = shapes.edge, shapes.first, shapes.crossed_first
    count = 0
    for area in range(len(wrong)):
        if wrong[area]:
            begin, end = first[area], first[area + 1]
            count += end - begin + crossed[end] - crossed[begin]
    owners, at = np.empty(count, np.intp), np.empty(count, np.intp)
    shares, away_m2, kept = np.empty(count), np.empty(count), 0
    for area in range(len(wrong)):
        if not wrong[area]:
            continue
        for edge in range(first[area], first[area + 1]):
            share = (x_m - edges[edge, 0]) * edges[edge, 2] + (y_m - edges[edge, 1]) * edges[edge, 3]
            share = min(max(share * edges[edge, 4], 0.0), 1.0)
            for k in range(crossed[edge] - 1, crossed[edge + 1]):
                if k >= crossed[edge]:
                    share = shapes.crossed[k]
                off_x = x_m - edges[edge, 0] - share * edges[edge, 2]
                off_y = y_m - edges[edge, 1] - share * edges[edge, 3]
                owners[kept], at[kept], shares[kept] = area, edge, share
                away_m2[kept] = off_x * off_x + off_y * off_y
                kept += 1
    return owners, at, shares, away_m2


@kernel
def _is_free(
    place: tuple[float, float, float],
    shapes: Shapes,
    sides: tuple[Mask, Mask],
    point: tuple[int, float, float],
    way: Array,
) -> bool:
    """Whether the way to a point of an edge is straight, and free behind. Then it is written into `way` (2,).

    `sides` are those of `_sides`, `point` the edge, the share of it, and the turn towards its allowed side.
    """
    (x_m, y_m, _), (counted, right), (edge, share, turn), edges = place, sides, point, shapes.edge
    off_x = x_m - edges[edge, 0] - share * edges[edge, 2]
    off_y = y_m - edges[edge, 1] - share * edges[edge, 3]
    away_m = np.sqrt(off_x * off_x + off_y * off_y)
    across_x, across_y = inward(edges, edge, turn)
    end = min(ACROSS_M * np.sqrt(edges[edge, 4]), 0.5)
    inner = min(max(share, end), 1.0 - end)  # not on the line of the edge beside it
    behind_x = edges[edge, 0] + inner * edges[edge, 2] + ACROSS_M * across_x
    behind_y = edges[edge, 1] + inner * edges[edge, 3] + ACROSS_M * across_y
    for area in range(len(counted)):
        if counted[area] and is_within(behind_x, behind_y, shapes, area) != shapes.inside[area]:
            return False
    for area in range(len(right)):
        if not right[area] or abs(surely_clear_m(x_m, y_m, shapes.box, shapes.clear_m, area)) > away_m:
            continue
        if _crosses(x_m, y_m, -off_x, -off_y, edges, shapes.first[area], shapes.first[area + 1]):
            return False
    way[0], way[1] = across_x, across_y
    if away_m > ON_EDGE_M:
        way[0], way[1] = -off_x / away_m, -off_y / away_m
    return True


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
