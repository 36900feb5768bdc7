"""The time of a target's reports: by UTC only where this computer's clock can be trusted."""

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from gcs.control import ControlSettings
from gcs.flight.features.targets import Targets
from gcs.flight.state.feature import Instant
from gcs.flight.state.newest import InForce, Newest
from gcs.formation.orbit import Center
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.settings import RestSource, TargetSettings
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Formation, Plan
from gcs.model.target_fix import TargetFix
from gcs.safety.near_traffic import NearTraffic
from gcs.service.alarms import AlarmCause
from tests.unit.flight.test_assembled import flight

FRAME = ShowFrame(47.3977, 8.5456, 488.0)
SPEED_M_S, LATE_S = 5.0, 2.0
SETTINGS = TargetSettings(name="boat", sources=(RestSource(kind="rest"),), deviation_m=0.1, delay_s=0.2)


def targets(unix_minus_loop_s: Callable[[], float]) -> Targets:
    in_force = InForce(Plan(Formation(10.0, 20.0)), ControlSettings())
    return Targets([SETTINGS], FRAME, Newest(), in_force, unix_minus_loop_s, lambda: True, OwnTracks())


@pytest.mark.parametrize(
    ("unix_minus_loop_s", "late_s"),
    [(0.0, LATE_S), (nan, SETTINGS.delay_s)],
    ids=["synchronised", "not"],
)
def test_delay_is_measured_by_a_clock_that_is_synchronised(unix_minus_loop_s: float, late_s: float) -> None:
    boat = targets(lambda: unix_minus_loop_s)
    for number in range(100):
        arrived_s = number / 5.0
        north_m = SPEED_M_S * arrived_s
        latitude_deg = FRAME.latitude_deg + north_m / 111_195.0
        fix = TargetFix(arrived_s, latitude_deg, FRAME.longitude_deg, source_s=arrived_s - LATE_S)
        boat.take("boat", 0, fix)
    tracker = boat._targets["boat"].estimate.tracker
    motion = tracker.motion(arrived_s)
    assert motion is not None
    assert motion.position_m[0] == pytest.approx(SPEED_M_S * (arrived_s + late_s), abs=0.5)


def test_formation_that_keeps_clear_of_traffic_blames_no_target() -> None:
    """It falls behind a boat at 1 m/s: the alarm says what holds it off."""
    subject = flight(4)
    boat = Targets(
        [SETTINGS], FRAME, subject.newest, subject.in_force, lambda: 0.0, lambda: True, OwnTracks()
    )
    boat.select("boat")
    for number in range(40):
        now_s = subject.newest.state.time_s + number / 5.0
        latitude_deg = FRAME.latitude_deg + (30.0 + number / 5.0) / 111_195.0
        boat.take("boat", 0, TargetFix(now_s, latitude_deg, FRAME.longitude_deg))
    subject.newest.memory = replace(subject.newest.memory, center=Center.at_rest(np.array([0.0, 0.0, -20.0])))
    at = Instant(now_s, ShowPhase.RUNNING, None)
    (behind,) = boat.conditions(at)
    assert (behind.cause, behind.advice) == (AlarmCause.TARGET_OUTRUNS, "")
    assert "traffic" not in behind.because
    one = np.zeros((1, 3))
    subject.newest.near_traffic = NearTraffic(
        ("3C6444",), one, one, np.ones(1), np.ones(1), np.zeros((1, 2, 3))
    )
    (held_off,) = boat.conditions(at)
    assert held_off.because == f"{behind.because}, and the formation keeps clear of traffic 3C6444"
    assert "slow down" not in held_off.advice
    assert held_off.advice
