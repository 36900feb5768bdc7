"""Mutual repulsion on the unit sphere (article, section 2.2; the Thomson problem)."""

from math import sqrt
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.far_field import COINCIDENT, pushes_by_cells
from gcs.model.jit import kernel, kernel_in_any_order
from gcs.model.state import Array

STIFFEST_MODE = 0.22
"""Largest eigenvalue of the unit-charge energy's Hessian on the unit sphere, over N^1.5.

Measured for the best known configurations of N = 3 to 100: 0.13 to 0.216, levelling off. Dividing by it
makes one sweep settle the stiffest mode, whatever N is.
"""

MOMENTUM = 0.9
"""Share of the last sweep's change that the next begins with: soft modes settle ten times faster."""

SWEEP_MAX_RAD = 0.05
"""Largest push of one sweep: crowded starts push hard, and the order must not be lost."""

CHANGE_MAX_RAD = 0.2
"""Largest change by momentum in one sweep."""

COARSE = 1000
"""Up to this many vehicles; with more both bounds shrink like the distance of neighbours, 3.5 / sqrt(N) rad.
Pushed farther than that, two that are too close end close to others, and the fleet never comes to rest.
"""

MUTUAL_FROM = 500
"""Larger fleets sum both pushes of a pair at once. Below this size that costs more than it saves."""

CELLS_FROM = 2000
"""Larger fleets sum the pushes of far vehicles by cells: 10,000 take 5 ms for it, 31 ms pair by pair."""

Flat: TypeAlias = NDArray[np.float32]


@kernel
def _set_unit(out: Array, base: Array, step: Array, share: float) -> None:
    """Write the direction of ``base + share step`` to `out`, (3,) each."""
    a, b, c = base[0] + share * step[0], base[1] + share * step[1], base[2] + share * step[2]
    length = sqrt(a * a + b * b + c * c)
    out[0], out[1], out[2] = a / length, b / length, c / length


@kernel
def pushes(direction: Array, charge: Array) -> Array:
    """The article's repulsion of every pair, (n, 3), for (n, 3) unit vectors and (n,) charges.

    Single precision is enough for the shape and several times as fast.
    """
    n = len(direction)
    if n > CELLS_FROM:
        return pushes_by_cells(direction, charge)
    even = n + n % 2  # with one that does not push
    place, push = np.zeros((3, even), np.float32), np.zeros((3, even), np.float32)
    single = np.zeros(even, np.float32)
    place[:, :n], single[:n] = direction.T, charge
    if n <= MUTUAL_FROM:
        for j in range(0, even, 2):
            _push_all(place, single, j, push)
    else:
        for j in range(0, even, 2):
            _push_mutually(place, single, j, push)
    total = np.empty((n, 3))
    for i in range(n):
        for k in range(3):
            total[i, k] = charge[i] * push[k, i]
    return total


@kernel
def _push_all(place: Flat, charge: Flat, j: int, push: Flat) -> None:
    """Add to (3, n) the pushes of j and of the next on every vehicle, in this order.

    Without a sum in the loop, so that it is vectorised; two at a time, so that less is read and written.
    """
    x, y, z, q = place[0, j], place[1, j], place[2, j], charge[j]
    next_x, next_y, next_z, next_q = place[0, j + 1], place[1, j + 1], place[2, j + 1], charge[j + 1]
    for i in range(len(charge)):
        dx, dy, dz = place[0, i] - x, place[1, i] - y, place[2, i] - z
        square = dx * dx + dy * dy + dz * dz + COINCIDENT
        strength = q / (square * np.sqrt(square))
        next_dx, next_dy, next_dz = place[0, i] - next_x, place[1, i] - next_y, place[2, i] - next_z
        square = next_dx * next_dx + next_dy * next_dy + next_dz * next_dz + COINCIDENT
        next_strength = next_q / (square * np.sqrt(square))
        push[0, i] = push[0, i] + strength * dx + next_strength * next_dx
        push[1, i] = push[1, i] + strength * dy + next_strength * next_dy
        push[2, i] = push[2, i] + strength * dz + next_strength * next_dz


