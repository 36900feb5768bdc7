"""Areas that vehicles stay inside of, or outside: polygons of any shape, some with heights. Pure.

Sources: even-odd rule for the inside; the nearest point of each edge, by projection.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Annotated, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gcs.model.jit import kernel
from gcs.model.settings import Settings
from gcs.model.state import TINY, Array, Mask

CORNERS_MAX: Final = 64
AREAS_MAX: Final = 24
CORNERS_IN_ALL: Final = 320
"""Of all areas together: those of a site, and those of a drawing."""

ON_EDGE_M: Final = 1e-6
"""Nearer to an edge than this a vehicle is on it: the way off it is across the edge."""

CELLS: Final = 64
"""Of a raster over each area, along one axis: cells far from all edges need no look at them."""

PASSES_M: Final = 3.0
"""A vehicle passes over or under an area where the fence leaves it so much height."""

ACROSS_M: Final = 0.5
"""So far behind an edge there must be no other wall, or no vehicle is led over it."""

ASIDE_M: Final = 1.0
"""So far beside the end of another wall a vehicle is led past it."""

LED_SHARE: Final = 0.5
"""Of the greatest speed: a vehicle far on the wrong side is led back so fast, and can still give way."""

Corner: TypeAlias = tuple[float, float]


class FencedArea(Settings):
    """A polygon on the ground, show frame: x along the heading, y to its right."""

    corners_m: Annotated[tuple[Corner, ...], Field(min_length=3, max_length=CORNERS_MAX)]
    """x and y of each corner, in order, in m."""
    inside: bool = True
    """Vehicles stay inside; false: outside."""
    height_min_m: float | None = None
    """Least height above the origin, in m: of flight inside, or of closed space; null: the ground."""
    height_max_m: float | None = None
    """Greatest height, in m, likewise; null: no limit. Above it closed space is flown over."""

    @model_validator(mode="after")
    def _has_height(self) -> "FencedArea":
        low_m, high_m = self.heights_m
        if not low_m < high_m:
            raise ValueError(f"height_max_m = {high_m:g}: above height_min_m = {low_m:g}")
        return self

    @property
    def heights_m(self) -> tuple[float, float]:
        """Least and greatest height; infinite where there is no limit."""
        return (
            -np.inf if self.height_min_m is None else self.height_min_m,
            np.inf if self.height_max_m is None else self.height_max_m,
        )


def too_many(areas: Sequence[FencedArea]) -> str:
    """Why no fence can have all of these areas, in words; empty: one can."""
    corners = sum(len(area.corners_m) for area in areas)
    if len(areas) > AREAS_MAX:
        return f"{len(areas)} areas in all: at most {AREAS_MAX}"
    return f"{corners} corners in all: at most {CORNERS_IN_ALL}" if corners > CORNERS_IN_ALL else ""


class Shapes(NamedTuple):
    """All areas as arrays: m corners, a areas."""

    edge: Array  # (m, 5) where each begins, the way along it, and 1 over the square of its length
    first: NDArray[np.intp]  # (a + 1,) index of the first edge of each, and m
    inside: Mask  # (a,) vehicles stay inside
    heights_m: Array  # (a, 2)
    turn: Array  # (a,) 1 where the corners turn from x to y, else -1
    box: Array  # (a, 4) least x and y of a raster over each, and cells per metre
    clear_m: Array  # (a, CELLS, CELLS) least distance of a cell from all edges; negative: outside
    crossed: Array  # (c,) shares of edges beside those of other areas that cross them, on the allowed side
    crossed_first: NDArray[np.intp]  # (m + 1,) index of the first of each edge, and c


@lru_cache(maxsize=16)
def shapes_of(areas: tuple[FencedArea, ...]) -> Shapes:
    """The arrays of these areas, without corners that repeat the one before."""
    rings_m = [_ring_m(area) for area in areas]
    signed_m2, rasters = [_signed_m2(ring_m) for ring_m in rings_m], [_raster(ring_m) for ring_m in rings_m]
    edges = np.concatenate([*map(_edges, rings_m), np.zeros((0, 5))])
    first = np.append(0, np.cumsum([len(ring_m) for ring_m in rings_m], dtype=np.intp))
    inside = np.array([area.inside for area in areas], np.bool_)
    turns = np.where(np.array(signed_m2) < 0.0, -1.0, 1.0)
    return Shapes(
        edges,
        first,
        inside,
        np.array([area.heights_m for area in areas], np.float64).reshape(-1, 2),
        turns,
        np.array([box for box, _ in rasters]).reshape(-1, 4),
        np.array([clear_m for _, clear_m in rasters]).reshape(-1, CELLS, CELLS),
        *_shares_crossed(edges, first, np.where(inside, turns, -turns)),
    )


def without_tops(shapes: Shapes) -> Shapes:
    """The same, where closed space has no top: so it is for vehicles that land, through all of it."""
    heights_m = shapes.heights_m.copy()
    heights_m[~shapes.inside, 1] = np.inf
    return shapes._replace(heights_m=heights_m)


def _raster(ring_m: Array) -> tuple[Array, Array]:
    low_m, high_m = ring_m.min(axis=0), ring_m.max(axis=0)
    box = np.concatenate([low_m, CELLS / np.maximum(high_m - low_m, TINY)])
    return box, _clearances(_edges(ring_m), box)


def _edges(ring_m: Array) -> Array:
    along_m = np.roll(ring_m, -1, axis=0) - ring_m
    squared_m2 = np.maximum((along_m**2).sum(axis=1), TINY)
    return np.column_stack([ring_m, along_m, 1.0 / squared_m2])


def _ring_m(area: FencedArea) -> Array:
    ring_m = np.array(area.corners_m, np.float64)
    moves = (np.abs(ring_m - np.roll(ring_m, 1, axis=0)) > ON_EDGE_M).any(axis=1)
    return ring_m[moves] if moves.sum() >= 3 else ring_m


def _signed_m2(ring_m: Array) -> float:
    after_m = np.roll(ring_m, -1, axis=0)
    return float((ring_m[:, 0] * after_m[:, 1] - after_m[:, 0] * ring_m[:, 1]).sum())


@lru_cache(maxsize=16)
def passable(areas: tuple[FencedArea, ...], heights_m: tuple[float, float]) -> tuple[FencedArea, ...]:
    """The areas; those that no flight passes over, or under, within a fence reach up, or down, for ever."""
    low_m, high_m = heights_m
    led = list[FencedArea]()
    for area in areas:
        changes = dict[str, None]()
        if not area.inside and area.height_max_m is not None and area.height_max_m > high_m - PASSES_M:
            changes["height_max_m"] = None
        if not area.inside and area.height_min_m is not None and area.height_min_m < low_m + PASSES_M:
            changes["height_min_m"] = None
        led.append(area.model_copy(update=changes) if changes else area)
    return tuple(led)


def beyond_m(areas: Sequence[FencedArea], place_m: Array) -> Array:
    """(n,) By how much each place is on the wrong side of an area; negative: how far it is from that.

    Places (n, 3), show frame, are judged with their heights, but for the least height of areas that vehicles
    stay inside of: they land below it. Of places (n, 2) areas count at all heights. Minus infinity without an
    area. NaN places are on no wrong side.
    """
    if not areas:
        return np.full(len(place_m), -np.inf)
    level = place_m.shape[1] == 2
    within_m = np.column_stack([place_m, np.zeros(len(place_m))]) if level else np.array(place_m, order="C")
    return _beyond_m(within_m, shapes_of(tuple(areas)), level)


@kernel
def _beyond_m(place_m: Array, shapes: Shapes, level: bool) -> Array:
    """(n,) as `beyond_m`, of places (n, 3); `level`: heights do not count."""
    edges, first, inside, heights_m = shapes.edge, shapes.first, shapes.inside, shapes.heights_m
    off_m, most_m = np.empty((len(edges), 3)), np.full(len(place_m), -np.inf)
    for i in range(len(place_m)):
        if not np.isfinite(place_m[i].sum()):
            continue
        for area in range(len(inside)):
            x_m, y_m, height_m = place_m[i, 0], place_m[i, 1], -place_m[i, 2]
            over_m = -np.inf if level else height_m - heights_m[area, 1]
            under_m = -np.inf if level else heights_m[area, 0] - height_m
            is_inside, nearest = edges_seen(x_m, y_m, edges, first[area], first[area + 1], off_m)
            away_m = np.sqrt(off_m[nearest, 2])
            apart_m = max(over_m, under_m)
            if inside[area]:
                wrong_m = max(-away_m if is_inside else away_m, over_m)
            elif is_inside:
                wrong_m = -apart_m if apart_m > 0.0 else min(away_m, -apart_m)
            else:
                wrong_m = -np.hypot(away_m, max(apart_m, 0.0))
            most_m[i] = max(most_m[i], wrong_m)
    return most_m


@kernel
def edges_seen(x_m: float, y_m: float, edges: Array, begin: int, end: int, off_m: Array) -> tuple[bool, int]:
    """Whether a place is inside the polygon of the edges `begin` to `end`, and the nearest of these.

    `edges` (m, 5) are those of `Shapes`. `off_m` (m, 3) is set for them: the way from the nearest point of
    each, and its square.
    """
    is_inside, nearest, nearest_m2 = False, begin, np.inf
    for edge in range(begin, end):
        along_x, along_y = edges[edge, 2], edges[edge, 3]
        from_x, from_y = x_m - edges[edge, 0], y_m - edges[edge, 1]
        share = min(max((from_x * along_x + from_y * along_y) * edges[edge, 4], 0.0), 1.0)
        off_x, off_y = from_x - share * along_x, from_y - share * along_y
        square_m2 = off_x * off_x + off_y * off_y
        off_m[edge, 0], off_m[edge, 1], off_m[edge, 2] = off_x, off_y, square_m2
        if square_m2 < nearest_m2:
            nearest, nearest_m2 = edge, square_m2
        if (from_y < 0.0) != (from_y < along_y) and from_x < from_y * along_x / along_y:
            is_inside = not is_inside
    return is_inside, nearest


@kernel
def _clearances(edges: Array, box: Array) -> Array:
    """(CELLS, CELLS) as `Shapes.clear_m`, of the edges (m, 5) of one ring."""
    clear_m, off_m = np.empty((CELLS, CELLS)), np.empty((len(edges), 3))
    half_m = 0.5 * np.sqrt(1.0 / box[2] ** 2 + 1.0 / box[3] ** 2)
    for i in range(CELLS):
        for j in range(CELLS):
            x_m, y_m = box[0] + (i + 0.5) / box[2], box[1] + (j + 0.5) / box[3]
            is_inside, nearest = edges_seen(x_m, y_m, edges, 0, len(edges), off_m)
            away_m = max(np.sqrt(off_m[nearest, 2]) - half_m, 0.0)
            clear_m[i, j] = away_m if is_inside else -away_m
    return clear_m


@kernel
def surely_clear_m(x_m: float, y_m: float, box: Array, clear_m: Array, area: int) -> float:
    """Least distance of a place from all edges of an area; negative outside, 0: it is not known.

    Outside of the raster it is the distance from that.
    """
    i, j = (x_m - box[area, 0]) * box[area, 2], (y_m - box[area, 1]) * box[area, 3]
    if not (0.0 <= i < CELLS and 0.0 <= j < CELLS):
        aside, along = max(-i, i - CELLS, 0.0) / box[area, 2], max(-j, j - CELLS, 0.0) / box[area, 3]
        away_m: float = np.sqrt(aside * aside + along * along)
        return -away_m
    least_m: float = clear_m[area, int(i), int(j)]
    return least_m


@kernel
def is_within(x_m: float, y_m: float, shapes: Shapes, area: int) -> bool:
    """Whether a place is inside the polygon of an area."""
    sure_m = surely_clear_m(x_m, y_m, shapes.box, shapes.clear_m, area)
    if sure_m != 0.0 and np.isfinite(sure_m):
        return sure_m > 0.0
    edges, is_inside = shapes.edge, False
    for edge in range(shapes.first[area], shapes.first[area + 1]):
        from_x, from_y, along_y = x_m - edges[edge, 0], y_m - edges[edge, 1], edges[edge, 3]
        if (from_y < 0.0) != (from_y < along_y) and from_x < from_y * edges[edge, 2] / along_y:
            is_inside = not is_inside
    return is_inside


@kernel
def _shares_crossed(edges: Array, first: NDArray[np.intp], turn: Array) -> tuple[Array, NDArray[np.intp]]:
    """As `Shapes.crossed` and `crossed_first`; `turn` (a,) is that towards the allowed side of each area."""
    count, most = 0, 64
    share, begins = np.empty(most), np.zeros(len(edges) + 1, np.intp)
    for area in range(len(turn)):
        for edge in range(first[area], first[area + 1]):
            aside = ASIDE_M * np.sqrt(edges[edge, 4])
            for other in range(len(edges)):
                if first[area] <= other < first[area + 1]:
                    continue
                crossed = _share_crossed(edges, edge, turn[area], other)
                for beside in (crossed - aside, crossed + aside):
                    if not 0.0 <= beside <= 1.0:  # NaN: not crossed
                        continue
                    if count == most:
                        share, most = np.append(share, share), 2 * most
                    share[count] = beside
                    count += 1
            begins[edge + 1] = count
    return share[:count].copy(), begins


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
def inward(edges: Array, edge: int, turn: float) -> tuple[float, float]:
    """The level unit vector across an edge, into its polygon."""
    scale = turn * np.sqrt(edges[edge, 4])
    return -scale * edges[edge, 3], scale * edges[edge, 2]
