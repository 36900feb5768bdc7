"""How surely a vehicle stops, and what half-spaces say."""

import numpy as np
import pytest

from gcs.model.errors import ShapeError
from gcs.safety.constraints import NO_ROW, Constraints
from gcs.safety.filter import filter_velocities
from tests.support.safety_world import BRAKING, FLOOR, SETTINGS, half_space, surroundings


def test_the_braking_speed_stops_within_the_gap() -> None:
    gap = np.array([0.0, 0.1, 1.0, 10.0])
    speed = BRAKING.speed_m_s(gap)
    assert speed * 0.5 + speed**2 / (2 * 1.5) == pytest.approx(gap)


def test_inside_the_gap_moving_away_is_demanded() -> None:
    assert BRAKING.speed_m_s(np.array([-2.0])) == pytest.approx([-1.0])


def test_closing_now_counts_for_the_lead_and_parting_earns_none() -> None:
    lead = BRAKING.model_copy(update={"lead_s": 0.5})
    settings = SETTINGS.model_copy(update={"braking": lead})
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    desired = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    for measured_m_s, gap_m in ((1.0, 4.0), (-1.0, 5.0)):
        closing = np.array([[measured_m_s, 0.0, 0.0], [-measured_m_s, 0.0, 0.0]])
        allowed, _ = filter_velocities(desired, surroundings(position, velocity=closing), settings)
        expected = float(BRAKING.speed_m_s(np.array([gap_m]))[0])
        assert allowed[0, 0] - allowed[1, 0] == pytest.approx(expected, abs=2e-3)


def test_slow_link_extrapolates_brakes_earlier_escapes_slower() -> None:
    assert BRAKING.over_link(0.0) is BRAKING
    late = BRAKING.over_link(0.2)
    assert (late.reaction_s, late.lead_s) == pytest.approx((0.9, BRAKING.lead_s + 0.4))
    assert late.deceleration_m_s2 == BRAKING.deceleration_m_s2
    assert late.escape_rate_per_s == pytest.approx(1.0 / (1.0 / 0.5 + 0.8))
    settings = SETTINGS.model_copy(update={"link_delay_s": 0.2})
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])
    closing = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    allowed, _ = filter_velocities(3.0 * closing, surroundings(position, velocity=closing), settings)
    gap_m = 5.0 - 0.2 * 2.0 - late.lead_s * 2.0  # where they are by now, and where that leads
    assert allowed[0, 0] - allowed[1, 0] == pytest.approx(
        float(late.speed_m_s(np.array([gap_m]))[0]), abs=2e-3
    )


def test_constraints_of_unequal_lengths_are_refused() -> None:
    rows = np.zeros(1, dtype=np.intp)
    with pytest.raises(ShapeError, match="for 2 of them"):
        Constraints(rows, rows, np.zeros((1, 3)), np.zeros(1), np.array(["a", "b"], dtype=object))


def test_slack_is_the_distance_to_violation_of_a_half_space() -> None:
    both = Constraints.joined(
        half_space(0, NO_ROW, (1.0, 0.0, 0.0), -2.0), half_space(0, 1, (0.0, 1.0, 0.0), 0.5)
    )
    velocity = np.array([[1.0, 1.0, 0.0], [0.0, 3.0, 0.0]])
    assert len(both) == 2
    assert both.slack_m_s(velocity) == pytest.approx([3.0, -2.5])


def test_vehicle_zero_of_a_pair_counts_like_any_other() -> None:
    velocity = np.array([[0.0, 3.0, 0.0], [1.0, 1.0, 0.0]])
    assert half_space(1, 0, (0.0, 1.0, 0.0), 0.5).slack_m_s(velocity) == pytest.approx([-2.5])


def test_over_a_slow_link_a_climb_continues() -> None:
    settings = SETTINGS.model_copy(update={"link_delay_s": 0.5})
    climbing = surroundings(np.array([[0.0, 0.0, -94.0]]), velocity=np.array([[0.0, 0.0, -2.0]]))
    allowed, _ = filter_velocities(np.array([[0.0, 0.0, -2.5]]), climbing, settings)
    late = BRAKING.over_link(0.5)
    gap_m = 5.0 - FLOOR.margin_m / 2.0 - 2.0 * late.lead_s  # at -95 m when the setpoint arrives
    assert allowed[0, 2] == pytest.approx(-float(late.speed_m_s(np.array([gap_m]))[0]), abs=2e-3)
