"""Whatever goes wrong, and in whatever order: it is listed within a second, the most severe on top."""

import json
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import pytest

from gcs.api.context import Feed
from gcs.failsafe.policy import Cause
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase
from gcs.service import VehicleAction
from gcs.service.alarms import RANK, Alarm, AlarmCause, AlarmSeverity
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, VirtualShow, alarm_texts, fly, show_config
from tests.support.failsafe_flights import failsafe
from tests.support.show_phases import running

WITHIN_S: Final = 1.0
FAILSAFES: Final = {
    "low_battery": {"for_s": 0.0, "action": "hold"},
    "bad_position": {"for_s": 0.0, "then_land_after_s": None},
    "vehicles_lost": {"action": "ignore"},
    "service_late": {"for_s": 0.0, "then_return_after_s": None},
}


class Supervisor:
    """Receives the signs that control lives, as `gcs.cli.service.process` does."""

    def __init__(self) -> None:
        self.problem = ""

    def beat(self) -> None:
        """Nothing to do."""

    def leave(self) -> None:
        """It has ended."""
        self.problem = "nothing starts this service again"


@dataclass(frozen=True)
class FaultInjector:
    """A cause: how it comes about, and from when on the service knows of it."""

    begin: Callable[[VirtualShow], object]
    is_known: Callable[[VirtualShow], bool] = lambda _show: True


def reacts_to(cause: Cause) -> Callable[[VirtualShow], bool]:
    return lambda show: failsafe(show, cause) is not None


def near_each_other(show: VirtualShow) -> None:
    """d9 reports that its position was corrected: by so much that it is 1 m beside d10."""
    row, other = (show.config.ids.index(name) for name in ("d9", "d10"))
    place_m = show.view.rows.position_m
    north_m, east_m, down_m = show.service.frame.into_ned(place_m[other] - place_m[row]).tolist()
    show.befall("d9", "position-reset", north_m=north_m + 1.0, east_m=east_m, down_m=down_m)


def late(show: VirtualShow) -> None:
    show.link.takes_s = 0.15


TROUBLES: Final[Mapping[AlarmCause, FaultInjector]] = {
    AlarmCause.KILLED: FaultInjector(lambda show: show.service.commands.kill(["d2"])),
    AlarmCause.VEHICLE_LOST: FaultInjector(
        lambda show: show.ports.silence("d3"), lambda show: show.vehicle("d3").phase is Phase.LOST
    ),
    AlarmCause.OUTSIDE_CONTROL: FaultInjector(
        lambda show: show.befall("d4", "pilot"), lambda show: show.vehicle("d4").phase is Phase.PILOT
    ),
    AlarmCause.LOW_BATTERY: FaultInjector(
        lambda show: show.befall("d5", "battery", remaining=0.15), reacts_to(Cause.LOW_BATTERY)
    ),
    AlarmCause.CRITICAL_BATTERY: FaultInjector(
        lambda show: show.befall("d6", "battery", remaining=0.09), reacts_to(Cause.CRITICAL_BATTERY)
    ),
    AlarmCause.BAD_POSITION: FaultInjector(
        lambda show: show.befall("d7", "accuracy", eph_m=9.0, epv_m=20.0), reacts_to(Cause.BAD_POSITION)
    ),
    AlarmCause.TOO_CLOSE: FaultInjector(
        near_each_other, lambda show: (show.view.minimum_separation_m or 9.0) < 2.0
    ),
    AlarmCause.SERVICE_LATE: FaultInjector(late, reacts_to(Cause.SERVICE_LATE)),
    AlarmCause.RECORD_FAILS: FaultInjector(
        lambda show: setattr(show.link, "recording_problem", "link loop: recording to a fails: disk full")
    ),
    AlarmCause.DUPLICATE_SYSTEM_ID: FaultInjector(
        lambda show: show.ports.duplicated.add("d8"), lambda show: bool(show.link.conflicts)
    ),
    AlarmCause.LINK_FAILED: FaultInjector(
        lambda show: show.link.failures.put_nowait(LinkError("address already in use"))
    ),
}

LASTING: Final = {
    AlarmCause.KILLED,
    AlarmCause.VEHICLE_LOST,
    AlarmCause.OUTSIDE_CONTROL,
    AlarmCause.SUPERVISOR_GONE,
    AlarmCause.RECORD_FAILS,
    AlarmCause.DUPLICATE_SYSTEM_ID,
}
"""Of these the cause does not end in this test; others end when the service has reacted."""


