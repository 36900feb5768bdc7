"""The best known shapes (Thomson problem) for the fleets that are judged.

`best.npz` beside this file has them for N = 2 to 32 and some larger N. `write` made it; it is run with
`python -m gcs.simulation.reference_shapes`.
"""

from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
import scipy

from gcs.model.state import Array
from gcs.simulation.pair_metrics import energy_and_gradient, energy_and_nearest

KEPT = (*range(2, 33), 40, 45, 48, 50, 52, 60, 64, 72, 90, 100, 128, 150, 180, 190, 200)
STARTS = 60
FEW_STARTS = 6


def search(charge: Array, starts: int, seed: int = 0) -> Array:
    """Search with several descents from random starts, for charges (n,). Returns: (n, 3) unit vectors."""
    count = len(charge)
    random = np.random.default_rng(seed)
    least, found = np.inf, np.zeros((count, 3))
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
            least, found = float(result.fun), np.asarray(result.x).reshape(count, 3)
    unit: Array = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit


def best(charges: int | tuple[float, ...]) -> Array:
    """(n, 3) unit vectors of the best known configuration; searched for if not stored.

    `charges` are those of n vehicles, or the number of vehicles with equal charges.
    """
    if isinstance(charges, int) or len(set(charges)) == 1:
        return _best_alike(charges if isinstance(charges, int) else len(charges))
    return _best_unlike(charges)


@cache
def _best_alike(count: int) -> Array:
    with resources.as_file(resources.files("gcs.simulation") / "best.npz") as file, np.load(file) as kept:
        if str(count) in kept:
            unit = kept[str(count)].astype(np.float64)
            return np.asarray(unit / np.linalg.norm(unit, axis=1, keepdims=True))
    return search(np.ones(count), FEW_STARTS)


@cache
def _best_unlike(charges: tuple[float, ...]) -> Array:
    return search(np.array(charges), STARTS)


@cache
def best_figures(charges: int | tuple[float, ...]) -> tuple[float, float]:
    """Energy and nearest distance of `best`, on the unit sphere."""
    charge = np.ones(charges) if isinstance(charges, int) else np.array(charges)
    energy, nearest = energy_and_nearest(best(charges), charge)
    return float(energy), float(nearest)


def write(path: Path) -> None:
    """Search all shapes and store them; takes some minutes."""
    found = {str(count): search(np.ones(count), STARTS) for count in KEPT}
    np.savez_compressed(path, **{name: unit.astype(np.float32) for name, unit in found.items()})  # type: ignore[arg-type]


if __name__ == "__main__":
    write(Path(__file__).with_name("best.npz"))
