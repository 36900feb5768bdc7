"""Graphs of ways within the fence's areas and the controlled ground. A tick looks them up, and makes none.

Which walls count depends on the heights between which a vehicle flies; what a way keeps from them depends on
how well the positions are known. So there is a graph for each pair of heights and each of a few distances,
within a bound on all the work: heights become coarser until it is kept. `prepare_ways` is for the ground.
"""

from bisect import bisect_left
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from itertools import combinations, product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.control.path_search import from_paths_m, sees
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import FencedArea, beyond_m, passable
from gcs.safety.surroundings import SafetySettings

BAND_M: Final = 10.0
"""Heights are rounded to this, or to a multiple where that would take too many graphs."""

KEPT_M: Final = (0.35, 0.75, 1.25, 2.0, 3.0)
"""Distances of ways from walls for which graphs are made; beyond the last the last is used."""

AROUND_RAD: Final = np.radians([0.0, -45.0, 45.0, -90.0, 90.0])
"""Where points lie beside a corner, from its outward bisector."""

ASIDE_RAD: Final = np.radians(22.5)
"""Points lie no farther from the bisector than half of the corner's turn, and this."""

OUT_SHARE: Final = 1.1
"""Of the distance kept: so far from a corner its points lie. The straight line between two keeps 1.01."""

POINTS_MAX: Final = 600
"""Of one graph; where there would be more, each corner has the one on its bisector."""

BANDS_MAX: Final = 100
"""Pairs of heights of one site."""

GRAPHS_MAX: Final = 150
"""Graphs of one site that differ."""

WORK_MAX: Final = 2e9
"""Graphs of one site, times the cube of their points: about a second and a half."""

FENCES_MAX: Final = 4
"""Fences whose graphs are kept: that of the configuration, and those of the shows selected last."""


class Graph(NamedTuple):
    """Walls as q edges, and p points that ways bend at."""

    edge_m: Array  # (q, 2, 3) at height 0
    kept_m: Array  # (q,) from each
    point_m: Array  # (p, 3) at height 0
    between_m: Array  # (p, p) lengths of the shortest ways; inf: there is none


Walls = tuple[tuple[FencedArea, float], ...]
"""Areas, and the distance to be kept from the edges of each."""

Place = tuple[int, int, int]
"""Of a graph: its distance in KEPT_M, and the least and greatest height in steps."""


class WallsAt(NamedTuple):
    """The edges of g graphs one after the other, and which graph counts where."""

    edge_m: Array  # (q, 2, 3) at height 0
    kept_m: Array  # (q,) from each
    first: NDArray[np.intp]  # (g + 1,) the first edge of each graph, and q
    at: NDArray[np.intp]  # (KEPT_M, top + 1, top + 1) graph, by distance, and least and greatest height


@dataclass(frozen=True, slots=True, eq=False)
class AreaGraphs:
    """All graphs of a site."""

    step_m: float  # between heights; the least is 0
    graphs: tuple[Graph, ...]
    walls: WallsAt

    def graph(self, band: tuple[int, int], kept_m: float) -> tuple[Graph, float]:
        """The graph between two heights, in steps, that keeps `kept_m` or more, and what it keeps."""
        which = layer_of(kept_m)
        return self.graphs[self.walls.at[which, *band]], KEPT_M[which]


def layer_of(kept_m: float) -> int:
    """The index in `KEPT_M` of the least distance that is `kept_m` or more."""
    return min(bisect_left(KEPT_M, kept_m - TINY), len(KEPT_M) - 1)


@kernel
def band_of(here_m: Array, there_m: Array, step_m: float, top: int) -> tuple[int, int]:
    """The heights, in steps up to `top`, between which walls count on a way, (3,) to (3,)."""
    least, most = -max(here_m[2], there_m[2]) / step_m, -min(here_m[2], there_m[2]) / step_m
    low = int(np.floor(min(max(least, 0.0), top - 1.0)))
    return low, max(int(np.ceil(min(max(most, 0.0), float(top)))), low + 1)


