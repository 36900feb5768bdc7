"""Corrections in a flight: required before a start, an alarm when they stop, margins that then grow."""

from collections import defaultdict

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from gcs.flight.features.corrections import Corrections
from gcs.links.intake import Arrived
from gcs.links.link import FrameDirection
from gcs.model.errors import RefusedError
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.testing.virtual_show import VirtualShow, fly, refused, show_config
from tests.support.rtcm import BASE, rtcm

SETPOINT = common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
LED_CONTROL = 186

RTK = {"rtk": {"source": "tcp://127.0.0.1:2101", "required": True, "age_max_s": 3.0}}


def corrections(show: VirtualShow) -> Corrections:
    return next(each for each in show.service.flight.features if isinstance(each, Corrections))


async def supply(show: VirtualShow, seconds: float) -> None:
    """The base sends a message each second."""
    for _ in range(round(seconds)):
        corrections(show).take(rtcm(1077, 400), BASE, show.now_s)
        await show.wait(1.0)


def stopped(show: VirtualShow) -> bool:
    return any(alarm.cause is AlarmCause.CORRECTIONS_STOPPED and alarm.lasts for alarm in show.view.alarms)


@pytest.mark.soak
def test_start_needs_recent_corrections_where_required() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await show.wait(4.0)
        assert stopped(show)
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert refusal.kind is RefusedError
        assert "no corrections for RTK: none since the service began" in refusal.text
        await supply(show, 2.0)
        assert not stopped(show)
        check = next(each for each in show.service.preflight.report().fleet if each.name == "corrections")
        assert check.passes
        assert [each.equipment.truth["corrections_received"] for each in show.fleet.autopilots] == [
            2,
            2,
            2,
            2,
        ]
        show.service.commands.command_show(ShowAction.START)

    fly(story, show_config(4, **RTK))


def test_stopped_corrections_raise_an_alarm_and_margins_grow() -> None:
    """The vehicles fall back from RTK fixed to 3D: positions are less certain, and the margins follow."""

    async def story(show: VirtualShow) -> None:
        for name in show.config.ids:
            show.befall(name, "fix", type="rtk-fixed")
            show.befall(name, "accuracy", eph_m=0.02, epv_m=0.03)
        await show.standby()
        await supply(show, 3.0)
        with_rtk_m = np.max(show.view.rows.uncertainty_m)
        view = show.view.features.corrections
        assert view is not None
        assert (view.base_latitude_deg, view.messages, view.problem) == (BASE[0], 3, "")
        await show.until(lambda: stopped(show), 5.0)
        assert show.view.features.corrections is not None
        assert show.view.features.corrections.problem.startswith("none for ")
        for name in show.config.ids:
            show.befall(name, "fix", type="3d")
            show.befall(name, "accuracy", eph_m=0.9, epv_m=1.8)
        await show.wait(2.0)
        without_m = np.min(show.view.rows.uncertainty_m)
        assert with_rtk_m < 0.2 < without_m

    fly(story, show_config(4, **RTK))


@pytest.mark.soak
def test_corrections_and_lights_leave_after_the_setpoints() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        await supply(show, 1.0)
        sent: dict[float, list[int]] = defaultdict(list)

        def note(time_s: float, way: FrameDirection, raw: bytes, _: int) -> None:
            if way is FrameDirection.SENT:
                sent[time_s].append(int.from_bytes(raw[7:10], "little"))

        show.service.commands.command_show(ShowAction.START)
        await supply(show, 8.0)
        show.link.observe(note)
        await supply(show, 5.0)
        extra = {common.MAVLINK_MSG_ID_GPS_RTCM_DATA, LED_CONTROL}
        mixed = [each for each in sent.values() if SETPOINT in each and extra & set(each)]
        assert {each for one in mixed for each in one} >= {SETPOINT, *extra}
        for each in mixed:
            last = len(each) - 1 - each[::-1].index(SETPOINT)
            assert not extra & set(each[:last]), each

    fly(story, show_config(4, lights={"driver": "led-control"}, **RTK))


def test_a_flood_of_an_input_is_named_with_its_sender() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        flood = [Arrived(b"\xd3\x03" * 700, ("192.0.2.9", 4711))] * 100
        corrections(show).intakes[0].admit(flood, show.now_s)
        await show.wait(0.5)
        texts = [alarm.text for alarm in show.view.alarms if alarm.cause is AlarmCause.INPUT_FLOODED]
        limit = "more than 64 kB or 1000 messages a second"
        assert texts == [f"Input rtk tcp://127.0.0.1:2101 flooded: {limit} from 192.0.2.9:4711."]
        await show.wait(4.0)
        assert AlarmCause.INPUT_FLOODED not in {alarm.cause for alarm in show.view.alarms}

    fly(story, show_config(1, **RTK))
