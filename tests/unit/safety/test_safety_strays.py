"""What the filter leaves out at first, because no vehicle was expected there, breaks nothing."""

from dataclasses import replace

import numpy as np
import pytest

import gcs.safety.filter as whole
from gcs.model.state import Array
from gcs.safety.constraints import NO_ROW, nearest
from gcs.safety.filter import filter_velocities
from gcs.safety.neighbours import Rows
from gcs.safety.separation import separation_constraints
from gcs.safety.surroundings import SafetySettings, Surroundings
from gcs.safety.walls import Fence

SETTINGS = SafetySettings(fence=Fence(height_min_m=0.1, height_max_m=1e4, distance_max_m=1e4))


def around(position_m: Array, velocity_m_s: Array) -> Surroundings:
    count = len(position_m)
    everyone = np.ones(count, dtype=bool)
    ids = tuple(f"d{i}" for i in range(count))
    no_vehicle = np.zeros((0, 2, 3))
    none, limits = np.zeros(count), np.full(count, np.inf)
    return Surroundings(
        position_m,
        velocity_m_s,
        everyone,
        everyone,
        ~everyone,
        no_vehicle,
        {},
        ids,
        none,
        limits,
        np.zeros((count, 3)),
        none,
    )


def crowd(count: int, seed: int, *, squeezed: int) -> tuple[Array, Array]:
    """Places on a shaken lattice and wanted velocities; a few want fast into the others."""
    random = np.random.default_rng(seed)
    side = round(count ** (1.0 / 3.0))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    position_m = 4.5 * lattice + random.normal(0.0, 0.2, (side**3, 3)) - (0.0, 0.0, 200.0)
    desired_m_s = random.normal(0.0, 0.1, (side**3, 3))
    rows = random.choice(side**3, squeezed, replace=False)
    desired_m_s[rows] = random.normal(0.0, 3.0, (squeezed, 3))
    return position_m, desired_m_s


def least_slack_at_rest_m_s(allowed_m_s: Array, here: Surroundings) -> float:
    """Distance from breaking any constraint that vehicles at rest keep, of all pairs."""
    pairs = separation_constraints(
        here.position_m,
        here.velocity_m_s,
        here.commanded,
        here.airborne,
        floor=SETTINGS.floor,
        braking=SETTINGS.braking,
        uncertainty_m=here.uncertainty_m,
        course_m_s=np.zeros_like(allowed_m_s),
        spare_m_s=np.full(len(allowed_m_s), 20.0),
        wander_m=here.wander_m,
    )
    assert (pairs.second != NO_ROW).all()
    closing_m_s = allowed_m_s[pairs.first] - allowed_m_s[pairs.second]
    slack_m_s = (pairs.normal * closing_m_s).sum(axis=1) - pairs.bound_m_s
    return float(slack_m_s[pairs.bound_m_s <= 0.0].min())


@pytest.mark.parametrize("seed", range(8))
def test_few_strays_break_no_constraint_with_a_partial_check(seed: int) -> None:
    position_m, desired_m_s = crowd(216, seed, squeezed=6)
    here = around(position_m, np.zeros_like(position_m))
    allowed_m_s, _ = filter_velocities(desired_m_s, here, SETTINGS)
    assert least_slack_at_rest_m_s(allowed_m_s, here) > -2e-3


@pytest.mark.parametrize("squeezed", [0, 6, 60])
def test_full_check_from_the_start_gives_the_same(squeezed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in range(4):
        position_m, desired_m_s = crowd(216, seed, squeezed=squeezed)
        here = around(position_m, np.zeros_like(position_m))
        allowed_m_s, _ = filter_velocities(desired_m_s, here, SETTINGS)
        with monkeypatch.context() as patch:
            patch.setattr(whole, "SPARE_M_S", 20.0)
            every_m_s, _ = filter_velocities(desired_m_s, here, SETTINGS)
        assert np.abs(allowed_m_s - every_m_s).max() < 2e-3


@pytest.mark.parametrize("wander_m", [0.5, 1.5])
def test_contradictory_margins_take_bounded_work_and_stay_safe(
    wander_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No vehicle answers its setpoints: margins of up to 13 m in a crowd with 4.5 m to the next."""
    position_m, desired_m_s = crowd(1000, 1, squeezed=500)
    flown_m_s = np.random.default_rng(2).normal(0.0, 1.5, position_m.shape)
    here = replace(around(position_m, flown_m_s), wander_m=np.full(len(position_m), wander_m))
    taken: list[int] = []

    def counted(desired_m_s: Array, first: Rows, second: Rows, normal: Array, bound_m_s: Array) -> Array:
        taken.append(len(first))
        return nearest(desired_m_s, first, second, normal, bound_m_s)

    monkeypatch.setattr(whole, "nearest", counted)
    allowed_m_s, _ = filter_velocities(desired_m_s, here, SETTINGS)
    assert sum(taken) < 0.5 * len(position_m) ** 2  # all pairs once
    assert least_slack_at_rest_m_s(allowed_m_s, here) > -2e-3