_prepared = dict[Hashable, tuple[float, AreaGraphs]]()
"""Graphs, and the wind for which they were made."""


def prepare_ways(*rules: SafetySettings) -> None:
    """Make the graphs of these fences that are not there yet; they replace those of fences before them."""
    for safety in rules:
        if safety.fence.is_plain:
            continue
        wind_m_s, before = safety.impact.wind_max_m_s, _prepared.pop(_key(safety), None)
        graphs = _made(safety) if before is None or before[0] != wind_m_s else before[1]
        while len(_prepared) >= FENCES_MAX:
            del _prepared[next(iter(_prepared))]
        _prepared[_key(safety)] = wind_m_s, graphs


def prepared_ways(safety: SafetySettings) -> AreaGraphs | None:
    """The graphs of this site; None: `prepare_ways` has not made them.

    In more wind than they were made for they still lead round walls: the safety filter keeps what is missing.
    """
    made = _prepared.get(_key(safety))
    return None if made is None or made[0] > safety.impact.wind_max_m_s else made[1]


def _key(safety: SafetySettings) -> Hashable:
    """What graphs are of, but the wind. A show has less height than the service, and needs no others."""
    impact = safety.impact
    lines_m = impact.ground_m, impact.soft_m, impact.hard_m
    return safety.fence.areas, safety.fence.controlled_ground, impact.airframe, impact.reaction_s, lines_m


def _made(safety: SafetySettings) -> AreaGraphs:
    step_m, top, walls_at = _fitting(safety)
    each = {walls: index for index, walls in enumerate(dict.fromkeys(walls_at.values()))}
    at = np.zeros((len(KEPT_M), top + 1, top + 1), np.intp)
    for place, walls in walls_at.items():
        at[place] = each[walls]
    graphs = tuple(map(graph_of, each))
    first = np.cumsum([0, *(len(graph.kept_m) for graph in graphs)], dtype=np.intp)
    edge_m, kept_m = (np.concatenate([graph[which] for graph in graphs]) for which in (0, 1))
    return AreaGraphs(step_m, graphs, WallsAt(edge_m, kept_m, first, at))


def _fitting(safety: SafetySettings) -> tuple[float, int, dict[Place, Walls]]:
    """The least step between heights, in m, whose graphs are within the bounds; the top; walls of each."""
    step_m, height_m = BAND_M, safety.fence.height_max_m
    while True:
        top = max(1, int(np.ceil(height_m / step_m)))
        if top == 1 or top * (top + 1) // 2 <= BANDS_MAX:
            walls_at = dict(_walls(safety, step_m, top))
            each = dict.fromkeys(walls_at.values())
            most = max((len(_turns(walls)) for walls in each), default=0)
            if top == 1 or (len(each) <= GRAPHS_MAX and len(each) * most**3 <= WORK_MAX):
                return step_m, top, walls_at
        step_m = 2.0 * step_m


def _walls(safety: SafetySettings, step_m: float, top: int) -> Iterator[tuple[Place, Walls]]:
    """The walls of each graph."""
    fence, ground = safety.fence, safety.fence.controlled_ground
    areas = passable(fence.areas, fence.heights_m)
    heights_m = np.minimum(step_m * np.arange(top + 1), fence.height_max_m)
    falls_m = np.zeros(top + 1) if ground is None else kept_in_m(heights_m, safety.impact)
    for (which, kept_m), (low, high) in product(enumerate(KEPT_M), combinations(range(top + 1), 2)):
        low_m, high_m = step_m * low - kept_m, step_m * high + kept_m
        walls = [
            (area, kept_m)
            for area in areas
            if area.inside or (area.heights_m[0] < high_m and area.heights_m[1] > low_m)
        ]
        if ground is not None:
            walls.append((ground, float(falls_m[high]) + kept_m))
        yield (which, low, high), tuple(walls)


