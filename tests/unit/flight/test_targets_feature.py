"""The time of a target's reports: by UTC only where this computer's clock can be trusted."""

from collections.abc import Callable
from math import nan

import pytest

from gcs.control import ControlSettings
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.targets import Targets
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.settings import RestSource, TargetSettings
from gcs.model.frames import ShowFrame
from gcs.model.plan import Formation, Plan
from gcs.model.target_fix import TargetFix

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
