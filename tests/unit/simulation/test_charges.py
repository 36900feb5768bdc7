"""Unequal charges are judged against a best shape of their own."""

from math import sqrt

import numpy as np
import pytest

from gcs.simulation.reference_shapes import best, best_figures, energy_and_gradient, energy_and_nearest

UNLIKE = (1.0, 0.7, 1.4, 1.0, 0.7)


@pytest.mark.long
def test_pair_energy_is_charge_product_over_distance() -> None:
    opposite = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert energy_and_nearest(opposite, np.array([2.0, 3.0])) == pytest.approx((3.0, 2.0))
    assert best_figures((2.0, 3.0)) == pytest.approx((3.0, 2.0), rel=1e-6)


def test_the_gradient_is_the_slope_of_the_energy() -> None:
    flat, charge = np.random.default_rng(3).normal(size=15), np.array(UNLIKE)
    slopes = [
        (energy_and_gradient(flat + h, charge)[0] - energy_and_gradient(flat - h, charge)[0]) / 2e-6
        for h in 1e-6 * np.eye(15)
    ]
    assert energy_and_gradient(flat, charge)[1] == pytest.approx(slopes, abs=1e-6)


def test_equal_charges_scale_the_known_shape_by_their_product() -> None:
    assert best((0.5,) * 8) is best(8)
    assert best_figures((0.5,) * 8)[0] == pytest.approx(best_figures(8)[0] / 4.0)


@pytest.mark.soak
def test_heavy_charge_of_three_pushes_the_light_ones_together() -> None:
    shape = best((1.0, 1.0, 2.0))
    light_m = np.linalg.norm(shape[0] - shape[1])
    heavy_m = np.linalg.norm(shape[0] - shape[2])
    assert light_m < sqrt(3.0) < heavy_m