def listed(show: VirtualShow, cause: AlarmCause) -> Alarm | None:
    return next((alarm for alarm in show.view.alarms if alarm.cause is cause), None)


async def all_shown(show: VirtualShow, feed: Feed, troubles: Mapping[AlarmCause, FaultInjector]) -> None:
    """Wait until the console's stream tells each; no later than WITHIN_S after the service knew of it."""
    known_s: dict[AlarmCause, float] = {}
    waits = set(troubles)
    began_s = show.now_s
    while waits:
        assert show.now_s - began_s < 10.0, f"never known: {waits - known_s.keys()}"
        await show.wait(1.0 / show.config.tick_rate_hz)
        for cause in waits - known_s.keys():
            if troubles[cause].is_known(show):
                known_s[cause] = show.now_s
        message = json.loads(feed.status(show.now_s)[1])
        check_command(message)
        waits -= {AlarmCause(alarm["cause"]) for alarm in message["alarms"]}
        for cause in waits & known_s.keys():
            assert show.now_s - known_s[cause] < WITHIN_S, cause


def check_command(message: Mapping[str, Any]) -> None:
    """The most severe on top, and the state of the whole is that; texts end once, without the advice."""
    texts = [alarm["text"] for alarm in message["alarms"]]
    assert not [text for text in texts if ".." in text or "when the pilot agrees" in text]
    ranks = [
        (alarm["ended_unix_time_s"] is not None, RANK[AlarmSeverity(alarm["severity"])])
        for alarm in message["alarms"]
    ]
    assert ranks == sorted(ranks)
    lasting = [alarm["severity"] for alarm in message["alarms"] if alarm["ended_unix_time_s"] is None]
    assert message["severity"] == (lasting[0] if lasting else "normal")


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.soak)])
def test_twelve_alarms_are_listed_within_a_second_by_severity(seed: int) -> None:
    supervisor = Supervisor()
    troubles = {**TROUBLES, AlarmCause.SUPERVISOR_GONE: FaultInjector(lambda _show: supervisor.leave())}
    causes = [*troubles]
    random.Random(seed).shuffle(causes)
    assert len(causes) == 12

    async def story(show: VirtualShow) -> None:
        feed = Feed(show.service, "off", lambda: "")
        await show.start()
        await show.wait(3.0)
        for first in range(0, len(causes), 3):
            together = causes[first : first + 3]
            for cause in together:
                troubles[cause].begin(show)
            await all_shown(show, feed, {cause: troubles[cause] for cause in together})
            show.link.takes_s = 0.0
            hidden = LASTING & {*causes[: first + 3]} - {alarm.cause for alarm in show.view.alarms}
            assert not hidden, "what is new pushed out what lasts"

    config = show_config(
        12, operation=HOLDS_WHEN_LOST, failsafes=FAILSAFES, formation={"radius_m": 9.0, "height_m": 16.0}
    )
    fly(story, config, heart=supervisor, grid_columns=4, spacing_m=6.0)


