"""What is believed of the motion of a vehicle whose telemetry has ended."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.estimation.fleet_state import Table
from gcs.model.frames import ShowFrame
from gcs.model.plan import Formation, Plan
from gcs.model.state import Array, FleetState, Telemetry, Traits
from tests.support.law_fleets import vectors
from tests.support.reported import reported
from tests.support.safety_fleets import CALM, NO_PATHS

FRAME = ShowFrame(47.0, 8.0, 400.0)
IDS = ("lost", "near")
LAST_S = 100.0
PLACE_M = np.array([[0.0, 0.0, -30.0], [9.0, 0.0, -30.0]])


def telemetry(velocity_m_s: Array, *, near_s: float = LAST_S) -> Telemetry:
    """The newest of both vehicles, of which `lost` was last received at `LAST_S`."""
    latitude_deg, longitude_deg, altitude_m = FRAME.geodetic(PLACE_M)
    return reported(
        IDS,
        np.array([LAST_S, near_s]),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_amsl_m=altitude_m,
        velocity_ned_m_s=velocity_m_s,
    )


def after(velocity_m_s: Array, age_s: float, near_s: float = LAST_S) -> FleetState:
    """The fleet's state when the telemetry of `lost` is `age_s` old."""
    table = Table(IDS, FRAME)
    table.state([telemetry(velocity_m_s)], LAST_S)
    return table.state([telemetry(velocity_m_s, near_s=near_s)], LAST_S + age_s)


AGES = st.floats(0.0, 30.0)


@CALM
@given(vectors(2, 8.0), AGES, AGES)
def test_the_velocity_of_a_silent_vehicle_only_fades(
    velocity_m_s: Array, age_s: float, more_s: float
) -> None:
    """It keeps its direction, never grows, is whole until the vehicle counts as lost, and ends."""
    sooner, later = after(velocity_m_s, age_s).velocity_m_s, after(velocity_m_s, age_s + more_s).velocity_m_s
    speed_m_s = np.linalg.norm(velocity_m_s, axis=1)
    for seen_m_s in (sooner, later):
        along_m_s = (seen_m_s * velocity_m_s).sum(axis=1)
        assert along_m_s == pytest.approx(np.linalg.norm(seen_m_s, axis=1) * speed_m_s)
        assert (along_m_s >= 0.0).all()
    assert (np.linalg.norm(later, axis=1) <= np.linalg.norm(sooner, axis=1) + 1e-12).all()
    assert (np.linalg.norm(sooner, axis=1) <= speed_m_s + 1e-9).all()
    silence_s, ends_s = 2.0, 4.0
    if age_s <= silence_s:
        assert sooner == pytest.approx(velocity_m_s)
    if age_s >= ends_s:
        assert (sooner == 0.0).all()


def test_resting_wreck_pushes_no_vehicle_ahead_of_it() -> None:
    """Ten seconds after the loss the vehicle ahead may stay where it is."""
    fleet = after(np.array([[5.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 10.0, near_s=LAST_S + 10.0)
    tasks = Tasks(
        np.array([Task.NONE, Task.GOAL], np.int8),
        PLACE_M,
        np.array([True, True]),
        np.array([False, False]),
        NO_PATHS,
        center_moves=False,
    )
    plan = Plan(Formation(10.0, 30.0))
    before = Memory.fresh(2, fleet.time_s - 0.05)
    decided = tick(fleet, tasks, plan, Traits.alike(2), before, ControlSettings())
    assert decided.limited_by == ("", "")
    assert np.abs(decided.setpoints.velocity_m_s).max() < 0.2
