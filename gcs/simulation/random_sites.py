"""Random concave sites, and starts and goals within them between which a way exists. Random only as given."""

from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
import scipy

from gcs.model.errors import ConfigError
from gcs.model.state import Array, Mask
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import FencedArea
from gcs.simulation.scenario import RandomSite, Scenario
from gcs.simulation.site_figures import is_within

TRIES: Final = 200
CELL_M: Final = 1.0
"""Of the raster on which it is seen what is connected."""

CLEAR_M: Final = 2.0
"""Starts, goals and ways that must exist are so far from walls: vehicles keep a metre or less from them."""

LEAST_M2: Final = 900.0
"""Of connected room; a smaller site is drawn anew."""

OUTSIDE_M: Final = (3.0, 12.0)
"""How far outside vehicles begin that do."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnSite:
    """A site, and where in it vehicles can be."""

    scenario: Scenario  # with its fence
    room_m: Array  # (k, 2) middles of connected cells that are clear of all walls
    outside_m: Array  # (j, 2) middles of cells outside, near the edge


def drawn_site(
    scenario: Scenario, site: RandomSite, random: np.random.Generator, open_m: float = 0.0
) -> DrawnSite:
    """Draw a site with room; a disc of `open_m` about the origin is clear. Raises: ConfigError: no room."""
    for _ in range(TRIES):
        ring = _ring(random, site)
        towers = [_tower(random, site) for _ in range(int(random.integers(0, site.towers_max + 1)))]
        if not site.areas:
            towers = []
        changed = _with_fence(scenario, site, ring, towers)
        clear, cells_m = _clear(changed, site, ring, towers)
        middle = np.linalg.norm(cells_m, axis=2) < open_m
        if open_m and not clear[middle].all():
            continue
        parts, _ = scipy.ndimage.label(clear)
        sizes = np.bincount(parts.ravel())[1:]
        if len(sizes) == 0 or sizes.max() * CELL_M**2 < LEAST_M2:
            continue
        part = parts[tuple(np.argwhere(middle)[0])] if open_m else int(sizes.argmax()) + 1
        away_m = scipy.ndimage.distance_transform_edt(~_within(ring, cells_m)) * CELL_M
        beside = (away_m > OUTSIDE_M[0]) & (away_m < OUTSIDE_M[1])
        return DrawnSite(changed, cells_m[parts == part], cells_m[beside])
    raise ConfigError(f"{scenario.name}: no site with room was drawn in {TRIES} tries")


def _with_fence(scenario: Scenario, site: RandomSite, ring: Array, towers: list[FencedArea]) -> Scenario:
    areas = [FencedArea(corners_m=_corners(ring)), *towers] if site.areas else []
    ground = None
    if site.ground:
        ground = FencedArea(corners_m=_corners(_grown(ring, site.beyond_m) if site.areas else ring))
    safety = scenario.control.safety
    fence = safety.fence.model_copy(update={"areas": tuple(areas), "controlled_ground": ground})
    control = scenario.control.model_copy(update={"safety": safety.model_copy(update={"fence": fence})})
    return scenario.model_copy(update={"control": control})


def _corners(ring: Array) -> tuple[tuple[float, float], ...]:
    return tuple((x_m, y_m) for x_m, y_m in ring.tolist())


def _grown(ring: Array, by_m: float) -> Array:
    """(m, 2) the ring about it: the hull of its corners, pushed out."""
    hull = ring[scipy.spatial.ConvexHull(ring).vertices]
    away_m = np.linalg.norm(hull, axis=1, keepdims=True)
    return np.asarray(hull * (away_m + by_m) / away_m)


def _clear(scenario: Scenario, site: RandomSite, ring: Array, towers: list[FencedArea]) -> tuple[Mask, Array]:
    """(i, j) which cells of a raster are clear of all walls at every height, and their middles (i, j, 2)."""
    safety, extent_m = scenario.control.safety, float(np.abs(ring).max()) + 15.0
    line_m = np.arange(-extent_m, extent_m + CELL_M, CELL_M)
    cells_m = np.stack(np.meshgrid(line_m, line_m, indexing="ij"), axis=2)
    kept_m = CLEAR_M if site.areas else 0.0
    ground = safety.fence.controlled_ground
    if ground is not None and not site.areas:
        kept_m = CLEAR_M + float(kept_in_m(np.array([site.height_max_m]), safety.impact)[0])
    room = scipy.ndimage.distance_transform_edt(_within(ring, cells_m)) * CELL_M >= kept_m
    for tower in towers:
        blocked = _within(np.array(tower.corners_m), cells_m)
        room &= scipy.ndimage.distance_transform_edt(~blocked) * CELL_M >= CLEAR_M
    if ground is not None and site.areas:
        falls_m = CLEAR_M + float(kept_in_m(np.array([site.height_max_m]), safety.impact)[0])
        own = _within(np.array(ground.corners_m), cells_m)
        if not own.all():
            room &= scipy.ndimage.distance_transform_edt(own) * CELL_M >= falls_m
    return room & (np.linalg.norm(cells_m, axis=2) < safety.fence.distance_max_m - 10.0), cells_m


def _within(ring: Array, cells_m: Array) -> Mask:
    return is_within(ring, cells_m.reshape(-1, 2)).reshape(cells_m.shape[:2])


def _ring(random: np.random.Generator, site: RandomSite) -> Array:
    """(m, 2) the corners of a shape in any direction and sense."""
    kind = site.kinds[int(random.integers(len(site.kinds)))]
    extent_m = random.uniform(site.extent_min_m, site.extent_max_m)
    ring: Array = {"star": _star, "u": _u, "ell": _ell, "slalom": _slalom}[kind](random) * extent_m
    turn_rad = random.uniform(0.0, 2.0 * pi)
    turned: Array = ring @ np.array(
        [[np.cos(turn_rad), np.sin(turn_rad)], [-np.sin(turn_rad), np.cos(turn_rad)]]
    )
    turned[:, 1] *= random.choice((-1.0, 1.0))
    return turned[:: int(random.choice((-1, 1)))].copy()


def _star(random: np.random.Generator) -> Array:
    spikes = int(random.integers(4, 12))
    turn_rad = 2.0 * pi * (np.arange(2 * spikes) + random.uniform(-0.3, 0.3, 2 * spikes)) / (2 * spikes)
    out = np.where(np.arange(2 * spikes) % 2, random.uniform(0.3, 0.7, 2 * spikes), 1.0)
    out *= random.uniform(0.8, 1.0, 2 * spikes)
    return np.column_stack([out * np.cos(turn_rad), out * np.sin(turn_rad)])


def _u(random: np.random.Generator) -> Array:
    leg, gap, deep = random.uniform(0.25, 0.45), random.uniform(0.1, 0.3), random.uniform(0.5, 1.2)
    half = gap / 2.0 + leg
    x = [-half, half, half, gap / 2, gap / 2, -gap / 2, -gap / 2, -half]
    y = [-0.4, -0.4, deep - 0.4, deep - 0.4, 0.0, 0.0, deep - 0.4, deep - 0.4]
    return np.column_stack([x, y])


def _ell(random: np.random.Generator) -> Array:
    wide, long = random.uniform(0.25, 0.5, 2)
    return np.array(
        [(-0.4, -0.4), (1, -0.4), (1, wide - 0.4), (long - 0.4, wide - 0.4), (long - 0.4, 1), (-0.4, 1)]
    )


def _slalom(random: np.random.Generator) -> Array:
    """Walls into a long room from either side by turns."""
    walls, wide = int(random.integers(2, 4)), random.uniform(0.35, 0.55)
    low, high = [(-1.0, -wide)], [(-1.0, wide)]
    for at, x in enumerate(np.linspace(-1.0, 1.0, walls + 2)[1:-1].tolist()):
        thick, reach = random.uniform(0.02, 0.08), wide - random.uniform(0.15, 0.3)
        begin, end = x - thick, x + thick
        side, sign = (low, 1.0) if at % 2 else (high, -1.0)
        wall_y = -wide if at % 2 else wide
        side += [(begin, wall_y), (begin, sign * reach), (end, sign * reach), (end, wall_y)]
    return np.array([*low, (1.0, -wide), (1.0, wide), *high[::-1]])


def _tower(random: np.random.Generator, site: RandomSite) -> FencedArea:
    corners, extent_m = int(random.integers(3, 7)), random.uniform(3.0, 8.0)
    turn_rad = np.sort(random.uniform(0.0, 2.0 * pi, corners))
    middle_m = random.uniform(-0.6, 0.6, 2) * site.extent_min_m
    ring = middle_m + extent_m * np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    top_m = float(random.uniform(10.0, 60.0))
    return FencedArea(corners_m=_corners(ring), inside=False, height_min_m=0.0, height_max_m=top_m)


def places_m(
    drawn: DrawnSite,
    site: RandomSite,
    count: int,
    spacing_m: float,
    random: np.random.Generator,
    outside: int = 0,
) -> Array:
    """(count, 3) places so far apart, the first `outside` of them outside the site. Raises: ConfigError."""
    places = np.zeros((0, 3))
    for _ in range(100 * TRIES):
        cells_m = drawn.outside_m if len(places) < outside else drawn.room_m
        level_m = cells_m[int(random.integers(len(cells_m)))]
        place_m = np.array([*level_m, -random.uniform(site.height_min_m, site.height_max_m)])
        if (np.linalg.norm(places[:, :2] - place_m[:2], axis=1) >= spacing_m).all():
            places = np.vstack([places, place_m])
        if len(places) == count:
            return places
    raise ConfigError(f"{count} vehicles do not fit into the site, {spacing_m:g} m apart")
