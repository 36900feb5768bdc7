"""ArduCopter's bodies respond to velocity setpoints as the recorded vehicle did, for each WPNAV_ACCEL."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.sim.autopilots.ardupilot.response import Copters, Response

if TYPE_CHECKING:
    from gcs.sim.vehicle.dynamics import Array

STEPS: dict[str, Any] = json.loads(
    gzip.decompress(
        (Path(__file__).parents[2] / "data" / "ardupilot" / "fake" / "steps.json.gz").read_bytes()
    )
)
DT_S = 0.01
PILOT_ACCEL_Z_M_S2 = 2.5
STARTS_S = -1.02  # of the earliest recording


def acceleration_m_s2(name: str) -> float:
    """WPNAV_ACCEL of a recorded step."""
    return float(name.split("accel")[1]) / 100.0


def fly(copters: Copters, command_m_s: Array, limits_m_s2: Array) -> None:
    count = len(command_m_s)
    copters.step(
        command_m_s,
        limits_m_s2,
        copters.position_m,
        copters.velocity_m_s,
        wind_m_s=0.0,
        resting=np.zeros(count, dtype=np.bool_),
    )


def limits(acceleration_m_s2: list[float]) -> Array:
    return np.column_stack([acceleration_m_s2, np.full(len(acceleration_m_s2), PILOT_ACCEL_Z_M_S2)])


@pytest.fixture(scope="module")
def flown() -> dict[str, tuple[Array, Array]]:
    """Time and velocity (n, 3) of all steps, flown together."""
    copters = Copters(np.zeros((len(STEPS), 3)), DT_S, Response())
    bounds = limits([acceleration_m_s2(name) for name in STEPS])
    ends_s = max(step["velocity_m_s"][-1][0] for step in STEPS.values())
    times_s = np.arange(STARTS_S, ends_s, DT_S)
    commands = []
    for step in STEPS.values():
        at_s, values = np.array(step["commands"])[:, 0], np.array(step["commands"])[:, 1:]
        commands.append(values[np.maximum(np.searchsorted(at_s, times_s, side="right") - 1, 0)])
    track = []
    for command in np.stack(commands, axis=1):
        fly(copters, command, bounds)
        track.append(copters.velocity_m_s)
    whole = np.array(track)
    return {name: (times_s + DT_S, whole[:, place]) for place, name in enumerate(STEPS)}


@pytest.mark.parametrize("name", STEPS)
def test_each_recorded_step_within_0_25_m_s_rms(name: str, flown: dict[str, tuple[Array, Array]]) -> None:
    recorded = np.array(STEPS[name]["velocity_m_s"])
    times_s, velocity_m_s = flown[name]
    ours = np.column_stack([np.interp(recorded[:, 0], times_s, axis) for axis in velocity_m_s.T])
    error_m_s = ours - recorded[:, 1:]
    assert np.sqrt((error_m_s**2).sum(axis=1).mean()) < 0.25


@pytest.mark.parametrize(
    ("acceleration", "farthest_m", "rest_m"), [(1.0, 13.0, 12.4), (2.5, 6.6, 5.1), (5.0, 4.4, 2.6)]
)
def test_a_stop_swings_beyond_and_back_as_recorded(
    acceleration: float, farthest_m: float, rest_m: float
) -> None:
    copters, bounds = Copters(np.zeros((1, 3)), DT_S, Response()), limits([acceleration])
    for _ in range(1500):
        fly(copters, np.array([[5.0, 0.0, 0.0]]), bounds)
    begin_m = copters.position_m[0, 0]
    track_m = []
    for _ in range(1200):
        fly(copters, np.zeros((1, 3)), bounds)
        track_m.append(copters.position_m[0, 0] - begin_m)
    assert max(track_m) == pytest.approx(farthest_m, abs=0.5)
    assert track_m[-1] == pytest.approx(rest_m, abs=0.25)


@pytest.mark.alternates(0)
@pytest.mark.parametrize("speed_m_s", [2.0, 4.0, 5.0, 8.0, 10.0])
@pytest.mark.parametrize("acceleration", [1.0, 2.5, 5.0])
def test_each_stop_keeps_the_bound_that_held(speed_m_s: float, acceleration: float) -> None:
    """v^2 / 2a + 0.45 v (habit 46)."""
    copters, bounds = Copters(np.zeros((1, 3)), DT_S, Response()), limits([acceleration])
    for _ in range(2000):
        fly(copters, np.array([[0.0, speed_m_s, 0.0]]), bounds)
    begin_m = copters.position_m[0, 1]
    farthest_m = 0.0
    for _ in range(1500):
        fly(copters, np.zeros((1, 3)), bounds)
        farthest_m = max(farthest_m, copters.position_m[0, 1] - begin_m)
    assert farthest_m <= speed_m_s**2 / (2.0 * acceleration) + 0.45 * speed_m_s


def test_a_fall_from_22_m_ends_as_recorded() -> None:
    copters = Copters(np.array([[0.0, 0.0, -22.5]]), DT_S, Response())
    fell_s = 0.0
    while copters.position_m[0, 2] < 0.0:
        copters.step(
            np.zeros((1, 3)),
            limits([1.0]),
            copters.position_m,
            copters.velocity_m_s,
            wind_m_s=0.0,
            resting=np.array([True]),
        )
        fell_s += DT_S
    assert fell_s == pytest.approx(2.7, abs=0.15)
    assert copters.velocity_m_s[0, 2] == pytest.approx(12.4, abs=0.4)


def test_north_and_east_share_the_acceleration() -> None:
    copters = Copters(np.zeros((2, 3)), DT_S, Response())
    for _ in range(200):
        fly(copters, np.array([[8.0, 0.0, 0.0], [8.0, 8.0, 0.0]]), limits([1.0, 1.0]))
    assert np.hypot(*copters.desired_m_s[1, :2]) == pytest.approx(copters.desired_m_s[0, 0])


def test_position_errors_of_the_estimate_are_flown_back() -> None:
    copters = Copters(np.zeros((1, 3)), DT_S, Response())
    offset_m = np.array([[3.0, 0.0, 0.0]])
    for _ in range(1500):
        copters.step(
            np.zeros((1, 3)),
            limits([1.0]),
            copters.position_m + offset_m,
            copters.velocity_m_s,
            wind_m_s=0.0,
            resting=np.array([False]),
        )
    assert copters.position_m[0] == pytest.approx((-3.0, 0.0, 0.0), abs=0.05)


def test_steady_wind_is_held_against() -> None:
    copters = Copters(np.zeros((1, 3)), DT_S, Response())
    for _ in range(2000):
        copters.step(
            np.zeros((1, 3)),
            limits([1.0]),
            copters.position_m,
            copters.velocity_m_s,
            wind_m_s=np.array([0.0, 5.0, 0.0]),
            resting=np.array([False]),
        )
    assert copters.position_m[0] == pytest.approx((0.0, 0.0, 0.0), abs=0.05)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-30, 30)] * 3), min_size=1, max_size=4))
def test_no_command_makes_the_state_infinite(commands: list[tuple[float, float, float]]) -> None:
    command_m_s = np.array(commands)
    copters = Copters(np.zeros(command_m_s.shape), 0.02, Response())
    for _ in range(150):
        fly(copters, command_m_s, limits([5.0] * len(commands)))
    assert np.isfinite(copters.position_m).all()
    assert (np.abs(copters.velocity_m_s) <= 1.3 * np.abs(command_m_s).max() + 1.0).all()
