"""The space of lost vehicles, which the slots on the sphere leave."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import TickInputs
from gcs.formation.orbit import Center
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array
from gcs.safety.lost_paths import from_path_m

SLOT_SPARE_M = 0.5
"""A slot is farther from the paths of lost vehicles than the filter keeps its vehicle, by this much."""

AHEAD_S = np.array([0.0, 0.6, 1.2])
"""Slots are clear of these paths now and where the centre takes them in these times."""

LOOK_M, LOOK_STEP_M, DIRECTIONS = 15.0, 0.25, 12
"""How far along the sphere a slot's way out is searched, how finely, and in how many directions."""

SEARCHES = 20
"""Slots whose way out is searched at a time: no tick is late when a station with 300 vehicles is lost.

The others stay where they are until it is their turn: the filter keeps their vehicles clear meanwhile.
"""


class LostSpace:
    """Implements `gcs.formation.laws.protocol.ClosedSpace`. Setpoints do not wait for it."""

    def __init__(self, now: TickInputs, center: Center, radius_m: float, number: int) -> None:
        """`number` is that of the tick."""
        self._now, self._center, self._radius_m, self._number = now, center, radius_m, number

    def move_out(self, place: Array) -> bool:
        if self._paths is None:
            return False
        first = self._number * SEARCHES % max(len(place), 1)  # another in each tick
        return _move_out(place, self._radius_m, *self._paths, first)

    @cached_property
    def _paths(self) -> tuple[Array, Array, Array, Array] | None:
        return _lost_paths(self._now, self._center)


def _lost_paths(now: TickInputs, center: Center) -> tuple[Array, Array, Array, Array] | None:
    """The paths of lost vehicles as `_move_out` needs them, from `centers_m` on; None: there is none."""
    tasks, floor = now.tasks, now.settings.safety.floor
    lost = len(tasks.segments_m) - tasks.silent_segments
    if lost == 0:
        return None
    uncertainty_m = np.array(now.traits.uncertainty_m)
    own_m = float(np.max(uncertainty_m, where=now.formed, initial=0.0))
    lost_m = uncertainty_m.max(initial=0.0) if tasks.segments_of is None else uncertainty_m[tasks.segments_of]
    kept_m = floor.horizontal_m + floor.margin_m + floor.reserve_m(own_m, lost_m) + SLOT_SPARE_M
    return (
        center.position_m + AHEAD_S[:, None] * center.velocity_m_s,
        np.ascontiguousarray(tasks.segments_m[:lost] * floor.scale),
        np.broadcast_to(kept_m, len(tasks.segments_m))[:lost].copy(),
        floor.scale,
    )


