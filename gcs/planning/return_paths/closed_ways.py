"""What closes landing places and planned paths to returning vehicles: lost vehicles, and those that stand."""

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask
from gcs.planning.return_paths.candidates import Closed, least_apart_m
from gcs.planning.return_paths.paths import STEP_S, WELL_IN_PLACE_M, ReturnPaths, ReturnSettings
from gcs.safety.floor import Floor

PAD_CLOSED_M = WELL_IN_PLACE_M / 2.0
"""Farther inside the space of a lost vehicle than this, a pad is closed: a vehicle lands beside it at most
that much.
"""

OCCUPIED_SHARE = 0.75
"""Of the spacing of landing places: one that stands nearer than this keeps others off."""

LOOKS_EVERY = 2
"""Of the steps of a planned path every so many are compared with that space: 1.6 m at 4 m/s."""


def space_of_lost(floor: Floor, uncertainty_m: Array, segments_m: Array, lost_m: Array) -> Closed:
    """The space that the filter closes, and what a plan does not know.

    Args:
        floor: minimum separation.
        uncertainty_m: (n,) standard deviations of the positions of those that return, sideways.
        segments_m: (m, 2, 3) paths that lost vehicles may take, show frame.
        lost_m: (m,) standard deviations of their positions.
    """
    spare_m = floor.horizontal_m + floor.margin_m + ReturnSettings().spare_m
    kept_m = spare_m + floor.reserve_m(np.full(len(lost_m), uncertainty_m.max(initial=0.0)), lost_m)
    return Closed(segments_m * floor.scale, kept_m, floor.scale)


def closed_places(
    place_m: Array, over_m: float, floor: Floor, uncertainty_m: Array, lost: tuple[Array, Array]
) -> Mask:
    """(n,) At which places (n, 3) a lost vehicle keeps returning vehicles from landing.

    Args:
        place_m: (n, 3) show frame.
        over_m: height from which they come down.
        floor: minimum separation.
        uncertainty_m: (n,) standard deviations of their positions, sideways.
        lost: (m, 2, 3) paths that lost vehicles may take, show frame, and (m,) standard deviations of their
            positions.
    """
    if not len(lost[0]):
        return np.zeros(len(place_m), dtype=np.bool_)
    apart_m = way_down_apart_m(place_m, over_m, space_of_lost(floor, uncertainty_m, *lost))
    return np.asarray(apart_m < -ReturnSettings().spare_m - PAD_CLOSED_M)


def are_occupied(place_m: Array, stands_m: Array, spacing_m: float) -> Mask:
    """(n,) At which places a vehicle that stands too near keeps others from landing.

    Args:
        place_m: (n, 2 or 3) show frame.
        stands_m: (m, 2) of vehicles on the ground.
        spacing_m: of landing places.
    """
    apart_m = np.linalg.norm(place_m[:, None, :2] - stands_m, axis=2)
    return np.asarray(apart_m.min(axis=1, initial=np.inf) < OCCUPIED_SHARE * spacing_m)


def way_down_apart_m(place_m: Array, over_m: float, space: Closed) -> Array:
    """(k,) Least distance of the way down to each place (k, 3) from the closed space, scaled."""
    down_m = place_m[:, None] - over_m * np.linspace(0.0, 1.0, 3)[:, None] * (0.0, 0.0, 1.0)
    return least_apart_m(down_m * space.scale, space.segments_m, space.kept_m)


def closed_paths(
    paths: ReturnPaths,
    rows: NDArray[np.intp],
    time_s: float,
    floor: Floor,
    uncertainty_m: Array,
    lost: tuple[Array, Array],
) -> Mask:
    """(k,) Which of the rows (k,) of a plan are still to pass where a lost vehicle keeps them off.

    Args:
        paths: the plan, made before these were lost.
        rows: (k,) of it.
        time_s: in the plan: what was flown before does not count.
        floor: minimum separation.
        uncertainty_m: (k,) standard deviations of their positions, sideways.
        lost: as of `closed_places`.
    """
    if not len(lost[0]) or not len(rows):
        return np.zeros(len(rows), dtype=np.bool_)
    space = space_of_lost(floor, uncertainty_m, *lost)
    first = min(max(int(time_s / STEP_S), 0), paths.path_m.shape[1] - 1)
    low_m, high_m = space.segments_m.min(axis=1), space.segments_m.max(axis=1)
    reach_m, least_m = space.kept_m[:, None], np.full(len(rows), np.inf)
    for at, row in enumerate(rows.tolist()):
        ahead_m = paths.path_m[row, first::LOOKS_EVERY] * space.scale
        near = (low_m - reach_m < ahead_m.max(axis=0)) & (high_m + reach_m > ahead_m.min(axis=0))
        segments_m, kept_m = (each[near.all(axis=1)] for each in (space.segments_m, space.kept_m))
        least_m[at] = least_apart_m(ahead_m[None], segments_m, kept_m)[0]
    return np.asarray(least_m < -ReturnSettings().spare_m)
