"""All vehicles return together: on paths planned before, soon, and never inside the floor."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple, TypeVar

import numpy as np
import pytest

from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import CommandRecord, Outcome, ShowAction, VehicleAction
from gcs.service.alarms import AlarmCause
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import HOLDS_WHEN_LOST, FlownTrack, VirtualShow, fly, show_config
from gcs.testing.virtual_time import AtOnce
from tests.support.show_phases import running

pytestmark = pytest.mark.soak

T = TypeVar("T")

COUNT = 12
STOPPING_S = 5.0
"""Before the paths are planned, every vehicle stands still."""


class Return(NamedTuple):
    track: FlownTrack
    stop_s: float
    landed_s: float
    command: CommandRecord
    start_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    floor_violations: int


async def whole_return(show: VirtualShow) -> Return:
    start_m = show.true_m
    await show.start()
    await show.wait(4.0)
    stop_s = show.now_s
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED, 120.0)
    command = await show.settled(record)
    return Return(show.track, stop_s, show.now_s, command, start_m, show.floor_violations())


@pytest.fixture(scope="module")
def flight() -> Return:
    config = show_config(COUNT, formation={"radius_m": 9.0, "height_m": 20.0})
    return fly(whole_return, config, grid_columns=4)


@pytest.mark.soak
def test_all_return_home_and_keep_the_floor(flight: Return) -> None:
    assert flight.command.outcome is Outcome.DONE
    off_m = np.linalg.norm((flight.track.samples[-1].true_m - flight.start_m)[:, :2], axis=1)
    assert off_m.max() < 1.5
    assert flight.floor_violations == 0


@pytest.mark.soak
def test_return_takes_little_longer_than_the_longest_line(flight: Return) -> None:
    begin_m = flight.track.between(flight.stop_s).samples[0].true_m
    way_m = flight.start_m - begin_m
    straight_s = max(np.hypot(*way_m[:, :2].T).max() / 4.0, way_m[:, 2].max() / 1.4)
    assert flight.landed_s - flight.stop_s < 1.5 * straight_s + 10.0 + STOPPING_S


@pytest.mark.soak
def test_vehicles_stop_before_they_return(flight: Return) -> None:
    stopping = flight.track.between(flight.stop_s)
    first = next(m for m in stopping.samples if vehicles_of(m.view)[0].reason == "on its way home")
    assert {seen.phase for seen in vehicles_of(first.view)} == {Phase.RETURN}
    speeds_m_s = [np.linalg.norm(seen.velocity_m_s) for seen in vehicles_of(first.view) if seen.velocity_m_s]
    assert max(speeds_m_s) < 0.5


@pytest.mark.soak
def test_holding_and_stopped_vehicles_during_the_return() -> None:
    async def story(show: VirtualShow) -> None:
        await show.command("d1", VehicleAction.HOLD)
        record = show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: show.vehicle("d2").reason == "on its way home")
        assert show.vehicle("d1").reason == "on its way home"
        await show.command("d2", VehicleAction.HOLD)
        again = show.service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        assert show.service.command_log.get(record.id).outcomes["d2"].outcome is Outcome.FAILED
        assert {part.outcome for part in (await show.settled(again)).outcomes.values()} == {Outcome.DONE}
        assert show.floor_violations() == 0

    fly(story, after=running)


PLANNING_S = 4.0


class Slowly(AtOnce):
    """As a thread that takes its time, which here is the loop's."""

    def submit(self, work: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        done, reported = super().submit(work, *given, **named), Future[T]()
        asyncio.get_running_loop().call_later(PLANNING_S, lambda: reported.set_result(done.result()))
        return reported


@pytest.mark.soak
def test_all_are_commanded_to_stand_while_paths_are_planned() -> None:
    async def story(show: VirtualShow) -> tuple[FlownTrack, int]:
        show.planning.instead = Slowly()
        show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: all(seen.phase is Phase.RETURN for seen in vehicles_of(show.view)))
        await show.wait(STOPPING_S)
        began_s = show.now_s
        await show.until(lambda: show.vehicle("d1").reason == "on its way home")
        return show.track.between(began_s, show.now_s - 0.1), show.floor_violations()

    planning, violations = fly(story, after=running)
    assert np.diff(planning.time_s).max() < 0.06  # no tick is missed for the plan
    assert np.isfinite(planning.setpoint_m_s).all()
    assert np.ptp(planning.true_m, axis=0).max() < 1.0
    assert violations == 0


