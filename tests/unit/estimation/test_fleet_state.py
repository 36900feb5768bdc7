"""Batches, plans and the table that makes the fleet's state."""

from dataclasses import replace
from math import inf, nan, pi

import numpy as np
import pytest

from gcs.estimation.fleet_state import FORWARD_MAX_S, Table, tuple3
from gcs.model.errors import GcsError, InvalidError, ShapeError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Formation, Obstacle, Orbit, Target, Yaw
from gcs.model.state import FleetState, Setpoints, Telemetry
from tests.support.reported import reported

FRAME = ShowFrame(47.0, 8.0, 400.0, heading_deg=90.0)


def telemetry(ids: tuple[str, ...], *, received_s: float, altitude_amsl_m: float = 420.0) -> Telemetry:
    """All at the show's origin, 20 m up, flying east at 2 m/s and looking south."""
    return reported(
        ids,
        received_s,
        latitude_deg=47.0,
        longitude_deg=8.0,
        altitude_amsl_m=altitude_amsl_m,
        velocity_ned_m_s=np.tile((0.0, 2.0, 0.0), (len(ids), 1)),
        yaw_deg=180.0,
    )


def test_the_table_rotates_everything_into_the_show_frame() -> None:
    state = Table(("a",), FRAME).state([telemetry(("a",), received_s=10.0)], 10.0)
    assert state.position_m[0] == pytest.approx([0.0, 0.0, -20.0], abs=1e-3)
    assert state.velocity_m_s[0] == pytest.approx([2.0, 0.0, 0.0])  # east is ahead
    assert state.yaw_rad[0] == pytest.approx(pi / 2)  # south is to the right
    assert state.age_s[0] == 0.0


def test_positions_are_extrapolated_by_velocity_for_a_while() -> None:
    table = Table(("a",), FRAME)
    fresh = table.state([telemetry(("a",), received_s=10.0)], 10.3)
    old = table.state([telemetry(("a",), received_s=10.0)], 17.0)
    assert fresh.position_m[0, 0] == pytest.approx(0.6, abs=1e-3)
    assert old.position_m[0, 0] == pytest.approx(2.0 * FORWARD_MAX_S, abs=1e-3)
    assert old.age_s[0] == pytest.approx(7.0)


def test_rows_follow_the_vehicle_order_and_may_be_unknown() -> None:
    table = Table(("a", "b", "c"), FRAME)
    parts = [telemetry(("c",), received_s=1.0, altitude_amsl_m=430.0), telemetry(("a",), received_s=0.5)]
    state = table.state(parts, 1.0)
    assert state.age_s.tolist() == [0.5, inf, 0.0]
    assert state.position_m[[0, 2], 2] == pytest.approx([-20.0, -30.0], abs=1e-3)
    assert np.isnan(state.position_m[1]).all()
    assert np.isnan(state.yaw_rad[1])


def test_telemetry_from_the_future_is_not_younger_than_now() -> None:
    state = Table(("a",), FRAME).state([telemetry(("a",), received_s=11.0)], 10.0)
    assert state.age_s[0] == 0.0


def test_row_has_values_only_when_all_are_known() -> None:
    assert tuple3(np.array([1.0, 2.0, 3.0])) == (1.0, 2.0, 3.0)
    assert tuple3(np.array([1.0, nan, 3.0])) is None


def test_batches_of_the_wrong_shape_are_refused_by_name() -> None:
    with pytest.raises(ShapeError, match="velocity_m_s"):
        Setpoints(0.0, ("a", "b"), np.zeros((1, 3)), np.zeros(2))
    with pytest.raises(ShapeError, match="age_s"):
        FleetState(0.0, ("a",), np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), np.zeros(2))
    with pytest.raises(ShapeError, match="armed: 1 values for 2"):
        replace(telemetry(("a", "b"), received_s=0.0), armed=(True,))


def test_a_batch_cannot_be_changed_once_made() -> None:
    setpoints = Setpoints(0.0, ("a",), np.zeros((1, 3)), np.zeros(1))
    with pytest.raises(ValueError, match="read-only"):
        setpoints.velocity_m_s[0, 0] = 1.0


def test_target_is_extrapolated_by_its_velocity() -> None:
    target = Target(1.0, 2.0, 0.5, -0.25, time_s=100.0)
    assert target.position_m(104.0) == (3.0, 1.0)
    assert Target(velocity_x_m_s=3.0, velocity_y_m_s=4.0).speed_m_s == 5.0


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Formation(0.0, 10.0), "radius_m"),
        (lambda: Formation(nan, 10.0), "radius_m"),
        (lambda: Formation(5.0, inf), "height_m"),
        (lambda: Orbit(-1.0), "radius_m"),
        (lambda: Orbit(nan), "radius_m"),
        (lambda: Orbit(10.0, 0.0), "speed_m_s"),
        (lambda: Target(x_m=nan), "x_m"),
        (lambda: Target(velocity_y_m_s=inf), "velocity_y_m_s"),
        (lambda: Obstacle("", 0.0, 0.0, 1.0, 1.0, 1.0), "id"),
        (lambda: Obstacle("b", nan, 0.0, 1.0, 1.0, 1.0), "x_m"),
        (lambda: Obstacle("b", 0.0, 0.0, 0.0, 1.0, 1.0), "half_length_x_m"),
        (lambda: Obstacle("b", 0.0, 0.0, 1.0, 1.0, -1.0), "height_m"),
        (lambda: Yaw(fixed_rad=nan), "fixed_rad"),
    ],
)
def test_impossible_plan_is_refused_by_field_name(make: object, field: str) -> None:
    with pytest.raises(InvalidError) as refused:
        make()  # type: ignore[operator]
    assert refused.value.field == field
    assert refused.value.allowed
    assert isinstance(refused.value, GcsError)
