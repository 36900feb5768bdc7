"""Healthy flights raise no alarm: both autopilots and mixed, every law, honest noise, links with delay."""

import random
from dataclasses import replace
from typing import Any

import pytest

from gcs.config.schema import Config
from gcs.formation.laws.registry import SHIPPED
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Orbit
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import AlarmSeverity
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import FLEET_STEP_S, READY_AT_ONCE, VirtualShow, fly
from tests.flight.test_show_autopilots import ARDUPILOT, PX4, config_of

COUNT, RADIUS_M, HEIGHT_M = 5, 9.0, 18.0
PADS_M = 8.0
SOAKED = 50
ORBIT_M, READY_S = 16.0, 60.0


def config(kinds: tuple[str, str], law: str, delay_s: float) -> Config:
    raw = config_of(kinds, COUNT).model_dump()
    raw["formation"] |= {"radius_m": RADIUS_M, "height_m": HEIGHT_M, "law": law}
    raw["control"]["safety"]["link_delay_s"] = delay_s
    return Config.model_validate(raw)


def alarms_of(
    kinds: tuple[str, str], law: str, delay_s: float, orbit_m_s: float = 3.0, **fleet: Any
) -> set[str]:
    """Texts of all alarms but those for information, from when all vehicles are ready until they landed.

    Before, one that does not report its place yet is named, and rightly.
    """

    async def story(show: VirtualShow) -> set[str]:
        for name in show.config.ids:
            if delay_s:
                show.befall(name, "delay", delay_s=delay_s)
        await show.until(lambda: all(seen.ready for seen in vehicles_of(show.view)), READY_S)
        ready_at = len(show.track.samples)
        await show.start()
        await show.wait(10.0)
        show.service.plan.set_orbit(Orbit(radius_m=ORBIT_M, speed_m_s=orbit_m_s))
        await show.wait(25.0)
        show.service.plan.set_orbit(Orbit(radius_m=0.0, speed_m_s=orbit_m_s))
        await show.wait(15.0)
        show.service.commands.command_show(ShowAction.PAUSE)
        await show.wait(5.0)
        show.service.commands.command_show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        stopped = await show.show(ShowAction.STOP)
        assert stopped.outcome is Outcome.DONE
        await show.reach(ShowPhase.LANDED)
        return {
            f"{alarm.cause}: {alarm.text}"
            for sample in show.track.samples[ready_at:]
            for alarm in sample.view.alarms
            if alarm.severity is not AlarmSeverity.INFORMATION
        }

    # beside PX4 the scale of ArduCopter's heights is named, and rightly: tests/flight/test_heights.py
    quirks = replace(READY_AT_ONCE, height_scale=len(set(kinds)) == 1)
    wide = {"noise_scale": 1.0, "spacing_m": PADS_M, "quirks": quirks, "step_s": FLEET_STEP_S, **fleet}
    return fly(story, config(kinds, law, delay_s), **wide)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("kinds", "law", "delay_s"),
    [
        ((PX4, PX4), "slots", 0.1),
        ((ARDUPILOT, ARDUPILOT), "article", 0.3),
        ((PX4, ARDUPILOT), "slots", 0.1),
    ],
    ids=["px4", "ardupilot", "mixed"],
)
def test_healthy_flight_raises_no_alarm(kinds: tuple[str, str], law: str, delay_s: float) -> None:
    assert alarms_of(kinds, law, delay_s) == set()


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(SOAKED))
def test_no_healthy_flight_of_fifty_raises_an_alarm(seed: int) -> None:
    drawn = random.Random(seed)
    kinds = drawn.choice([(PX4, PX4), (ARDUPILOT, ARDUPILOT), (PX4, ARDUPILOT)])
    law = drawn.choice(list(SHIPPED))
    delays_s = [0.0, 0.1, 0.2, 0.3] if PX4 not in kinds else [0.0, 0.05, 0.1]  # with more PX4 does swing
    delay_s, orbit_m_s = drawn.choice(delays_s), drawn.uniform(1.0, 4.0)
    assert alarms_of(kinds, law, delay_s, orbit_m_s, seed=seed) == set()