@kernel
def _move_out(
    places: Array,
    radius_m: float,
    centers_m: Array,
    segments_m: Array,
    kept_m: Array,
    scale: Array,
    first: int,
) -> bool:
    """Move slots out of the space of lost vehicles by the shortest way along the sphere.

    Args:
        places: (m, 3) slots, unit vectors, changed.
        radius_m: of the sphere.
        centers_m: (a, 3) of the sphere, now and later.
        segments_m: (k, 2, 3) paths, times `scale`.
        kept_m: (k,) distances to be kept from each, times `scale`.
        scale: (3,) as `Floor.scale`.
        first: slot to begin with; a way is searched for at most `SEARCHES`.

    Returns: whether one was not clear of it.
    """
    open_m, searches, largest = np.empty(3), 0, scale.max()
    near, low_m, high_m = np.empty(len(segments_m), np.int64), np.empty(3), np.empty(3)
    lowest_m, highest_m = np.empty(3), np.empty(3)
    for axis in range(3):
        lowest_m[axis], highest_m[axis] = centers_m[:, axis].min(), centers_m[:, axis].max()
    for at in range(len(places)):
        i = (first + at) % len(places)
        for axis in range(3):  # where the slot is, with each of the centres
            low_m[axis] = (lowest_m[axis] + radius_m * places[i, axis]) * scale[axis]
            high_m[axis] = (highest_m[axis] + radius_m * places[i, axis]) * scale[axis]
        count = _close_by(near, low_m, high_m, 0.0, segments_m, kept_m)
        beside_m, beside_kept_m = segments_m[near[:count]], kept_m[near[:count]]
        if _lack_m(places[i], radius_m, centers_m, beside_m, beside_kept_m, scale) <= 0.0:
            continue
        if searches == SEARCHES:
            break
        searches += 1
        count = _close_by(near, low_m, high_m, LOOK_M * largest, segments_m, kept_m)
        beside_m, beside_kept_m = segments_m[near[:count]], kept_m[near[:count]]
        best_m, open_m[:] = LOOK_M, places[i]
        level = max(np.hypot(places[i, 0], places[i, 1]), TINY)
        sideways = np.array([-places[i, 1] / level, places[i, 0] / level, 0.0])
        upwards = np.cross(places[i], sideways)
        for d in range(DIRECTIONS):
            turn_rad = 2.0 * np.pi * d / DIRECTIONS
            along = np.cos(turn_rad) * sideways + np.sin(turn_rad) * upwards
            gone_m = LOOK_STEP_M
            while gone_m < best_m:
                there = np.cos(gone_m / radius_m) * places[i] + np.sin(gone_m / radius_m) * along
                lack_m = _lack_m(there, radius_m, centers_m, beside_m, beside_kept_m, scale)
                if lack_m <= 0.0:
                    best_m, open_m[:] = gone_m, there
                else:  # nearer than that it cannot be clear
                    gone_m += LOOK_STEP_M * max(1.0, np.floor(lack_m / largest / LOOK_STEP_M))
        places[i] = open_m
    return searches > 0


@kernel
def _close_by(
    near: NDArray[np.int64],
    low_m: Array,
    high_m: Array,
    reach_m: float,
    segments_m: Array,
    kept_m: Array,
) -> int:
    """Find the paths that may come nearer than their `kept_m` + `reach_m` to a box: a quick look.

    Args:
        near: (k,) their numbers, set.
        low_m: (3,) lower corner of the box, times the scale, as are the paths.
        high_m: (3,) upper corner.
        reach_m: how much farther than `kept_m`.
        segments_m: (k, 2, 3) paths.
        kept_m: (k,) distances to be kept from each.

    Returns: how many.
    """
    count = 0
    for k in range(len(segments_m)):
        within_m, beside = kept_m[k] + reach_m, True
        for axis in range(3):
            one_m, other_m = segments_m[k, 0, axis], segments_m[k, 1, axis]
            beside &= min(one_m, other_m) - within_m < high_m[axis]
            beside &= max(one_m, other_m) + within_m > low_m[axis]
        near[count] = k
        count += beside
    return count


@kernel
def _lack_m(
    place: Array, radius_m: float, centers_m: Array, segments_m: Array, kept_m: Array, scale: Array
) -> float:
    """By how much the slot (3,) is too near to a path with some centre; none, if it is clear of all.

    Arguments as of `_move_out`. The first path found too near comes first from then on: the next place is
    likely beside it as well.
    """
    off_m, at_m = np.empty(3), np.empty(3)
    for k in range(len(segments_m)):
        for a in range(len(centers_m)):
            for axis in range(3):
                at_m[axis] = (centers_m[a, axis] + radius_m * place[axis]) * scale[axis]
            lack_m: float = kept_m[k] - from_path_m(at_m, segments_m[k], off_m)
            if lack_m > 0.0:
                for axis in range(3):
                    for end in range(2):
                        first_m = segments_m[0, end, axis]
                        segments_m[0, end, axis] = segments_m[k, end, axis]
                        segments_m[k, end, axis] = first_m
                kept_m[0], kept_m[k] = kept_m[k], kept_m[0]
                return lack_m
    return 0.0
