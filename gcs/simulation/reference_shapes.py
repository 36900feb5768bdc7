"""The best known shapes (Thomson problem) for the fleets that are judged, and their energy.

`best.npz` beside this file has them for N = 2 to 32 and some larger N. `write` made it; it is run with
`python -m gcs.simulation.reference_shapes`. The energy is deliberately computed without the code that flies.
"""

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
import scipy

from gcs.formation.repulsion import NEAREST_FACTOR
from gcs.model.jit import kernel
from gcs.model.state import Array


@kernel
def energy_and_nearest(direction: Array, charge: Array) -> tuple[float, float]:
    """Coulomb energy of charges (n,) at (n, 3) unit vectors; the smallest distance."""
    n = len(direction)
    total, least2 = 0.0, 4.0
    for i in range(n):
        x, y, z = direction[i, 0], direction[i, 1], direction[i, 2]
        for j in range(i + 1, n):
            dx, dy, dz = direction[j, 0] - x, direction[j, 1] - y, direction[j, 2] - z
            distance2 = dx * dx + dy * dy + dz * dz
            least2 = min(least2, distance2)
            total += charge[i] * charge[j] / np.sqrt(max(distance2, 1e-18))
    return total, np.sqrt(least2)


@kernel
def energy_and_gradient(flat: Array, charge: Array) -> tuple[float, Array]:
    """Energy of charges (n,) at the directions of n points, (3 n,) flattened; its gradient, (3 n,)."""
    n = len(flat) // 3
    points = flat.reshape(n, 3)
    length = np.empty(n)
    direction = np.empty((n, 3))
    for i in range(n):
        length[i] = np.sqrt(points[i, 0] ** 2 + points[i, 1] ** 2 + points[i, 2] ** 2)
        direction[i] = points[i] / length[i]
    pull = np.zeros((n, 3))
    total = 0.0
    for i in range(n):
        for j in range(i + 1, n):
            dx = direction[i, 0] - direction[j, 0]
            dy = direction[i, 1] - direction[j, 1]
            dz = direction[i, 2] - direction[j, 2]
            inverse = 1.0 / np.sqrt(max(dx * dx + dy * dy + dz * dz, 1e-18))
            both = charge[i] * charge[j]
            total += both * inverse
            cube = both * inverse * inverse * inverse
            pull[i, 0] -= dx * cube
            pull[i, 1] -= dy * cube
            pull[i, 2] -= dz * cube
            pull[j, 0] += dx * cube
            pull[j, 1] += dy * cube
            pull[j, 2] += dz * cube
    gradient = np.empty(3 * n)
    for i in range(n):
        along = pull[i, 0] * direction[i, 0] + pull[i, 1] * direction[i, 1] + pull[i, 2] * direction[i, 2]
        for axis in range(3):
            gradient[3 * i + axis] = (pull[i, axis] - direction[i, axis] * along) / length[i]
    return total, gradient


KEPT = (*range(2, 33), 40, 45, 48, 50, 52, 60, 64, 72, 90, 100, 128, 150, 180, 190, 200)
STARTS = 60
FEW_STARTS = 6


def search(charge: Array, starts: int, seed: int = 0) -> Array:
    """Search with several descents from random starts, for charges (n,). Returns: (n, 3) unit vectors."""
    count = len(charge)
    random = np.random.default_rng(seed)
    least, best = np.inf, np.zeros((count, 3))
    for _ in range(starts):
        begin = random.normal(size=3 * count)
        result = scipy.optimize.minimize(
            energy_and_gradient,
            begin,
            args=(charge,),
            jac=True,
            method="L-BFGS-B",
            options={"ftol": 1e-15, "gtol": 1e-8, "maxiter": 5000, "maxfun": 50_000},
        )
        if float(result.fun) < least:
            least, best = float(result.fun), np.asarray(result.x).reshape(count, 3)
    unit: Array = best / np.linalg.norm(best, axis=1, keepdims=True)
    return unit


@cache
def best(charges: int | tuple[float, ...]) -> Array:
    """(n, 3) unit vectors of the best known configuration; searched for if not stored.

    `charges` are those of n vehicles, or the number of vehicles with equal charges.
    """
    if not isinstance(charges, int):
        return best(len(charges)) if len(set(charges)) == 1 else search(np.array(charges), STARTS)
    with resources.as_file(resources.files("gcs.simulation") / "best.npz") as file, np.load(file) as kept:
        if str(charges) in kept:
            unit = kept[str(charges)].astype(np.float64)
            return np.asarray(unit / np.linalg.norm(unit, axis=1, keepdims=True))
    return search(np.ones(charges), FEW_STARTS)


SEARCHED_MOST = 2000
"""A search for more equal charges takes too long: their figures follow from the known law of growth."""


@cache
def best_figures(charges: int | tuple[float, ...]) -> tuple[float, float]:
    """Energy and nearest distance of `best`, on the unit sphere.

    Source for large numbers: the fit of the Thomson problem's energies, N^2 / 2 (1 + a N^-1/2 + b N^-3/2).
    """
    count = charges if isinstance(charges, int) else len(charges)
    if count > SEARCHED_MOST and (isinstance(charges, int) or len(set(charges)) == 1):
        return count**2 / 2 * (1.0 - 1.10461 * count**-0.5 + 0.137 * count**-1.5), NEAREST_FACTOR / count**0.5
    charge = np.ones(charges) if isinstance(charges, int) else np.array(charges)
    energy, nearest = energy_and_nearest(best(charges), charge)
    return float(energy), float(nearest)


def write(path: Path) -> None:
    """Search all shapes and store them; takes some minutes."""
    unit_of = {str(count): search(np.ones(count), STARTS) for count in KEPT}
    np.savez_compressed(path, **{name: unit.astype(np.float32) for name, unit in unit_of.items()})  # type: ignore[arg-type]


if __name__ == "__main__":
    write(Path(__file__).with_name("best.npz"))