@pytest.mark.soak
def test_vehicle_stopped_during_planning_is_not_waited_for() -> None:
    async def story(show: VirtualShow) -> int:
        show.planning.instead = Slowly()
        show.service.commands.command_show(ShowAction.STOP)
        await show.wait(STOPPING_S)
        await show.command("d1", VehicleAction.HOLD)
        await show.until(lambda: show.vehicle("d2").phase is Phase.STANDBY, 60.0)
        assert show.vehicle("d1").phase is Phase.HOLD
        again = show.service.commands.command_show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED, 120.0)
        assert (await show.settled(again)).outcomes["d1"].outcome is Outcome.DONE
        return show.floor_violations()

    assert fly(story, after=running) == 0


class Never(AtOnce):
    """An executor whose work does not end."""

    def submit(self, work: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        return Future[T]()


@pytest.mark.soak
def test_a_plan_that_does_not_come_is_not_waited_for() -> None:
    async def story(show: VirtualShow) -> str:
        show.planning.instead = Never()
        record = show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: bool(show.view.alarms), 75.0)
        (alarm,) = show.view.alarms
        await show.reach(ShowPhase.LANDED, 120.0)
        assert (await show.settled(record)).outcome is Outcome.DONE
        assert show.floor_violations() == 0
        return alarm.text

    assert "no plan within 60 s" in fly(story, after=running)


class Fails(AtOnce):
    """An executor whose work fails: the error is in the future, as of a thread."""

    def submit(self, work: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        failed = Future[T]()
        failed.set_exception(MemoryError("Allocation failed"))
        return failed


def test_a_planner_that_fails_leaves_the_fleet_under_control() -> None:
    """The fleet flies home without a plan, an alarm says why, and no tick is missed."""

    async def story(show: VirtualShow) -> FlownTrack:
        show.planning.instead = Fails()
        stop_s = show.now_s
        record = show.service.commands.command_show(ShowAction.STOP)
        await show.until(lambda: bool(show.view.alarms), STOPPING_S + 2.0)
        (alarm,) = show.view.alarms
        assert alarm.cause is AlarmCause.RETURN_UNPLANNED
        assert "MemoryError" in alarm.text
        assert any("without a common plan" in event.text for event in show.service.events.newest())
        await show.reach(ShowPhase.LANDED, 120.0)
        assert (await show.settled(record)).outcome is Outcome.DONE
        # an alarm lasts for up to a second longer than its cause, and the landing may end sooner
        await show.until(lambda: not any(alarm.lasts for alarm in show.view.alarms), 2.0)
        assert show.floor_violations() == 0
        return show.track.between(stop_s)

    track = fly(story, after=running, ideal=True)
    assert np.diff(track.time_s).max() < 0.06


class PastLost(NamedTuple):
    off_pad_m: float  # of the vehicle with its pad below the lost one, over the ground
    off_lost_m: float  # from the lost one, over the ground
    reason: str  # of its descent
    others_off_pad_m: float
    floor_violations: int


async def return_past_a_lost_one(show: VirtualShow) -> PastLost:
    """A vehicle that hangs above the pad of another is lost; then all others return."""
    pads_m = show.true_m
    await show.start()
    await show.wait(15.0)
    away_m = np.linalg.norm((show.true_m[:, None] - pads_m[None])[..., :2], axis=2)
    away_m += 99.0 * np.eye(len(pads_m))
    lost, other = divmod(int(away_m.argmin()), len(pads_m))
    assert away_m.min() < 2.0, away_m.min()
    ids = show.config.ids
    show.ports.silence(ids[lost])
    await show.phase(ids[lost], Phase.LOST)
    record = show.service.commands.command_show(ShowAction.STOP)
    await show.phase(ids[other], Phase.LANDING, 120.0)
    reason = vehicles_of(show.view)[other].reason
    await show.settled(record, 60.0)
    landed_m, rest = show.true_m, np.delete(np.arange(len(ids)), [lost, other])
    off_m = np.linalg.norm((landed_m - pads_m)[:, :2], axis=1)
    off_lost_m = float(np.hypot(*(landed_m[other] - landed_m[lost])[:2]))
    return PastLost(
        float(off_m[other]), off_lost_m, reason, float(off_m[rest].max()), show.floor_violations()
    )


@pytest.mark.soak
def test_pad_below_a_lost_vehicle_is_left_for_a_free_place() -> None:
    """It hovered beside the space of the lost vehicle until its battery was empty."""
    config = show_config(COUNT, formation={"radius_m": 9.0, "height_m": 20.0}, operation=HOLDS_WHEN_LOST)
    landed = fly(return_past_a_lost_one, config, grid_columns=4)
    assert landed.off_lost_m > 2.5
    assert 1.0 < landed.off_pad_m < 10.0
    assert "beside its start" in landed.reason
    assert landed.others_off_pad_m < 1.5
    assert landed.floor_violations == 0
