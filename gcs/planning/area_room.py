"""Whether a sphere on its orbit has room among the areas of a fence, and how much is missing. Pure."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.model.plan import Formation, Orbit
from gcs.model.state import Array
from gcs.safety.controlled_ground import kept_in_m
from gcs.safety.fenced_areas import FencedArea, beyond_m
from gcs.safety.impact import ImpactSettings


class Lack(NamedTuple):
    """What is missing at k places; areas count from 0."""

    lack_m: Array  # (k,) that the fence's areas are too narrow; negative or 0: there is room
    area: NDArray[np.intp]  # (k,) the narrowest of them


class Space(NamedTuple):
    """What k formations on their orbits take, seen from their targets."""

    place_m: Array  # (k, 2) of the targets, show frame
    ring_m: Array  # (k, 2) least and greatest distance of vehicles from there
    heights_m: Array  # (k, 2) lowest and highest


def space_of(place_m: tuple[float, float], orbit: Orbit, formation: Formation) -> Space:
    """That of one formation."""
    heights_m = formation.height_m - formation.radius_m, formation.height_m + formation.radius_m
    return Space(np.array([place_m]), np.array([swept_m(orbit, formation)]), np.array([heights_m]))


def swept_m(orbit: Orbit, formation: Formation) -> tuple[float, float]:
    """How far from the target vehicles are on that orbit: the least and the greatest distance."""
    return max(orbit.radius_m - formation.radius_m, 0.0), orbit.radius_m + formation.radius_m


def lacking_m(areas: Sequence[FencedArea], space: Space, clear_m: float) -> Lack:
    """By how much formations reach over the edges of areas, of which there is at least one.

    `clear_m` is kept from every edge.
    """
    lack_m = np.stack([_of_area_m(area, space, clear_m) for area in areas])
    worst = lack_m.argmax(axis=0)
    return Lack(lack_m[worst, np.arange(len(space.place_m))], worst)


def _of_area_m(area: FencedArea, space: Space, clear_m: float) -> Array:
    """(k,) as of `lacking_m`. An area to keep out of may also lie inside of the ring, above or below it."""
    around_m: Array = beyond_m([area], space.place_m) + space.ring_m[:, 1] + clear_m
    if area.inside:
        return around_m
    farthest_m = np.linalg.norm(space.place_m[:, None] - np.array(area.corners_m), axis=2).max(axis=1)
    low_m, high_m = area.heights_m
    apart_m = np.maximum(space.heights_m[:, 0] - high_m, low_m - space.heights_m[:, 1])
    within_m = np.minimum(around_m, farthest_m + clear_m - space.ring_m[:, 0])
    return np.asarray(np.minimum(within_m, clear_m - apart_m))


def ground_lack_m(ground: FencedArea, space: Space, impact: ImpactSettings, speed_m_s: float) -> Array:
    """(k,) By how much vehicles of formations might fall outside of the controlled ground, at that speed."""
    falls_m = kept_in_m(space.heights_m[:, 1], impact, speed_m_s)
    return np.asarray(beyond_m([ground], space.place_m) + space.ring_m[:, 1] + falls_m)


def area_name(areas: Sequence[FencedArea], at: int) -> str:
    """An area in words, for a refusal."""
    do = "stay inside of" if areas[at].inside else "keep out of"
    return f"area {at + 1} of the fence, which vehicles {do}"
