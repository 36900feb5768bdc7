"""Obstacles on routes past the paths of lost vehicles: ways that are clear of both.

The way round obstacles knows no lost vehicle, and the route past lost vehicles knew no obstacle: where a lost
vehicle hung in a door, each led back to the other. Obstacles that move pass, and are left to the first.
All distances are in the floor's metric, as in `path_search`.
"""

from typing import Final, TypeAlias

import numpy as np

from gcs.control.inputs import TickInputs
from gcs.control.path_search import BEGUN_SHARE, find_corners, sees
from gcs.control.round_obstacles import SPARE_M
from gcs.formation.obstacles import Outlines
from gcs.formation.ways_round import passes, way_round
from gcs.model.jit import kernel
from gcs.model.state import Array
from gcs.safety.enclosures import CREEPS_M_S

Boxes: TypeAlias = tuple[Array, Array, Array, float]
"""Centres (m, 2) of ellipses, their semi-axes (m, 2) with all that a way keeps, and tops (m,), scaled.

The last is the greatest distance from the origin.
"""

EDGES: Final = 24
"""Of the polygon about an ellipse that a search goes round."""

EDGE_M: Final = 0.75
"""What a search keeps from these edges: cells are 1 m apart, and diagonally none may be passed over."""

MORE_M: Final = 0.3
"""A route keeps so much more than the way round obstacles: a vehicle that drifts still passes them."""

REACH_M: Final = 8.0
"""The search goes so far beyond start, goal and obstacles."""

CELLS_M: Final = (1.0, 2_000_000), (0.5, 200_000)
"""Edge of a cell, and the most cells: beyond, the search is left out, so that a tick ends in time. The first
is enough for a fence of 700 m. The gap beside a lost vehicle in a door is seen in such wide cells from some
places only, and a vehicle went to and fro: then the second ones are searched.
"""


def boxes_of(now: TickInputs) -> Boxes:
    """The obstacles that stand."""
    outlines, safety = Outlines.of(now.ellipses), now.settings.safety
    stand = np.hypot(outlines.velocity_m_s[:, 0], outlines.velocity_m_s[:, 1]) <= CREEPS_M_S
    return (
        outlines.center_m[stand],
        outlines.semi_m[stand] + now.settings.law.avoidance.near_m + SPARE_M,
        outlines.top_height_m[stand] * safety.floor.scale[2],
        safety.fence.distance_max_m,
    )


@kernel
def passes_boxes(one_m: Array, other_m: Array, boxes: Boxes) -> bool:
    """Whether a vehicle at (3,) passes all obstacles straight to (3,); obstacles below it do not count."""
    here_m, there_m = one_m[:2].copy(), other_m[:2].copy()
    for k in range(len(boxes[2])):
        if boxes[2][k] > -one_m[2] and not passes(here_m, there_m, boxes[0][k], boxes[1][k]):
            return False
    return True


@kernel
def is_clear_round(
    one_m: Array, other_m: Array, boxes: Boxes, path_m: Array, kept_m: Array, spare_m: float
) -> bool:
    """Whether the shortest way round obstacles, from (3,) to (3,), meets no closed path; as `sees`.

    Where none leads round, whether the straight way does not: the vehicle climbs over.
    """
    here_m, there_m = one_m[:2].copy(), other_m[:2].copy()
    counts = np.flatnonzero(boxes[2] > -one_m[2])
    corner_m, is_way = way_round(here_m, there_m, boxes[0][counts], boxes[1][counts], boxes[3])
    before_m = one_m.copy()
    for k in range(len(corner_m) if is_way else 0):
        at_m = np.array([corner_m[k, 0], corner_m[k, 1], one_m[2]])
        if not sees(before_m, at_m, path_m, kept_m, spare_m):
            return False
        before_m = at_m
    return sees(before_m, other_m, path_m, kept_m, spare_m)


def way_among(start_m: Array, goal_m: Array, boxes: Boxes, path_m: Array, kept_m: Array) -> Array | None:
    """A way at the vehicle's height round obstacles and past closed paths.

    Args:
        start_m: (3,) scaled.
        goal_m: (3,) scaled.
        boxes: the obstacles.
        path_m: (m, 2, 3) closed, scaled.
        kept_m: (m,) distance to be kept from each.

    Returns: corners (k, 3), the last is the goal; None: no obstacle counts, no way leads there, or it is too
        far to be searched.
    """
    level_m = np.array([goal_m[0], goal_m[1], start_m[2]])
    edge_m = _edges_m(start_m, level_m, boxes)
    if not len(edge_m):
        return None
    around_m = np.concatenate([start_m[None], level_m[None], edge_m.reshape(-1, 3)])
    low_m, high_m = around_m.min(axis=0) - REACH_M, around_m.max(axis=0) + REACH_M
    low_m[2] = high_m[2] = start_m[2]
    kept_m = np.concatenate([kept_m, np.full(len(edge_m), EDGE_M)])
    path_m = np.concatenate([path_m, edge_m])
    for cell_m, cells_max in CELLS_M:
        if np.prod((high_m - low_m)[:2] / cell_m + 2.0) > cells_max:
            return None
        corner_m, reaches = find_corners(
            start_m, level_m, path_m, kept_m, low_m, high_m, cell_m, 1.0, boxes[3]
        )
        if reaches:
            corner_m[-1] = goal_m
            return corner_m
    return None


def _edges_m(start_m: Array, goal_m: Array, boxes: Boxes) -> Array:
    """(k, 2, 3) the edges of polygons about the obstacles, at the height of start and goal (3,).

    A start or a goal within what ways keep is outside of them. Obstacles beyond the greatest distance
    are left out.
    """
    turn_rad = 2.0 * np.pi * np.arange(EDGES + 1) / EDGES
    circle = np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    edges_m = [np.zeros((0, 2, 3))]
    within = np.hypot(boxes[0][:, 0], boxes[0][:, 1]) < boxes[3] + boxes[1].max(axis=1, initial=0.0)
    for at in np.flatnonzero((boxes[2] > -start_m[2]) & within).tolist():
        semi_m = boxes[1][at] + MORE_M
        from_m = np.array([start_m[:2], goal_m[:2]]) - boxes[0][at]
        share = min(1.0, BEGUN_SHARE * float(np.hypot(*(from_m / semi_m).T).min()))
        semi_m = np.maximum(share * semi_m - EDGE_M, EDGE_M) / np.cos(np.pi / EDGES)
        corner_m = np.column_stack([boxes[0][at] + semi_m * circle, np.full(EDGES + 1, start_m[2])])
        edges_m.append(np.stack([corner_m[:-1], corner_m[1:]], axis=1))
    return np.concatenate(edges_m)