@pytest.mark.soak
def test_lost_vehicle_alarm_names_its_cause_until_it_is_back() -> None:
    async def story(show: VirtualShow) -> None:
        assert alarm_texts(show) == []
        show.ports.silence("d3")
        await show.until(lambda: listed(show, AlarmCause.VEHICLE_LOST) is not None, 5.0)
        await show.wait(0.5)
        alarm = listed(show, AlarmCause.VEHICLE_LOST)
        assert alarm is not None
        assert alarm.text.startswith("Vehicle d3 lost: ")
        assert alarm.text.endswith(". Formation closes the gap.")
        assert alarm.command_id is not None
        acknowledged = show.service.alarms.acknowledge(alarm.id)
        assert acknowledged.acknowledged_by == "service"
        await show.wait(5.0)
        by = {seen.acknowledged_by for seen in show.view.alarms}
        assert by == {"service"}
        show.ports.restore("d3")
        await show.until(lambda: not show.view.alarms, 15.0)
        texts = [event.text for event in show.service.events.newest()]
        assert any(text.startswith("warning: Vehicle d3 lost") for text in texts)
        assert any(text.startswith("acknowledged by service: Vehicle d3 lost") for text in texts)
        assert any(text.startswith("over: Vehicle d3 was lost: ") for text in texts)

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_kill_is_an_emergency_until_seen_on_the_ground() -> None:
    async def story(show: VirtualShow) -> None:
        command = show.service.commands.kill(["d2"])
        await show.until(lambda: listed(show, AlarmCause.KILLED) is not None, WITHIN_S)
        alarm = show.view.alarms[0]
        assert (alarm.severity, alarm.vehicles) == (AlarmSeverity.EMERGENCY, ("d2",))
        assert alarm.text.startswith("Vehicle d2 killed: motors are being stopped on command by service")
        assert alarm.command_id == command.id
        await show.settled(command)
        await show.wait(0.5)
        assert alarm_texts(show)[0].startswith("Vehicle d2 killed: motors stopped on command by service.")
        await show.wait(5.0)
        assert show.view.alarms[0].cause is AlarmCause.KILLED
        assert show.view.alarms[0].lasts, "it lies on the ground, as far as anybody knows"
        show.service.alarms.acknowledge_all()
        await show.command("d2", VehicleAction.CONFIRM_DOWN)
        await show.until(lambda: listed(show, AlarmCause.KILLED) is None, WITHIN_S)

    fly(story, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


@pytest.mark.soak
def test_radius_too_small_for_a_falling_accuracy_is_an_alarm() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        assert listed(show, AlarmCause.RADIUS_SMALL) is None
        half = ("d1", "d2", "d3", "d4")  # of fewer each is named instead: uncertain-position
        for name in half:
            show.befall(name, "accuracy", eph_m=0.9, epv_m=1.2)
        await show.until(lambda: listed(show, AlarmCause.RADIUS_SMALL) is not None)
        alarm = listed(show, AlarmCause.RADIUS_SMALL)
        assert alarm is not None
        assert alarm.severity is AlarmSeverity.CAUTION
        assert "uncertain by 0.90 m" in alarm.text
        await show.wait(10.0)
        assert show.floor_violations() == 0
        for name in half:
            show.befall(name, "accuracy", eph_m=0.1, epv_m=0.2)
        await show.until(lambda: not (found := listed(show, AlarmCause.RADIUS_SMALL)) or not found.lasts)
        assert show.view.failsafes == ()

    formation = {"radius_m": 7.0, "height_m": 25.0}
    fly(story, show_config(8, formation=formation, positioning={"share": 1.0}), ideal=True)


@pytest.mark.soak
def test_wind_beyond_the_thrust_is_an_alarm() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        assert listed(show, AlarmCause.LITTLE_AUTHORITY) is None
        for name, north_m_s in zip(show.config.ids, (13.0, 9.0, 12.0, 14.0, 10.0, 11.0), strict=True):
            show.befall(name, "wind", north_m_s=north_m_s)
        await show.until(lambda: listed(show, AlarmCause.LITTLE_AUTHORITY) is not None, 20.0)
        alarm = listed(show, AlarmCause.LITTLE_AUTHORITY)
        assert alarm is not None
        assert alarm.severity is AlarmSeverity.CAUTION
        assert "Pairs keep up to" in alarm.text
        for name in show.config.ids:
            show.befall(name, "wind")
        await show.until(
            lambda: not (found := listed(show, AlarmCause.LITTLE_AUTHORITY)) or not found.lasts, 90.0
        )
        assert show.floor_violations() == 0

    fly(story, show_config(6, failsafes={"wind": {"action": "ignore"}}))


@pytest.mark.soak
def test_slow_vehicle_is_named_until_it_answers() -> None:
    async def story(show: VirtualShow) -> None:
        await show.start()
        await show.wait(20.0)  # at the orbit's speed: while it grows, the orbit waits for the slowest
        parameters = show.autopilot("d3").parameters
        parameters.set("MPC_XY_VEL_MAX", 2.0)
        await show.until(lambda: listed(show, AlarmCause.SLOW_VEHICLE) is not None, 40.0)
        alarm = listed(show, AlarmCause.SLOW_VEHICLE)
        assert alarm is not None
        assert alarm.vehicles == ("d3",)
        assert "of 6 m/s" in alarm.text
        parameters.set("MPC_XY_VEL_MAX", 12.0)
        await show.until(
            lambda: not (found := listed(show, AlarmCause.SLOW_VEHICLE)) or not found.lasts, 90.0
        )
        assert show.floor_violations() == 0

    orbit = {"radius_m": 30.0, "speed_m_s": 5.0}
    control = {
        "law": {"speed_m_s": 5.0, "center_speed_max_m_s": 5.0},
        "safety": {"limits": {"horizontal_m_s": 6.0}},
    }
    fly(story, show_config(6, orbit=orbit, control=control))
