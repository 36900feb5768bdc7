"""Ways within the fence's areas and the controlled ground, past their corners, to goals and slots. Pure.

A vehicle that flies straight stops where a wall is in the way, and stays there. Where it does not see its
goal, it aims at the first corner of the shortest way: through points beside those corners of walls that ways
bend about, which see each other (a visibility graph, all pairs by Floyd and Warshall). Walls count that stand
between the heights of vehicle and goal; a wall of the controlled ground is as thick as vehicles fall far.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import TickInputs
from gcs.control.memory import AreaWays
from gcs.control.path_search import BEGUN_SHARE, from_paths_m, sees
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import FencedArea, beyond_m, passable
from gcs.safety.filter import SafetySettings
from gcs.safety.impact import ImpactSettings
from gcs.safety.walls import Fence

BAND_M: Final = 10.0
"""Heights are rounded to this, so that few graphs are needed."""

SPARES_M: Final = (1.0, 0.1)
"""What a way keeps from walls beyond what the filter keeps; the second where the first finds no way."""

STANDOFF_STEP_M: Final = 0.25
"""What the filter keeps is rounded up to this."""

AROUND_RAD: Final = np.radians([0.0, -45.0, 45.0, -90.0, 90.0])
"""Where points lie beside a corner, from its outward bisector."""

OUT_SHARE: Final = 1.1
"""Of the distance kept: so far from a corner its points lie. The straight line between two keeps 1.01."""

BEYOND_M: Final = 2.0
"""A vehicle farther from a corner of its way than this aims as far beyond it."""

THERE_M: Final = 3.0
"""A vehicle in formation this near to its slot flies straight."""

SEARCHED_MAX: Final = 4
"""Ways that are looked up in one tick; the others keep their corners, and come next."""


class Graph(NamedTuple):
    """Walls as q edges, and p points that ways bend at."""

    edge_m: Array  # (q, 2, 3) at height 0
    kept_m: Array  # (q,) from each
    point_m: Array  # (p, 3) at height 0
    between_m: Array  # (p, p) lengths of the shortest ways; inf: there is none


def lead_within(
    now: TickInputs, before: AreaWays | None, aim_m: Array, aiming: NDArray[np.intp], slot_m: Array
) -> tuple[Array, NDArray[np.intp], AreaWays | None]:
    """Where vehicles aim at so that no wall of the fence is in the way.

    Args:
        now: inputs of this tick.
        before: ways of the tick before.
        aim_m: (n, 3) where they would fly straight.
        aiming: (k,) rows that do.
        slot_m: (m, 3) of the m vehicles in formation.

    Returns: aims (n, 3), rows of vehicles that fly there, and the ways.
    """
    if now.settings.safety.fence.is_plain:
        return aim_m, aiming, None
    rows, goal_m = _under_way(now, aim_m, aiming, slot_m)
    ways = before or AreaWays.none(len(now.formed))
    ways = replace(ways, corner_m=ways.corner_m.copy(), asked_s=ways.asked_s.copy())
    site = _Site.of(now)
    hidden = _hidden(now, site, rows, goal_m)
    seen = np.ones(len(now.formed), np.bool_)
    seen[hidden] = False
    ways.corner_m[seen] = np.nan
    in_turn = hidden[np.argsort(ways.asked_s[hidden], kind="stable")][:SEARCHED_MAX]
    for row in in_turn.tolist():
        ways.corner_m[row] = _first_corner(site, now.position_m[row], goal_m[row])
        ways.asked_s[row] = now.fleet.time_s
    led = hidden[np.isfinite(ways.corner_m[hidden, 0])]
    if len(led) == 0:
        return aim_m, aiming, ways
    aim_m = np.array(aim_m)
    ahead_m = ways.corner_m[led] - now.position_m[led, :2]
    away_m = np.linalg.norm(ahead_m, axis=1)
    beyond = BEYOND_M * (away_m > BEYOND_M) / np.maximum(away_m, TINY)
    aim_m[led, :2] = now.position_m[led, :2] + (1.0 + beyond[:, None]) * ahead_m
    aim_m[led, 2] = goal_m[led, 2]
    return aim_m, np.union1d(aiming, led), ways


def _under_way(
    now: TickInputs, aim_m: Array, aiming: NDArray[np.intp], slot_m: Array
) -> tuple[NDArray[np.intp], Array]:
    """Rows of vehicles that may need a way, and (n, 3) where to."""
    goal_m, tasks = np.array(aim_m), now.tasks
    free = ~now.descending[aiming]
    if tasks.follows_planned_path is not None:
        free &= ~tasks.follows_planned_path[aiming]
    way_m = slot_m - now.of_formed(now.position_m)
    far = np.flatnonzero((way_m**2).sum(axis=1) > THERE_M**2)  # NaN by a law without slots: never
    off = now.rows[far]
    led = np.zeros(len(goal_m), np.bool_)
    led[aiming] = True
    far, off = far[~led[off]], off[~led[off]]
    goal_m[off] = slot_m[far]
    return np.concatenate([aiming[free], off]), goal_m


@dataclass(frozen=True, slots=True, eq=False)
class _Site:
    """The graphs of the fence in this tick."""

    safety: SafetySettings
    standoff_m: float
    graphs: dict[tuple[float, float, float, float], Graph]

    @staticmethod
    def of(now: TickInputs) -> "_Site":
        safety = now.settings.safety
        standoff_m = float(safety.floor.standoff_m(np.array(now.traits.uncertainty_m)).max(initial=0.0))
        standoff_m = STANDOFF_STEP_M * float(np.ceil(standoff_m / STANDOFF_STEP_M))
        return _Site(safety, standoff_m, graphs_of(safety.fence, safety.impact))

    def graph(self, band_m: tuple[float, float], spare_m: float) -> Graph:
        """The graph for ways between these heights."""
        key = (*band_m, self.standoff_m, spare_m)
        if key not in self.graphs:
            while len(self.graphs) >= GRAPHS_MAX:
                del self.graphs[next(iter(self.graphs))]
            self.graphs[key] = graph_of(self.safety, band_m, self.standoff_m, spare_m)
        return self.graphs[key]


def _hidden(now: TickInputs, site: _Site, rows: NDArray[np.intp], goal_m: Array) -> NDArray[np.intp]:
    """Those of `rows` (k,) that do not see their goals (n, 3) past the walls."""
    rows = rows[np.isfinite(goal_m[rows]).all(axis=1)]
    if len(rows) == 0:
        return rows
    bands_m = _bands_m(now.position_m[rows], goal_m[rows])
    widest_m = (
        float(bands_m[:, 0].min()),
        float(bands_m[:, 1].max()),
    )
    rest = _unseen(now.position_m[rows], goal_m[rows], *site.graph(widest_m, SPARES_M[1])[:2])
    rows, bands_m = rows[rest], bands_m[rest]
    hidden = np.zeros(len(rows), np.bool_)
    for band_m in {(low_m, high_m) for low_m, high_m in bands_m.tolist()}:
        some = (bands_m == band_m).all(axis=1)
        graph = site.graph(band_m, SPARES_M[1])
        hidden[some] = _unseen(now.position_m[rows[some]], goal_m[rows[some]], *graph[:2])
    return rows[hidden]


def _bands_m(place_m: Array, goal_m: Array) -> Array:
    """(k, 2) heights between which walls count on the ways from (k, 3) to (k, 3)."""
    heights_m = np.sort(np.column_stack([-place_m[:, 2], -goal_m[:, 2]]), axis=1)
    low_m, high_m = np.floor(heights_m[:, 0] / BAND_M), np.ceil(heights_m[:, 1] / BAND_M)
    return np.asarray(BAND_M * np.column_stack([low_m, high_m]))


@kernel
def _unseen(place_m: Array, goal_m: Array, edge_m: Array, kept_m: Array) -> Mask:
    """(k,) from which places (k, 3) the straight ways over the ground to goals (k, 3) are not clear."""
    unseen, here_m, there_m = np.zeros(len(place_m), np.bool_), np.zeros(3), np.zeros(3)
    for i in range(len(place_m)):
        here_m[:2], there_m[:2] = place_m[i, :2], goal_m[i, :2]
        unseen[i] = not sees(here_m, there_m, edge_m, kept_m, 0.0)
    return unseen


def _first_corner(site: _Site, place_m: Array, goal_m: Array) -> Array:
    """(2,) the first corner of the shortest way from a place to a goal, (3,) each; NaN: none is known."""
    low_m, high_m = _bands_m(place_m[None], goal_m[None])[0].tolist()
    for spare_m in SPARES_M:
        graph = site.graph((low_m, high_m), spare_m)
        first = _first(_level(place_m), _level(goal_m), *graph)
        if first >= 0:
            return np.array(graph.point_m[first, :2])
    return np.full(2, np.nan)


def _level(place_m: Array) -> Array:
    return np.array([place_m[0], place_m[1], 0.0])


GRAPHS_MAX: Final = 64
"""Graphs that are kept of one site."""


@lru_cache(maxsize=2)
def graphs_of(fence: Fence, impact: ImpactSettings) -> dict[tuple[float, float, float, float], Graph]:
    """The graphs of a site that were made so far, by what they are for."""
    del fence, impact
    return {}


def graph_of(safety: SafetySettings, band_m: tuple[float, float], standoff_m: float, spare_m: float) -> Graph:
    """The walls between two heights, and the points beside their corners, `spare_m` beyond what is kept."""
    fence, ground, kept_m = safety.fence, safety.fence.controlled_ground, standoff_m + spare_m
    low_m, high_m = band_m[0] - kept_m, band_m[1] + kept_m
    walls = [
        (area, kept_m)
        for area in passable(fence.areas, fence.heights_m)
        if area.inside or (area.heights_m[0] < high_m and area.heights_m[1] > low_m)
    ]
    if ground is not None:
        falls_m = float(kept_in_m(np.array([band_m[1]]), safety.impact)[0])
        walls.append((ground, falls_m + kept_m))
    if not walls:
        nothing = np.zeros((0, 3))
        return Graph(np.zeros((0, 2, 3)), np.zeros(0), nothing, np.zeros((0, 0)))
    edges_m = [_edges_m(area) for area, _ in walls]
    edge_m = np.concatenate(edges_m)
    kept_m_of = np.repeat([each_m for _, each_m in walls], [len(each) for each in edges_m])
    point_m = np.concatenate([_points_m(area, each_m) for area, each_m in walls])
    clear = np.array([(from_paths_m(each, edge_m) >= kept_m_of).all() for each in point_m], np.bool_)
    clear &= beyond_m([area for area, _ in walls], point_m[:, :2]) < 0.0
    point_m = np.ascontiguousarray(point_m[clear])
    return Graph(edge_m, kept_m_of, point_m, _between(point_m, edge_m, kept_m_of))


def _edges_m(area: FencedArea) -> Array:
    """(q, 2, 3) begin and end of the edges."""
    ring_m = np.column_stack([np.array(area.corners_m), np.zeros(len(area.corners_m))])
    return np.stack([ring_m, np.roll(ring_m, -1, axis=0)], axis=1)


def _points_m(area: FencedArea, kept_m: float) -> Array:
    """(p, 3) points beside the corners about which a way within the area, or past it, may bend."""
    ring_m = np.array(area.corners_m)
    before, after = np.roll(ring_m, 1, axis=0) - ring_m, np.roll(ring_m, -1, axis=0) - ring_m
    units = [each / np.maximum(np.linalg.norm(each, axis=1), TINY)[:, None] for each in (before, after)]
    outward = -(units[0] + units[1])
    length = np.linalg.norm(outward, axis=1)
    bends = length > 1e-3  # along a straight wall no way bends
    outward_rad = np.arctan2(outward[bends, 1], outward[bends, 0])
    turned_rad = (outward_rad[:, None] + AROUND_RAD).ravel()
    at_m = np.repeat(ring_m[bends], len(AROUND_RAD), axis=0)
    point_m = at_m + OUT_SHARE * kept_m * np.column_stack([np.cos(turned_rad), np.sin(turned_rad)])
    return np.column_stack([point_m, np.zeros(len(point_m))])


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


@kernel
def _first(
    place_m: Array, goal_m: Array, edge_m: Array, kept_m: Array, point_m: Array, between_m: Array
) -> int:
    """The first point of the shortest way from a place (3,) to a goal (3,); -1: there is none.

    Places nearer to walls than is kept come no nearer to them.
    """
    count = len(point_m)
    begun_m = np.minimum(kept_m, BEGUN_SHARE * from_paths_m(place_m, edge_m))
    ends_m = np.minimum(kept_m, BEGUN_SHARE * from_paths_m(goal_m, edge_m))
    left_m = np.full(count, np.inf)
    for j in range(count):
        if sees(point_m[j], goal_m, edge_m, ends_m, 0.0):
            last_m = np.sqrt(((point_m[j] - goal_m) ** 2).sum())
            for i in range(count):
                left_m[i] = min(left_m[i], between_m[i, j] + last_m)
    for i in range(count):
        left_m[i] += np.sqrt(((point_m[i] - place_m) ** 2).sum())
    while count > 0:
        nearest = int(np.argmin(left_m))
        if left_m[nearest] == np.inf:
            return -1
        if sees(place_m, point_m[nearest], edge_m, begun_m, 0.0):
            return nearest
        left_m[nearest] = np.inf
    return -1
