"""Vehicles with heights that drift in flight touch down as slowly as the others, and are named."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly
from tests.flight.test_show_autopilots import ARDUPILOT, PX4, config_of

DRIFT_M, STEPS, STEP_S = 3.0, 30, 0.4
LOW_M = 0.3
"""The greatest speed below this true height is the one of the touch-down."""
SLOW_M_S = 0.6


class Landed(NamedTuple):
    speed_m_s: Array  # (n,) of each touch-down
    named: set[str]  # by an alarm about heights
    armed: tuple[bool, ...]
    violations: int


def by_receiver(show: VirtualShow, name: str, share: float) -> None:
    """Receiver and estimate are wrong alike."""
    show.befall(name, "gps-jump", down_m=-np.sign(share) * DRIFT_M / STEPS)


def by_barometer(show: VirtualShow, name: str, share: float) -> None:
    """The estimate alone is wrong, and the receiver certain of itself."""
    show.befall(name, "barometer", up_m=share * DRIFT_M)


Drift = Callable[[VirtualShow, str, float], None]


async def landed(show: VirtualShow, drift: Drift) -> Landed:
    """Two vehicles drift apart from their heights, d2 upwards and d3 downwards; then all come home."""
    if drift is by_barometer:
        for name in show.config.ids:
            show.befall(name, "fix", type="rtk-fixed")
            show.befall(name, "accuracy", eph_m=0.02, epv_m=0.03)
    await show.standby()
    await show.wait(5.0)
    await show.start()
    for step in range(1, STEPS + 1):
        drift(show, "d2", step / STEPS)
        drift(show, "d3", -step / STEPS)
        await show.wait(STEP_S)
    await show.wait(4.0)
    began_s = show.now_s
    show.service.commands.command_show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED, 90.0)
    await show.wait(2.0)
    track = show.track.between(began_s)
    height_m, time_s = -track.true_m[:, :, 2], track.time_s
    sinks_m_s = -np.diff(height_m, axis=0) / np.diff(time_s)[:, np.newaxis]
    low = (height_m[:-1] < LOW_M) & (height_m[:-1] > 0.01)
    alarms = [alarm for alarm in show.view.alarms if alarm.cause is AlarmCause.HEIGHT_DIFFERS]
    return Landed(
        np.where(low, sinks_m_s, 0.0).max(axis=0),
        {name for alarm in alarms for name in alarm.vehicles},
        track.samples[-1].armed,
        show.floor_violations(track),
    )


@pytest.mark.soak
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("drift", [by_receiver, by_barometer])
def test_drifted_heights_touch_down_slowly(autopilot: str, drift: Drift) -> None:
    flown = fly(lambda show: landed(show, drift), config_of((autopilot, autopilot)), noise_scale=0.25)
    assert flown.speed_m_s.max() < SLOW_M_S
    assert flown.named >= {"d2", "d3"}
    assert not any(flown.armed)
    assert flown.violations == 0
