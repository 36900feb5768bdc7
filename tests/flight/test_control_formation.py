"""From the ground grid onto the sphere: the shapes the article promises, with no violation on the way."""

import numpy as np
import pytest

from gcs.model.plan import Formation
from tests.support.control_flight import SETTINGS, Flight, Sample, closest_m_and_violations, shape

RADIUS_M = {4: 8.0, 8: 10.0}


def assemble(count: int, *, noise_scale: float) -> list[Sample]:
    flight = Flight(count, Formation(RADIUS_M[count], 20.0), noise_scale=noise_scale)
    return flight.run(40.0)


@pytest.fixture(scope="module", params=[4, 8])
def calm(request: pytest.FixtureRequest) -> list[Sample]:
    return assemble(request.param, noise_scale=0.0)


@pytest.fixture(scope="module", params=[4, 8])
def noisy(request: pytest.FixtureRequest) -> list[Sample]:
    return assemble(request.param, noise_scale=1.0)


def test_four_form_a_tetrahedron_eight_a_square_antiprism(calm: list[Sample]) -> None:
    energy_ratio, nearest_ratio, radius_error_m = shape(calm[-100:])
    assert energy_ratio <= 1.002
    assert nearest_ratio >= 0.97
    assert radius_error_m < 0.05


def test_shapes_form_on_noisy_estimates(noisy: list[Sample]) -> None:
    energy_ratio, nearest_ratio, radius_error_m = shape(noisy[-400:])
    assert energy_ratio <= 1.002
    assert nearest_ratio >= 0.97
    assert radius_error_m < 0.5


def test_floor_holds_during_assembly(calm: list[Sample]) -> None:
    closest_m, violations = closest_m_and_violations(calm)
    assert violations == 0
    assert closest_m > SETTINGS.safety.floor.horizontal_m


def test_true_separation_keeps_the_floor_with_wrong_estimates(noisy: list[Sample]) -> None:
    assert closest_m_and_violations(noisy)[1] == 0


def test_all_are_on_the_sphere_within_15_seconds(calm: list[Sample]) -> None:
    sample = calm[300]
    radius_m = np.linalg.norm(sample.position_m - sample.center_m, axis=1)
    assert np.abs(radius_m - sample.tick.memory.radius_m).max() < 0.5


def test_no_vehicle_flies_below_the_least_height(noisy: list[Sample]) -> None:
    lowest_m = min(float(-sample.position_m[:, 2].max()) for sample in noisy)
    assert lowest_m > SETTINGS.safety.fence.height_min_m


@pytest.mark.soak
def test_the_same_start_and_the_same_noise_give_the_same_flight() -> None:
    first, second = (
        Flight(4, Formation(8.0, 20.0), noise_scale=1.0, seed=3).run(2.0)[-1].position_m for _ in range(2)
    )
    assert first.tolist() == second.tolist()
