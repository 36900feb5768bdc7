"""Links that are late by a constant time, unknown to the service: it measures them and rests."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from gcs.testing.virtual_show import FLEET_STEP_S, HOLDS_WHEN_LOST, VirtualShow, alarm_texts, fly, show_config
from tests.support.show_phases import running

COUNT = 8
REST_M_S = 0.1


class Rested(NamedTuple):
    measured_s: tuple[float, ...]  # of each vehicle, one way
    counted_s: float  # by the control settings
    rest_m_s: float  # rms of the true velocities of the last seconds
    alarms: list[str]
    violations: int


async def late_from_the_pads_on(show: VirtualShow, delay_s: float, some: int | None = None) -> Rested:
    """All links, or the first `some`."""
    for name in show.config.ids[:some]:
        show.befall(name, "delay", delay_s=delay_s)
    await show.wait(10.0)
    await running(show)
    await show.wait(60.0)
    last = show.track.between(show.now_s - 10.0)
    steps = [(b - a) for a, b in pairwise(last.true_m[::20])]  # (n, 3) of a second each
    flight = show.service.flight
    return Rested(
        tuple(flight.link_delay.delay_s.tolist()),
        flight.control_now.safety.link_delay_s,
        float(np.sqrt(np.mean(np.square(steps).sum(axis=2)))),
        alarm_texts(show),
        show.floor_violations(),
    )


@pytest.mark.soak
@pytest.mark.parametrize("delay_s", [0.0, 0.12, 0.3])
def test_formation_rests_over_links_of_any_constant_delay(delay_s: float) -> None:
    config = show_config(COUNT, formation={"radius_m": 10.0, "height_m": 20.0}, operation=HOLDS_WHEN_LOST)
    rested = fly(
        lambda show: late_from_the_pads_on(show, delay_s), config, ideal=True, seed=3, step_s=FLEET_STEP_S
    )
    assert rested.measured_s == pytest.approx([delay_s] * COUNT, abs=0.04)
    assert delay_s <= rested.counted_s + 1e-9 <= delay_s + 0.1 + 1e-6
    assert rested.rest_m_s <= REST_M_S
    assert rested.violations == 0
    assert rested.alarms == []


def test_formation_rests_with_one_late_link_among_fast_ones() -> None:
    """One of 20: the fleet counts as fast, and the vehicle of that link and its neighbours swung for ever."""
    formation = {"radius_m": 9.0, "height_m": 20.0}
    config = show_config(20, formation=formation, operation=HOLDS_WHEN_LOST)
    rested = fly(
        lambda show: late_from_the_pads_on(show, 0.4, 1), config, ideal=True, seed=3, step_s=FLEET_STEP_S
    )
    assert rested.measured_s[0] == pytest.approx(0.4, abs=0.04)
    assert rested.counted_s == 0.0
    assert rested.rest_m_s <= REST_M_S
    assert rested.violations == 0
    assert rested.alarms == []