def graph_of(walls: Walls) -> Graph:
    """These walls, and the points beside their corners."""
    nothing = np.zeros((0, 3))
    if not walls:
        return Graph(np.zeros((0, 2, 3)), np.zeros(0), nothing, np.zeros((0, 0)))
    edges_m = [_edges_m(area) for area, _ in walls]
    edge_m = np.concatenate(edges_m)
    kept_m = np.repeat([each_m for _, each_m in walls], [len(each) for each in edges_m])
    point_m = _turns(walls)
    clear = np.array([(from_paths_m(each, edge_m) >= kept_m).all() for each in point_m], np.bool_)
    clear &= beyond_m([area for area, _ in walls], point_m[:, :2]) < 0.0
    point_m = np.ascontiguousarray(point_m[clear])
    return Graph(edge_m, kept_m, point_m, _between(point_m, edge_m, kept_m))


def _turns(walls: Walls) -> Array:
    """(p, 3) points beside all corners; fewer beside each where there are too many."""
    for around_rad in (AROUND_RAD, AROUND_RAD[:1]):
        point_m = [_points_m(area, kept_m, around_rad) for area, kept_m in walls]
        if sum(map(len, point_m)) <= POINTS_MAX:
            break
    return np.concatenate([np.zeros((0, 3)), *point_m])


def _edges_m(area: FencedArea) -> Array:
    """(q, 2, 3) begin and end of the edges."""
    ring_m = np.column_stack([np.array(area.corners_m), np.zeros(len(area.corners_m))])
    return np.stack([ring_m, np.roll(ring_m, -1, axis=0)], axis=1)


def _points_m(area: FencedArea, kept_m: float, around_rad: Array) -> Array:
    """(p, 3) points beside the corners about which a way within the area, or past it, may bend."""
    ring_m = np.array(area.corners_m)
    ring_m = ring_m[(ring_m != np.roll(ring_m, 1, axis=0)).any(axis=1)]
    before, after = np.roll(ring_m, 1, axis=0) - ring_m, np.roll(ring_m, -1, axis=0) - ring_m
    back, on = (each / np.maximum(np.linalg.norm(each, axis=1), TINY)[:, None] for each in (before, after))
    outward = -(back + on)
    length = np.linalg.norm(outward, axis=1)
    turn = on[:, 0] * back[:, 1] - on[:, 1] * back[:, 0]
    ring_m2 = (ring_m[:, 0] * after[:, 1] - ring_m[:, 1] * after[:, 0]).sum()
    sharper = turn * ring_m2 * (-1.0 if area.inside else 1.0) > 0.0  # a way bends about it, not within it
    bends = (length > 1e-3) & (sharper | (np.abs(turn) < 1e-6))  # along a straight wall none does
    outward_rad, half_turn_rad = (
        np.arctan2(outward[:, 1], outward[:, 0]),
        np.arcsin(np.minimum(length / 2.0, 1.0)),
    )
    corner, around = np.nonzero(bends[:, None] & (np.abs(around_rad) <= half_turn_rad[:, None] + ASIDE_RAD))
    turned_rad = outward_rad[corner] + around_rad[around]
    aside = np.column_stack([np.cos(turned_rad), np.sin(turned_rad), np.zeros(len(turned_rad))])
    at_m = np.column_stack([ring_m[corner], np.zeros(len(corner))])
    return np.asarray(at_m + OUT_SHARE * kept_m * aside)


@kernel
def _between(point_m: Array, edge_m: Array, kept_m: Array) -> Array:
    """(p, p) lengths of the shortest ways between points (p, 3) that keep clear of all edges."""
    count = len(point_m)
    way_m = np.full((count, count), np.inf)
    for i in range(count):
        way_m[i, i] = 0.0
        for j in range(i):
            if sees(point_m[i], point_m[j], edge_m, kept_m, 0.0):
                way_m[i, j] = way_m[j, i] = np.sqrt(((point_m[i] - point_m[j]) ** 2).sum())
    for k in range(count):
        for i in range(count):
            if way_m[i, k] == np.inf:
                continue
            for j in range(count):
                way_m[i, j] = min(way_m[i, j], way_m[i, k] + way_m[k, j])
    return way_m
