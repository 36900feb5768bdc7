"""Which places obstacles shut off from each other: boxes that stand, and are too high to be flown over. Pure.

A way past ellipses may not be seen although there is one, from a place between two of them. So this says only
what is sure: boxes with their margins, on a grid, leave no gap, nor do they with what the fence closes. What
is connected is filled, once for each set of boxes.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from math import hypot, sqrt
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse, Outlines
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.fenced_areas import FencedArea, passable
from gcs.safety.walls import Fence

Labels: TypeAlias = NDArray[np.int32]

CELL_M: Final = 0.5
CELLS_MAX: Final = 40_000
"""Edge of a cell; longer where there would be more cells than that."""

CREEPS_M_S: Final = 0.05
"""A box that moves no faster stands: walls that are measured again have such speeds. Its place counts in
steps of `STEP_M`, so that the cells are seldom filled anew.
"""

STEP_M: Final = 0.1

FREE: Final = -1
"""The label of what is outside of all boxes, before it is numbered."""

WITHIN_M: Final = 10_000.0
"""A box that reaches farther than this from the origin shuts nothing off: the grid would have no end."""

STEPS_IN_CELL: Final = 4
"""An edge of an area is followed in steps of a quarter of a cell."""

OUTSIDE: Final = 1
"""The label of all that lies around the boxes; 0 is inside one."""

RINGS: Final = 40
"""From a place inside a box, so many cells around are examined for where it is led out."""


@dataclass(frozen=True, slots=True, eq=False)
class Enclosures:
    """What boxes enclose, show frame."""

    label: Labels  # (k, l) cells along x and y; equal where a way leads from one to the other
    low_m: Array  # (2,) the corner of the first cell
    cell_m: float

    @staticmethod
    def of(
        ellipses: Iterable[Ellipse],
        over_m: float,
        fence: Fence | None = None,
        *,
        flown_m: float = WITHIN_M,
    ) -> "Enclosures | None":
        """Of those that stand and have a top higher than `over_m`; None: there are none.

        With a fence also of what that closes, on a grid that may be coarser; None: it closes nothing else.
        Boxes farther from the origin than vehicles fly, `flown_m`, are left out.
        """
        high = (each for each in ellipses if each.top_height_m > over_m and _is_near(each, flown_m))
        walls = tuple(
            _at_rest(each) for each in high if hypot(each.velocity_x_m_s, each.velocity_y_m_s) <= CREEPS_M_S
        )
        if fence is None:
            return _enclosures(walls) if walls else None
        return (
            _with_fence(walls, _closed(fence.areas, fence.heights_m), fence.distance_max_m) if walls else None
        )

    def apart(self, place_m: Array, goal_m: Array) -> Mask:
        """(k,) Between which places (k, 2 or 3) no way leads; False where one is not known."""
        located: Mask = np.asarray(np.isfinite(place_m[:, :2] + goal_m[:, :2]).all(axis=1))
        begins, ends = (
            self._cells(np.where(located[:, None], each[:, :2], 0.0)) for each in (place_m, goal_m)
        )
        apart: Mask = _apart(self.label, begins, ends) & located
        return apart

    def _cells(self, place_m: Array) -> NDArray[np.int64]:
        """(k, 2) cells of places (k, 2); those outside are on the edge, which is outside of all boxes."""
        last = np.array(self.label.shape) - 1
        return np.clip((place_m - self.low_m) / self.cell_m, 0, last).astype(np.int64)


def _is_near(wall: Ellipse, flown_m: float) -> bool:
    x_m, y_m = abs(wall.x_m), abs(wall.y_m)
    nearest_m = max(x_m - wall.semi_x_m, y_m - wall.semi_y_m)
    return nearest_m <= flown_m and max(x_m + wall.semi_x_m, y_m + wall.semi_y_m) <= WITHIN_M


def _at_rest(wall: Ellipse) -> Ellipse:
    """The same, if it creeps as one that stands within it."""
    if not (wall.velocity_x_m_s or wall.velocity_y_m_s):
        return wall
    less_m = 0.5 * STEP_M * sqrt(2.0)
    return replace(
        wall,
        x_m=STEP_M * round(wall.x_m / STEP_M),
        y_m=STEP_M * round(wall.y_m / STEP_M),
        semi_x_m=wall.semi_x_m - less_m,
        semi_y_m=wall.semi_y_m - less_m,
        velocity_x_m_s=0.0,
        velocity_y_m_s=0.0,
    )


@lru_cache(maxsize=4)
def _enclosures(walls: tuple[Ellipse, ...]) -> Enclosures:
    grid = _grid_over(*_boxes(walls))
    _close_boxes(grid, walls)
    _fill(grid.label)
    return grid


@lru_cache(maxsize=4)
def _with_fence(
    walls: tuple[Ellipse, ...], areas: tuple[FencedArea, ...], reach_m: float
) -> Enclosures | None:
    """With areas, and the circle about the origin that no vehicle leaves; None: they close nothing."""
    center_m, half_m = _boxes(walls)
    corners_m = np.concatenate([np.zeros((0, 2)), *(np.array(area.corners_m) for area in areas)])
    center_m, half_m = np.vstack([center_m, corners_m]), np.vstack([half_m, np.zeros_like(corners_m)])
    leaves = bool((np.hypot(*(np.abs(center_m) + half_m).T) > reach_m).any())
    if not (areas or leaves):
        return None
    if leaves:  # what is connected beyond the grid, within the circle, is then so along the edge of the grid
        center_m, half_m = np.vstack([center_m, np.zeros(2)]), np.vstack([half_m, np.zeros(2)])
    grid = _grid_over(center_m, half_m)
    _close_boxes(grid, walls)
    if leaves:
        _close_beyond(grid.label, grid.low_m, grid.cell_m, reach_m)
    for area in areas:
        ring_m = np.array(area.corners_m, np.float64)
        _close_area(grid.label, grid.low_m, grid.cell_m, ring_m, not area.inside)
    _fill(grid.label)
    return grid


@lru_cache(maxsize=16)
def _closed(areas: tuple[FencedArea, ...], heights_m: tuple[float, float]) -> tuple[FencedArea, ...]:
    """The areas that no vehicle passes, at any height from the least to the greatest."""
    led = passable(areas, heights_m)
    return tuple(area for area in led if area.inside or not np.isfinite(area.heights_m).any())


def _boxes(walls: tuple[Ellipse, ...]) -> tuple[Array, Array]:
    """(m, 2) centres and (m, 2) half-lengths with margins."""
    outlines = Outlines.of({str(number): each for number, each in enumerate(walls)})
    return np.array(outlines.center_m), outlines.half_length_m


def _grid_over(center_m: Array, half_m: Array) -> Enclosures:
    """A grid over boxes (m, 2), (m, 2), and two cells around: nothing is numbered yet."""
    low_m, high_m = (center_m - half_m).min(axis=0), (center_m + half_m).max(axis=0)
    cell_m = max(CELL_M, float(np.sqrt(np.prod(high_m - low_m) / CELLS_MAX)))
    low_m, high_m = low_m - 2.0 * cell_m, high_m + 2.0 * cell_m
    count_x, count_y = np.ceil((high_m - low_m) / cell_m).astype(np.int64).tolist()
    return Enclosures(np.full((count_x, count_y), FREE, np.int32), low_m, cell_m)


def _close_boxes(grid: Enclosures, walls: tuple[Ellipse, ...]) -> None:
    """Set the cells within boxes to 0."""
    center_m, half_m = _boxes(walls)
    for middle_m, size_m in zip(center_m, half_m - 0.5 * grid.cell_m, strict=True):
        first, last = (
            np.ceil((middle_m + sign * size_m - grid.low_m) / grid.cell_m - 0.5) for sign in (-1.0, 1.0)
        )
        (x, y), (past_x, past_y) = first.astype(np.int64).tolist(), last.astype(np.int64).tolist()
        grid.label[x:past_x, y:past_y] = 0


@kernel
def _close_beyond(label: Labels, low_m: Array, cell_m: float, reach_m: float) -> None:
    """Set the cells to 0 that lie wholly farther from the origin than `reach_m`."""
    for x in range(label.shape[0]):
        for y in range(label.shape[1]):
            x_m, y_m = low_m[0] + (x + 0.5) * cell_m, low_m[1] + (y + 0.5) * cell_m
            if np.hypot(x_m, y_m) > reach_m + cell_m:
                label[x, y] = 0


@kernel
def _close_area(label: Labels, low_m: Array, cell_m: float, ring_m: Array, within: bool) -> None:
    """Set the cells to 0 that lie wholly inside a polygon (k, 2), or outside: those that no edge meets."""
    wide, high = label.shape
    flips, met = np.zeros((wide + 1, high), np.bool_), np.zeros((wide, high), np.bool_)
    for k in range(len(ring_m)):
        x_m, y_m = ring_m[k, 0] - low_m[0], ring_m[k, 1] - low_m[1]
        after = (k + 1) % len(ring_m)
        way_x_m, way_y_m = ring_m[after, 0] - ring_m[k, 0], ring_m[after, 1] - ring_m[k, 1]
        steps = int(np.ceil(STEPS_IN_CELL * np.hypot(way_x_m, way_y_m) / cell_m)) + 1
        for step in range(steps + 1):
            x = int((x_m + way_x_m * step / steps) / cell_m)
            y = int((y_m + way_y_m * step / steps) / cell_m)
            if 0 <= x < wide and 0 <= y < high:
                met[x, y] = True
        for y in range(high):
            from_m = (y + 0.5) * cell_m - y_m
            if (from_m < 0.0) != (from_m < way_y_m):
                crossed = (x_m + from_m * way_x_m / way_y_m) / cell_m
                x = min(max(int(np.ceil(crossed - 0.5)), 0), wide)
                flips[x, y] = not flips[x, y]
    for y in range(high):
        inside = False
        for x in range(wide - 1, -1, -1):
            inside = inside != flips[x + 1, y]
            if inside == within and not met[x, y]:
                label[x, y] = 0


@kernel
def _fill(label: Labels) -> None:
    """Number what is connected where the cells (k, l) are negative: from `OUTSIDE` on, a corner first.

    `scipy.ndimage.label` does the same, and takes 0.4 s to load: in the tick that first has a box.
    """
    wide, high = label.shape
    stack, number = np.empty((wide * high, 2), np.int64), OUTSIDE
    for x in range(wide):
        for y in range(high):
            if label[x, y] >= 0:
                continue
            label[x, y], stack[0, 0], stack[0, 1], left = number, x, y, 1
            while left:
                left -= 1
                at_x, at_y = stack[left, 0], stack[left, 1]
                for step_x, step_y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
                    to_x, to_y = at_x + step_x, at_y + step_y
                    if 0 <= to_x < wide and 0 <= to_y < high and label[to_x, to_y] < 0:
                        label[to_x, to_y] = number
                        stack[left, 0], stack[left, 1] = to_x, to_y
                        left += 1
            number += 1


@kernel
def _apart(label: Labels, begins: NDArray[np.int64], ends: NDArray[np.int64]) -> Mask:
    """(k,) Between which cells (k, 2) no way leads."""
    apart = np.zeros(len(begins), np.bool_)
    for i in range(len(begins)):
        begin, end = label[begins[i, 0], begins[i, 1]], label[ends[i, 0], ends[i, 1]]
        if begin > 0 and end > 0:
            apart[i] = begin != end
            continue
        near_begin, near_end = _led_out(label, begins[i]), _led_out(label, ends[i])
        apart[i] = len(near_begin) > 0 and len(near_end) > 0
        for label_there in near_begin:
            for label_here in near_end:
                apart[i] = apart[i] and label_there != label_here
    return apart


@kernel
def _led_out(label: Labels, cell: NDArray[np.int64]) -> Labels:
    """(k,) The labels of the nearest cells outside the boxes, of a cell (2,); none: they are too far."""
    for ring in range(RINGS):
        around, count = np.empty(8 * ring + 8, np.int32), 0
        for x in range(max(cell[0] - ring, 0), min(cell[0] + ring + 1, label.shape[0])):
            for y in range(max(cell[1] - ring, 0), min(cell[1] + ring + 1, label.shape[1])):
                on_ring = max(abs(x - cell[0]), abs(y - cell[1])) == ring
                if on_ring and label[x, y] > 0:
                    around[count] = label[x, y]
                    count += 1
        if count:
            return around[:count]
    return np.empty(0, np.int32)


def warm_up() -> None:
    """Compile or load the kernels, so that nothing is compiled in flight."""
    enclosures = Enclosures.of([Ellipse(0.0, 0.0, 5.0, 5.0, 50.0)], 0.0)
    if enclosures is not None:
        enclosures.apart(np.zeros((1, 3)), np.ones((1, 3)))
        _close_beyond(enclosures.label, enclosures.low_m, 1.0, 10.0)
        _close_area(enclosures.label, enclosures.low_m, 1.0, np.eye(3)[:, :2].copy(), True)