@kernel_in_any_order
def _push_mutually(place: Flat, charge: Flat, j: int, push: Flat) -> None:
    """Add to (3, n) the pushes between j, the next, and those before both: half the roots, but with sums.

    Two at a time, so that less is read and written.
    """
    x, y, z, q = place[0, j], place[1, j], place[2, j], charge[j]
    next_x, next_y, next_z, next_q = place[0, j + 1], place[1, j + 1], place[2, j + 1], charge[j + 1]
    own_x, own_y, own_z = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    other_x, other_y, other_z = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for i in range(j):
        dx, dy, dz = place[0, i] - x, place[1, i] - y, place[2, i] - z
        square = dx * dx + dy * dy + dz * dz + COINCIDENT
        inverse = np.float32(1.0) / (square * np.sqrt(square))
        their_part, ours = q * inverse, charge[i] * inverse
        next_dx, next_dy, next_dz = place[0, i] - next_x, place[1, i] - next_y, place[2, i] - next_z
        square = next_dx * next_dx + next_dy * next_dy + next_dz * next_dz + COINCIDENT
        inverse = np.float32(1.0) / (square * np.sqrt(square))
        next_theirs, next_ours = next_q * inverse, charge[i] * inverse
        push[0, i] += their_part * dx + next_theirs * next_dx
        push[1, i] += their_part * dy + next_theirs * next_dy
        push[2, i] += their_part * dz + next_theirs * next_dz
        own_x, own_y, own_z = own_x + ours * dx, own_y + ours * dy, own_z + ours * dz
        other_x += next_ours * next_dx
        other_y += next_ours * next_dy
        other_z += next_ours * next_dz
    dx, dy, dz = x - next_x, y - next_y, z - next_z
    square = dx * dx + dy * dy + dz * dz + COINCIDENT
    inverse = np.float32(1.0) / (square * np.sqrt(square))
    push[0, j] += next_q * inverse * dx - own_x
    push[1, j] += next_q * inverse * dy - own_y
    push[2, j] += next_q * inverse * dz - own_z
    push[0, j + 1] -= q * inverse * dx + other_x
    push[1, j + 1] -= q * inverse * dy + other_y
    push[2, j + 1] -= q * inverse * dz + other_z


@kernel
def sweep(
    direction: Array, change: Array, true_direction: Array, charge: Array, sweeps: int, pull: float
) -> tuple[Array, Array]:
    """Descend the energy of the charges on the unit sphere by some sweeps.

    Accelerated (Nesterov 1983), restarted whenever a sweep works against the change so far (O'Donoghue
    and Candes 2015). The step settles the stiffest mode.

    Args:
        direction: (n, 3) unit vectors.
        change: (n, 3) of the last sweep.
        true_direction: (n, 3) unit vectors to the vehicles' positions.
        charge: (n,) above 0.
        sweeps: how many.
        pull: share of the way to the true direction that each sweep adds.

    Returns: (n, 3) unit vectors, and (n, 3) the last sweep's change.

    Source: article, section 2.2, on the unit sphere (the Thomson problem).
    """
    n = len(direction)
    finer = sqrt(min(1.0, COARSE / max(n, 1)))
    sweep_max_rad, change_max_rad = finer * SWEEP_MAX_RAD, finer * CHANGE_MAX_RAD
    stride = 1.0 / (STIFFEST_MODE * max(n, 2) ** 1.5 * charge.mean() * charge.max())
    here, change, ahead = direction.copy(), change.copy(), np.empty((n, 3))
    for _ in range(sweeps):
        for i in range(n):
            _set_unit(ahead[i], here[i], change[i], MOMENTUM)
        push = pushes(ahead, charge)
        work = 0.0
        for i in range(n):
            outward = 0.0
            for k in range(3):
                outward += push[i, k] * ahead[i, k]
            square = 0.0
            for k in range(3):
                push[i, k] = stride * (push[i, k] - outward * ahead[i, k])
                push[i, k] += pull * (true_direction[i, k] - ahead[i, k])
                square += push[i, k] ** 2
                work += push[i, k] * change[i, k]
            if square > sweep_max_rad**2:
                push[i] *= sweep_max_rad / sqrt(square)
        for i in range(n):
            _set_unit(ahead[i], ahead[i], push[i], 1.0)
            square = 0.0
            for k in range(3):
                change[i, k] = ahead[i, k] - here[i, k] if work >= 0.0 else 0.0
                square += change[i, k] ** 2
                here[i, k] = ahead[i, k]
            if square > change_max_rad**2:
                change[i] *= change_max_rad / sqrt(square)
    return here, change


def sweeps_for(count: int, most: int, number: int) -> int:
    """Number of sweeps in a tick: `most`, but no more pairs than one sweep of `COARSE` has.

    Of larger fleets it is one in every second tick; `number` is that of the tick.
    """
    return min(most, COARSE**2 // max(count, 1) ** 2) or number % 2


NEAREST_FACTOR: Final = 3.1
"""Smallest nearest-neighbour distance of the best configurations times sqrt(N) / R, N = 4 to 128."""

NEAREST_FACTOR_FEW: Final = {2: 2.0 * sqrt(2.0), 3: 3.0}
"""The same for a pair (2 R apart) and a triangle (sqrt(3) R)."""


def energy(direction: Array) -> float:
    """Coulomb energy of unit charges at (n, 3) unit vectors: the sum of 1 / distance over pairs."""
    first, second = np.triu_indices(len(direction), 1)
    return float((1.0 / np.linalg.norm(direction[first] - direction[second], axis=1)).sum())


def nearest_m(position_m: Array) -> float:
    """Smallest distance between any two of (n, 3) points, n at least 2; same unit as the points."""
    first, second = np.triu_indices(len(position_m), 1)
    return float(np.linalg.norm(position_m[first] - position_m[second], axis=1).min())


def smallest_radius_m(count: int, separation_m: float) -> float:
    """The smallest sphere on which `count` vehicles settle no closer than `separation_m` to each other."""
    if count < 2:
        return 0.0
    return separation_m * sqrt(count) / NEAREST_FACTOR_FEW.get(count, NEAREST_FACTOR)
