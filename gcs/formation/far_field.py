"""Repulsion of large fleets: pairs that are near exactly, the rest from cells (Barnes and Hut 1986).

The unit cube about the sphere is divided into cells, and blocks of 2 x 2 x 2 cells. On a vehicle push all
vehicles of its own cell and of the cells near it one by one, each cell farther away like one charge at its
members' mean direction, and each block that is not near likewise.
"""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel, kernel_in_any_order
from gcs.model.state import Array

Flat: TypeAlias = NDArray[np.float32]
Rows: TypeAlias = NDArray[np.intp]

Charges: TypeAlias = tuple[Flat, Flat]
"""Directions (3, m) and charges (m,): of vehicles, or of cells or blocks, each as one charge."""

BLOCKS_OVER_ROOT = 0.08
"""Number of blocks along each axis of the cube over the square root of the number of vehicles: 8 of 10,000
vehicles, of which about 230 blocks and 900 cells meet the sphere.
"""

NEAR = 2.8
"""Cells are near when their mean directions are nearer than so many edges of a cell, and blocks likewise."""

COINCIDENT = np.float32(1e-9)
"""Added to squared distances, so that vehicles in one direction, and a vehicle and itself, do not push."""


@kernel
def pushes_by_cells(direction: Array, charge: Array) -> Array:
    """As `gcs.formation.repulsion.pushes`, with errors of 5 % of the push that 0.1 spacings cause.

    Args:
        direction: (n, 3) unit vectors.
        charge: (n,) above 0.
    """
    n, across = len(direction), max(1, round(BLOCKS_OVER_ROOT * np.sqrt(len(direction))))
    rows, number, start = _sorted_into_cells(direction, across)
    place, own = np.empty((3, n), np.float32), np.empty(n, np.float32)
    for a in range(n):
        own[a] = charge[rows[a]]
        for k in range(3):
            place[k, a] = direction[rows[a], k]
    vehicles, cells = (place, own), _as_one(place, own, start)
    first = _first_cells(number)
    blocks = _as_one(place, own, start[first])
    pushing = np.empty((3, n + len(number)), np.float32), np.empty(n + len(number), np.float32)
    push, pushed = np.empty((n, 3)), np.empty(3, np.float32)
    for c in range(len(number)):
        count = _gather(c, across, vehicles, cells, blocks, start, first, pushing)
        for a in range(start[c], start[c + 1]):
            _push_on(place[:, a], pushing[0], pushing[1], count, pushed)
            for k in range(3):
                push[rows[a], k] = own[a] * pushed[k]
    return push


@kernel
def _as_one(place: Flat, own: Flat, start: Rows) -> Charges:
    """(3, m) mean directions and (m,) charges of the members from each of `start` (m + 1,) to the next."""
    middle, whole = np.zeros((3, len(start) - 1), np.float32), np.zeros(len(start) - 1, np.float32)
    for c in range(len(whole)):
        for a in range(start[c], start[c + 1]):
            whole[c] += own[a]
            for k in range(3):
                middle[k, c] += own[a] * place[k, a]
        for k in range(3):
            middle[k, c] /= whole[c]
    return middle, whole


@kernel
def _gather(
    c: int,
    across: int,
    vehicles: Charges,
    cells: Charges,
    blocks: Charges,
    start: Rows,
    first: Rows,
    pushing: Charges,
) -> int:
    """Write to `pushing` what pushes on the members of cell c. Returns: how many.

    Args:
        c: place of the cell.
        across: number of blocks along each axis.
        vehicles: cell by cell.
        cells: each as one charge.
        blocks: each as one charge.
        start: where each cell begins in the vehicles, and their number.
        first: where each block begins in the cells, and their number.
        pushing: changed.
    """
    count, near, near_block = 0, (NEAR / across) ** 2, (2.0 * NEAR / across) ** 2
    for block in range(len(first) - 1):
        if _square_between(cells, c, blocks, block) >= near_block:
            _put(pushing, count, blocks, block)
            count += 1
            continue
        for d in range(first[block], first[block + 1]):
            if _square_between(cells, c, cells, d) >= near:
                _put(pushing, count, cells, d)
                count += 1
                continue
            for a in range(start[d], start[d + 1]):
                _put(pushing, count, vehicles, a)
                count += 1
    return count


@kernel
def _square_between(some: Charges, i: int, others: Charges, j: int) -> float:
    """Square of the distance between the directions of one charge and of another."""
    square = 0.0
    for k in range(3):
        square += (some[0][k, i] - others[0][k, j]) ** 2
    return square


@kernel
def _put(pushing: Charges, at: int, charges: Charges, j: int) -> None:
    """Write one charge to place `at`."""
    for k in range(3):
        pushing[0][k, at] = charges[0][k, j]
    pushing[1][at] = charges[1][j]


@kernel
def _first_cells(number: Rows) -> Rows:
    """(b + 1,) places of the first cell of each of b blocks in the cells' numbers (c,), and c."""
    new = np.ones(len(number) + 1, np.bool_)
    for c in range(1, len(number)):
        new[c] = number[c] // 8 != number[c - 1] // 8
    return np.flatnonzero(new)


@kernel
def _sorted_into_cells(direction: Array, across: int) -> tuple[Rows, Rows, Rows]:
    """Sort n vehicles into the cells of `across` blocks along each axis.

    Returns: (n,) rows cell by cell, (c,) numbers of the cells that hold any, and (c + 1,) where each begins
        in the rows. The cells of a block have numbers that follow each other.
    """
    n, cells = len(direction), 8 * across**3
    cell, start, rows = np.zeros(n, np.intp), np.zeros(cells + 1, np.intp), np.empty(n, np.intp)
    for i in range(n):
        block, inside = 0, 0
        for k in range(3):
            along = (direction[i, k] + 1.0) * across  # in cells, two to a block
            at = int(min(along, 2.0 * across - 1.0)) if along > 0.0 else 0
            block, inside = block * across + at // 2, 2 * inside + at % 2
        cell[i] = 8 * block + inside
        start[cell[i] + 1] += 1
    number = np.flatnonzero(start[1:])
    for c in range(cells):
        start[c + 1] += start[c]
    free = start[:-1].copy()
    for i in range(n):
        rows[free[cell[i]]] = i
        free[cell[i]] += 1
    return rows, number, np.append(start[number], n)


@kernel_in_any_order
def _push_on(place: Flat, there: Flat, charge: Flat, count: int, pushed: Flat) -> None:
    """Write to `pushed` (3,) the push of the first `count` charges `there` (3, ...) at `place` (3,)."""
    x, y, z = place[0], place[1], place[2]
    push_x, push_y, push_z = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for j in range(count):
        dx, dy, dz = x - there[0, j], y - there[1, j], z - there[2, j]
        square = dx * dx + dy * dy + dz * dz + COINCIDENT
        strength = charge[j] / (square * np.sqrt(square))
        push_x += strength * dx
        push_y += strength * dy
        push_z += strength * dz
    pushed[0], pushed[1], pushed[2] = push_x, push_y, push_z
