"""Vehicles that would come together if all lost the ground station at once: START is refused."""

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.model.errors import RefusedError
from gcs.model.plan import Formation, Orbit, Plan, Target
from gcs.model.state import Array
from gcs.planning.setpoint_loss import (
    ACTIONS,
    Action,
    check_setpoint_loss,
    clashes,
    formation_m,
    turned_upright,
)
from gcs.safety.floor import Floor

FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, uncertainty_m=0.0)
CONTROL = ControlSettings()


def pads(count: int) -> Array:
    columns = int(np.ceil(np.sqrt(count)))
    return np.array([(4.0 * (i // columns), 4.0 * (i % columns), 0.0) for i in range(count)])


def found(
    position_m: list[tuple[float, float, float]],
    action: Action,
    *,
    home_m: Array | None = None,
    uncertainty_m: float = 0.0,
    speed_m_s: float = 0.0,
) -> list[tuple[int, int]]:
    n = len(position_m)
    return [
        (clash.first, clash.second)
        for clash in clashes(
            np.array(position_m),
            20.0 * pads(n) if home_m is None else home_m,
            action,
            floor=FLOOR,
            uncertainty_m=np.full(n, uncertainty_m),
            speed_m_s=speed_m_s,
            return_height_m=30.0,
        )
    ]


STACKED = [(0.0, 0.0, -20.0), (0.5, 0.0, -30.0), (20.0, 0.0, -20.0)]


@pytest.mark.parametrize("action", ["descend", "land"])
def test_upper_vehicle_descends_onto_the_lower(action: Action) -> None:
    assert found(STACKED, action) == [(0, 1)]


def test_holding_vehicles_stay_apart() -> None:
    assert found(STACKED, "hold") == []


@pytest.mark.parametrize(("apart_m", "clash"), [(1.4, True), (1.6, False)])
def test_beside_a_standing_vehicle_there_is_room_above_its_pad(apart_m: float, clash: bool) -> None:
    """2 m above it, where pads become exempt, the floor is still 2 sqrt(1 - (2/3)^2) = 1.49 m wide."""
    assert bool(found([(0.0, 0.0, -20.0), (apart_m, 0.0, -30.0)], "descend")) is clash


def test_at_one_height_they_descend_side_by_side() -> None:
    assert found([(0.0, 0.0, -20.0), (2.1, 0.0, -20.0)], "descend") == []


@pytest.mark.parametrize("action", ACTIONS)
def test_uncertainty_widens_the_separation(action: Action) -> None:
    beside = [(0.0, 0.0, -20.0), (2.5, 0.0, -20.0)]
    assert (0, 1) in found(beside, action, uncertainty_m=0.4)


def test_late_failsafe_flies_on_towards_a_stopped_vehicle() -> None:
    beside = [(0.0, 0.0, -20.0), (2.5, 0.0, -20.0)]
    assert found(beside, "hold") == []
    assert found(beside, "hold", speed_m_s=5.0) == [(0, 1)]


def test_return_paths_crossing_at_one_height_conflict() -> None:
    homes_m = np.array([(40.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    here = [(0.0, 10.0, -20.0), (40.0, 10.0, -25.0)]
    assert found(here, "return", home_m=homes_m) == [(0, 1)]
    assert found(here, "return", home_m=homes_m[::-1].copy()) == [], "side by side they do not"


def test_return_paths_at_separate_heights_do_not_conflict() -> None:
    homes_m = np.array([(40.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
    assert found([(0.0, 10.0, -40.0), (40.0, 10.0, -50.0)], "return", home_m=homes_m) == []


def test_lower_vehicle_climbs_into_the_upper() -> None:
    homes_m = np.array([(0.0, 30.0, 0.0), (0.0, -30.0, 0.0)])
    assert found([(0.0, 0.0, -10.0), (0.0, 0.5, -20.0)], "return", home_m=homes_m) == [(0, 1)]


def test_none_and_one_have_no_conflict() -> None:
    assert found([(0.0, 0.0, -20.0)], "descend") == []
    empty = np.zeros((0, 3))
    nothing = clashes(
        empty, empty, "return", floor=FLOOR, uncertainty_m=np.zeros(0), speed_m_s=0.0, return_height_m=30.0
    )
    assert nothing == []


def test_upright_turn_stacks_the_nearest_two_and_keeps_the_rest() -> None:
    center_m = np.array([1.0, 2.0, -30.0])
    before_m = center_m + np.random.default_rng(1).normal(size=(6, 3)) * 8.0
    after_m = turned_upright(before_m, center_m)
    distances = [np.linalg.norm(x_m[:, None] - x_m[None], axis=2) for x_m in (before_m, after_m)]
    assert distances[0] == pytest.approx(distances[1])
    assert np.linalg.norm(after_m - center_m, axis=1) == pytest.approx(
        np.linalg.norm(before_m - center_m, axis=1)
    )
    first, second = divmod(int(np.argmin(distances[0] + 1e9 * np.eye(6))), 6)
    assert np.hypot(*(after_m[first] - after_m[second])[:2]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("count", [1, 2, 4, 8, 20, 64, 100])
def test_the_predicted_formation_is_spread_over_the_sphere(count: int) -> None:
    plan = Plan(Formation(30.0, 40.0), target=Target(6.0, 4.0))
    place_m = formation_m(tuple(f"d{i}" for i in range(count)), pads(count), plan, CONTROL)
    assert np.linalg.norm(place_m - (6.0, 4.0, -40.0), axis=1) == pytest.approx(30.0)
    if count > 1:
        apart_m = np.linalg.norm(place_m[:, None] - place_m[None], axis=2) + 1e9 * np.eye(count)
        assert apart_m.min() > 2.5 * 30.0 / np.sqrt(count)


def refusal(count: int, action: Action, radius_m: float = 15.0, *, orbit_m: float = 0.0) -> str:
    """What START is refused with, "" when it is not."""
    try:
        check_setpoint_loss(
            tuple(f"d{i + 1}" for i in range(count)),
            pads(count),
            [("", Plan(Formation(radius_m, radius_m + 10.0), Orbit(orbit_m, 2.5), Target(6.0, 4.0)))],
            CONTROL,
            np.full(count, 0.35),
            action,
            30.0,
        )
    except RefusedError as refused:
        return str(refused)
    return ""


@pytest.mark.parametrize("count", [1, 2, 4, 8, 20])
def test_holding_is_safe_in_every_allowed_formation(count: int) -> None:
    assert refusal(count, "hold") == ""
    assert refusal(count, "hold", orbit_m=15.0) == ""


@pytest.mark.parametrize("action", ["descend", "land", "return"])
@pytest.mark.parametrize("count", [2, 4, 8, 100])
def test_conflicting_action_is_refused_with_pairs_and_a_better(count: int, action: Action) -> None:
    text = refusal(count, action, 40.0 if count == 100 else 15.0, orbit_m=15.0)
    assert f"'{action}' would bring d" in text
    assert " and d" in text
    assert "'hold' would keep them apart: set operation.setpoint_loss_action to it" in text
    assert "gcs params apply" in text


def test_sphere_too_small_for_any_action_is_reported() -> None:
    assert "no action would keep them apart: a larger radius is needed" in refusal(8, "hold", 3.0)


@pytest.mark.parametrize("action", ACTIONS)
def test_single_vehicle_may_take_any_action(action: Action) -> None:
    assert refusal(1, action) == ""


def test_spinning_formation_needs_room_and_its_cue_is_named() -> None:
    def refused_at(spin_rad_s: float) -> str:
        standing = Plan(Formation(12.0, 22.0), target=Target(6.0, 4.0))
        small = Plan(Formation(5.0, 22.0, spin_rad_s), target=Target(6.0, 4.0))
        try:
            check_setpoint_loss(
                tuple(f"d{i + 1}" for i in range(8)),
                pads(8),
                [("wide", standing), ("small", small)],
                CONTROL,
                np.full(8, 0.08),
                "hold",
                30.0,
            )
        except RefusedError as refused:
            return str(refused)
        return ""

    assert refused_at(0.0) == ""
    assert "at cue 'small'" in refused_at(3.0)
    assert "at cue 'small'" in refused_at(-3.0)
