"""Ways within the fence's areas and the controlled ground, past their corners, to goals and slots. Pure.

A vehicle that flies straight stops where a wall is in the way, and stays there. Where it does not see its
goal, it aims at the first corner of the shortest way: through points beside those corners of walls that ways
bend about, which see each other (a visibility graph, all pairs by Floyd and Warshall). Walls count that stand
between the heights of vehicle and goal; a wall of the controlled ground is as thick as vehicles fall far.
Graphs are made before the first tick (`gcs.control.area_graphs`); without them vehicles fly straight.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.control.area_graphs import AreaGraphs, prepared_ways
from gcs.control.inputs import TickInputs
from gcs.control.memory import AreaWays
from gcs.control.path_search import BEGUN_SHARE, from_paths_m, sees
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask

SPARES_M: Final = (1.0, 0.1)
"""What a way keeps from walls beyond what the filter keeps; the second where the first finds no way."""

STANDOFF_STEP_M: Final = 0.25
"""What the filter keeps is rounded up to this."""

BEYOND_M: Final = 2.0
"""A vehicle farther from a corner of its way than this aims as far beyond it."""

THERE_M: Final = 3.0
"""A vehicle in formation this near to its slot flies straight."""

SEARCHED_MAX: Final = 4
"""Ways that are looked up in one tick; the others keep their corners, and come next."""


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
    if now.settings.safety.fence.is_plain or (site := _drawn_site(now)) is None:
        return aim_m, aiming, None
    rows, goal_m = _under_way(now, aim_m, aiming, slot_m)
    ways = before or AreaWays.none(len(now.formed))
    ways = replace(ways, corner_m=ways.corner_m.copy(), asked_s=ways.asked_s.copy())
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
    """The graphs of the fence, and what the filter keeps from walls in this tick."""

    ways: AreaGraphs
    standoff_m: float

    def band_walls(self, band: tuple[float, float]) -> tuple[Array, Array]:
        """(q, 2, 3) edges between two heights, and (q,) what a straight way past each keeps."""
        graph, kept_m = self.ways.graph(band, self.standoff_m + SPARES_M[1])
        return graph.edge_m, graph.kept_m + (self.standoff_m + SPARES_M[1] - kept_m)


def _drawn_site(now: TickInputs) -> _Site | None:
    """None: there are no graphs of this fence."""
    safety = now.settings.safety
    ways = prepared_ways(safety)
    if ways is None:
        return None
    standoff_m = float(safety.floor.standoff_m(np.array(now.traits.uncertainty_m)).max(initial=0.0))
    return _Site(ways, STANDOFF_STEP_M * float(np.ceil(standoff_m / STANDOFF_STEP_M)))


def _hidden(now: TickInputs, site: _Site, rows: NDArray[np.intp], goal_m: Array) -> NDArray[np.intp]:
    """Those of `rows` (k,) that do not see their goals (n, 3) past the walls."""
    rows = rows[np.isfinite(goal_m[rows] + now.position_m[rows]).all(axis=1)]
    if len(rows) == 0:
        return rows
    bands = site.ways.bands(now.position_m[rows], goal_m[rows])
    widest = float(bands[:, 0].min()), float(bands[:, 1].max())
    rest = _unseen(now.position_m[rows], goal_m[rows], *site.band_walls(widest))
    rows, bands = rows[rest], bands[rest]
    hidden = np.zeros(len(rows), np.bool_)
    for band in {(low, high) for low, high in bands.tolist()}:
        some = (bands == band).all(axis=1)
        hidden[some] = _unseen(now.position_m[rows[some]], goal_m[rows[some]], *site.band_walls(band))
    return rows[hidden]


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
    low, high = site.ways.bands(place_m[None], goal_m[None])[0].tolist()
    for spare_m in SPARES_M:
        graph, _ = site.ways.graph((low, high), site.standoff_m + spare_m)
        first = _first(_level(place_m), _level(goal_m), *graph)
        if first >= 0:
            return np.array(graph.point_m[first, :2])
    return np.full(2, np.nan)


def _level(place_m: Array) -> Array:
    return np.array([place_m[0], place_m[1], 0.0])


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
