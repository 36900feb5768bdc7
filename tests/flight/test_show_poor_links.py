"""Links that lose and delay: no vehicle is lost for want of heartbeats, and lost vehicles rejoin."""

from typing import Any, NamedTuple

import pytest

from gcs.estimation.link_health import BEATS_LACK_MAX_S
from gcs.failsafe.policy import Cause
from gcs.links import Verb
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.testing.virtual_show import FLEET_STEP_S, HOLDS_WHEN_LOST, VirtualShow, fly, show_config
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

COUNT = 20


class Poor(NamedTuple):
    texts: set[str]
    phases: dict[str, list[Phase]]
    joined_by_hand: int
    violations: int


async def poor_links(show: VirtualShow, loss: float) -> Poor:
    """The review's scene: 30 s of loss, 0.3 s of delay, 0.1 s of jitter on every link; then sound ones.

    It ends 5 s after every vehicle is in the formation again, which takes 30 s at most.
    """
    began_s = show.now_s
    for name in show.config.ids:
        show.befall(name, "loss", share=loss)
        show.befall(name, "delay", delay_s=0.3, jitter_s=0.1)
    await show.wait(30.0)
    for name in show.config.ids:
        show.befall(name, "none")
    await show.wait(5.0)
    await show.until(lambda: set(show.view.rows.phases) == {Phase.FORMATION}, 20.0)
    await show.wait(5.0)
    track = show.track.between(began_s)
    texts = {alarm.text for sample in track.samples for alarm in sample.view.alarms}
    phases = {name: track.phases(name) for name in show.config.ids}
    joins = sum(command.action == "join" for command in show.service.command_log.newest())
    if show.view.show is ShowPhase.PAUSED:
        show.service.commands.command_show(ShowAction.RESUME)
        await show.wait(5.0)
    return Poor(texts, phases, joins, show.floor_violations())


def config(**sections: Any) -> Any:
    return show_config(
        COUNT,
        formation={"radius_m": 18.0, "height_m": 30.0},
        orbit={"radius_m": 10.0, "speed_m_s": 2.5},
        operation=HOLDS_WHEN_LOST,
        **sections,
    )


@pytest.fixture(scope="module")
def review() -> Poor:
    return fly(lambda show: poor_links(show, 0.2), config(), after=running, grid_columns=5, seed=5)


@pytest.mark.soak
def test_no_vehicle_is_lost_while_a_fifth_of_all_messages_is(review: Poor) -> None:
    assert {phase for phases in review.phases.values() for phase in phases} == {Phase.FORMATION}


@pytest.mark.soak
def test_late_links_are_no_wind(review: Poor) -> None:
    assert not [notice for notice in review.texts if "wind" in notice]


@pytest.mark.soak
def test_the_floor_is_kept_over_poor_links(review: Poor) -> None:
    assert review.violations == 0


@pytest.mark.soak
def test_lost_vehicle_over_poor_links_rejoins_by_itself() -> None:
    poor = fly(
        lambda show: poor_links(show, 0.67),
        config(),
        after=running,
        step_s=FLEET_STEP_S,
        grid_columns=5,
        seed=5,
    )
    left = {phase for phases in poor.phases.values() for phase in phases}
    assert {Phase.LOST, Phase.PILOT} <= left, "at such a loss some vehicles fall out, some by their failsafe"
    assert {phases[-1] for phases in poor.phases.values()} == {Phase.FORMATION}
    assert poor.joined_by_hand == 0
    assert poor.violations == 0


async def without_heartbeats(show: VirtualShow, beats_lack_s: float) -> tuple[list[Phase], set[str], float]:
    """Heartbeats alone are lost, positions come."""
    began_s = show.now_s
    show.ports.beatless.add("d2")
    await show.wait(beats_lack_s)
    sent_per_s = show.track.between(began_s).setpoints_per_s("d2")
    show.ports.beatless.clear()
    await show.phase("d2", Phase.FORMATION, 20.0)
    await show.wait(3.0)
    texts = {alarm.text for sample in show.track.between(began_s).samples for alarm in sample.view.alarms}
    return show.track.between(began_s).phases("d2"), texts, sent_per_s


@pytest.mark.soak
def test_without_heartbeats_it_flies_and_the_operator_is_warned() -> None:
    phases, texts, sent_per_s = fly(
        lambda show: without_heartbeats(show, 6.0), show_config(4, operation=HOLDS_WHEN_LOST), after=running
    )
    assert phases == [Phase.FORMATION]
    assert any(text.startswith("Vehicle d2 without heartbeat: no heartbeat for") for text in texts)
    assert sent_per_s == pytest.approx(20.0, abs=0.5)


class Beatless(NamedTuple):
    age_s: float  # of the heartbeat when the vehicle is lost
    failsafe_s: float  # from then until its failsafe
    alarm_s: float  # and until its alarm
    phases: list[Phase]
    texts: set[str]


async def lost_without_heartbeats(show: VirtualShow) -> Beatless:
    began_s = show.now_s
    show.ports.beatless.add("d2")
    await show.until(lambda: show.vehicle("d2").phase is Phase.LOST, 20.0)
    age_s, lost_s = show.vehicle("d2").heartbeat_age_s or 0.0, show.now_s
    await show.until(lambda: any(each.cause == Cause.VEHICLE_LOST for each in show.view.failsafes))
    failsafe_s = show.now_s - lost_s
    await show.until(lambda: any(each.cause is AlarmCause.VEHICLE_LOST for each in show.view.alarms))
    alarm_s = show.now_s - lost_s
    show.ports.beatless.clear()
    await show.phase("d2", Phase.FORMATION, 20.0)
    await show.wait(3.0)
    track = show.track.between(began_s)
    texts = {alarm.text for sample in track.samples for alarm in sample.view.alarms}
    return Beatless(age_s, failsafe_s, alarm_s, track.phases("d2"), texts)


@pytest.fixture(scope="module")
def beatless() -> Beatless:
    return fly(lost_without_heartbeats, show_config(4, operation=HOLDS_WHEN_LOST), after=running)


def test_long_without_heartbeats_it_is_lost_and_recovers(beatless: Beatless) -> None:
    assert beatless.phases == [Phase.FORMATION, Phase.LOST, Phase.HOLD, Phase.FORMATION]
    assert any(text.startswith("Vehicle d2 lost: ") for text in beatless.texts)


@pytest.mark.soak
def test_the_failsafe_sees_a_loss_in_the_tick_of_the_phase(beatless: Beatless) -> None:
    """Before: up to a second later where only heartbeats were missing."""
    limit_s = show_config(4).operation.silence_s + BEATS_LACK_MAX_S
    assert limit_s < beatless.age_s < limit_s + 0.1
    assert beatless.failsafe_s < 0.01
    assert beatless.alarm_s < 0.3


async def taken_while_beatless(show: VirtualShow) -> tuple[list[Phase], list[Verb]]:
    show.ports.beatless.add("d2")
    began_s = show.now_s
    show.pilot("d2", PilotMode.HOLD)
    show.befall("d2", "pilot", mode="POSITION")
    await show.wait(6.0)
    show.ports.beatless.clear()
    await show.wait(5.0)
    commands = [command.verb for command in show.ports.commands["d2"] if command.time_s > began_s]
    return show.track.between(began_s).phases("d2"), commands


@pytest.mark.soak
def test_pilot_takes_over_while_heartbeats_are_missing() -> None:
    phases, commands = fly(taken_while_beatless, show_config(4, operation=HOLDS_WHEN_LOST), after=running)
    assert phases == [Phase.FORMATION, Phase.PILOT]
    assert commands == []
