"""A vehicle on a drawn trajectory follows it, catches up within its limits, and stops without a goal."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.control.inputs import DrawnGoals, Task, Tasks
from gcs.formation.trajectory import led_share, trajectory_velocity
from gcs.model.errors import ShapeError
from gcs.model.state import Array

RATE_PER_S, CORRECTION_M_S = 1.0, 4.0
LIMITS_M_S = (8.0, 2.5, 1.4)


def velocity_m_s(position_m: Array, goal_m: Array, goal_m_s: Array) -> Array:
    return trajectory_velocity(
        position_m,
        goal_m,
        goal_m_s,
        rate_per_s=RATE_PER_S,
        correction_max_m_s=np.full(len(position_m), CORRECTION_M_S),
        limits_m_s=LIMITS_M_S,
    )


def of(*rows: tuple[float, float, float]) -> Array:
    return np.array(rows, dtype=np.float64)


def test_on_its_trajectory_it_flies_the_drawn_velocity() -> None:
    here_m = of((3.0, 4.0, -20.0))
    assert velocity_m_s(here_m, here_m, of((1.0, -2.0, 0.5))) == pytest.approx(of((1.0, -2.0, 0.5)))


def test_behind_it_flies_faster_and_ahead_slower() -> None:
    goal_m, goal_m_s = of((0.0, 0.0, -20.0), (0.0, 0.0, -20.0)), of((2.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    position_m = goal_m + of((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert velocity_m_s(position_m, goal_m, goal_m_s)[:, 0] == pytest.approx([3.0, 1.0])


def test_a_climb_beyond_its_limit_costs_nothing_sideways() -> None:
    here_m = of((0.0, 0.0, -20.0))
    assert velocity_m_s(here_m, here_m, of((3.0, 0.0, -6.0))) == pytest.approx(of((3.0, 0.0, -2.5)))


def test_without_a_goal_it_stops() -> None:
    none = of((np.nan, np.nan, np.nan))
    assert velocity_m_s(of((1.0, 2.0, -9.0)), none, none) == pytest.approx(of((0.0, 0.0, 0.0)))


def test_a_vehicle_held_back_is_not_led() -> None:
    goal_m_s = of((2.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    allowed_m_s = of((2.0, 0.3, 0.0), (1.25, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert led_share(allowed_m_s, goal_m_s)[:, 0] == pytest.approx([1.0, 0.5, 0.0])


meters = st.floats(-200.0, 200.0)
places = st.tuples(meters, meters, meters)
speeds = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))


@given(places, places, speeds)
def test_no_velocity_exceeds_a_limit(
    here: tuple[float, float, float], goal: tuple[float, float, float], moves: tuple[float, float, float]
) -> None:
    found = velocity_m_s(of(here), of(goal), of(moves))[0]
    horizontal_m_s, up_m_s, down_m_s = LIMITS_M_S
    assert np.hypot(found[0], found[1]) <= horizontal_m_s + 1e-9
    assert -up_m_s <= found[2] <= down_m_s


@pytest.mark.soak
@pytest.mark.long
@given(places, st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-1.0, 0.4)))
def test_the_error_decays(away: tuple[float, float, float], moves: tuple[float, float, float]) -> None:
    """A vehicle that flies what it should is on its trajectory in the end, and never farther than before."""
    dt_s, goal_m_s = 0.05, of(moves)
    goal_m = of((0.0, 0.0, -300.0))
    position_m = goal_m + of(away)
    off_m = np.linalg.norm(position_m - goal_m)
    for _ in range(int((off_m / 0.9 + 12.0) / dt_s)):
        position_m = position_m + dt_s * velocity_m_s(position_m, goal_m, goal_m_s)
        goal_m = goal_m + dt_s * goal_m_s
        now_m = np.linalg.norm(position_m - goal_m)
        assert now_m <= off_m + 1e-9
        off_m = now_m
    assert off_m < 0.05


def goals(*positions: tuple[float, float, float]) -> DrawnGoals:
    position_m = of(*positions)
    return DrawnGoals(position_m, np.zeros_like(position_m), np.zeros_like(position_m))


NOWHERE = (np.nan, np.nan, np.nan)


def test_a_drawing_leads_only_vehicles_in_formation() -> None:
    tasks = Tasks.of_formation(3, center_moves=True)
    mixed = Tasks(
        np.array([Task.FORMATION, Task.GOAL, Task.FORMATION], dtype=np.int8),
        of(NOWHERE, (5.0, 5.0, -5.0), NOWHERE),
        tasks.airborne,
        tasks.descending,
        tasks.segments_m,
    )
    drawn = goals((1.0, 1.0, -9.0), (2.0, 2.0, -9.0), NOWHERE)
    flown = mixed.led_by(drawn, moves=True)
    assert flown.task.tolist() == [Task.DRAWN, Task.GOAL, Task.DRAWN]
    approached = mixed.led_by(drawn, moves=False)
    assert approached.task.tolist() == [Task.GOAL, Task.GOAL, Task.DRAWN]
    assert approached.goal_m[:2].tolist() == [[1.0, 1.0, -9.0], [5.0, 5.0, -5.0]]


def test_goals_of_different_shapes_are_refused() -> None:
    with pytest.raises(ShapeError, match="velocity_m_s"):
        DrawnGoals(np.zeros((2, 3)), np.zeros((3, 3)), np.zeros((2, 3)))
