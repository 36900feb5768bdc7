"""The grid that many are sorted into finds what looking at every pair finds."""

import numpy as np
import pytest

from gcs.safety.neighbours import FEW, near_pairs

SPREADS = [(400.0, 0.5, 3.0), (60.0, 0.0, 1.0), (8.0, 8.0, 1.5)]


@pytest.mark.parametrize(
    ("axis", "along_m", "across_m", "look_m"),
    [(0, 0.3, 0.3, 1.0), *((axis, *spread) for spread in SPREADS for axis in range(3))],
)
def test_pairs_of_many_are_found_in_any_distribution(
    axis: int, along_m: float, across_m: float, look_m: float
) -> None:
    rng = np.random.default_rng(axis)
    position = rng.uniform(-across_m, across_m, (FEW + 40, 3))
    position[:, axis] = rng.uniform(-along_m, along_m, FEW + 40)
    position[:5, axis] *= 30.0  # far out: in the outermost cells
    all_vehicles, radius = np.ones(FEW + 40, dtype=bool), rng.uniform(0.5 * look_m, look_m, FEW + 40)
    first, second = near_pairs(all_vehicles, position, all_vehicles, radius)
    i, j = np.triu_indices(FEW + 40, 1)
    near = np.linalg.norm(position[i] - position[j], axis=1) < radius[i] + radius[j]
    found = np.sort(np.column_stack([first, second]), axis=1)
    assert sorted(map(tuple, found.tolist())) == list(zip(i[near].tolist(), j[near].tolist(), strict=True))
