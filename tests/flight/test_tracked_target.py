"""A target that reports where it is: selected, followed, lost, and found again, in flight."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.model.errors import RefusedError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Obstacle, Orbit, Target
from gcs.model.state import Array
from gcs.model.target_fix import TargetFix
from gcs.recording.audit_reader import rows
from gcs.recording.flight_report import make_flight_report
from gcs.recording.mcap_reader import FlightData, Standard
from gcs.recording.replay.service import Replay
from gcs.recording.session import Record
from gcs.recording.trajectories import estimated
from gcs.service import ShowAction
from gcs.service.alarms import AlarmCause
from gcs.service.features import Features
from gcs.testing.virtual_show import VirtualShow, fly, refused, show_config
from tests.support.reported_target import alarms, along_m, boat, off_m, report
from tests.support.sessions import found, four, sessions
from tests.support.show_phases import running
from tests.support.written_show import TEXT, config, select
from tests.support.written_show import fly as fly_on_pads

TARGETS: Final[dict[str, Any]] = {
    "targets": [
        {
            "name": "boat",
            "sources": [{"kind": "rest"}],
            "deviation_m": 0.5,
            "coast_s": 3.0,
            "coast_steady_s": 3.0,
        },
        {"name": "dinghy", "sources": [{"kind": "nmea", "at": "udp://127.0.0.1:10110"}]},
    ]
}

THERE_M = np.array([0.0, 65.0, 0.0])
"""60 m from where the boat begins."""


def center_m_s(show: VirtualShow) -> float:
    center = show.service.flight.newest.memory.center
    assert center is not None
    return float(np.hypot(*center.velocity_m_s[:2]))


def test_boat_is_followed_lost_and_found_again() -> None:
    async def story(show: VirtualShow) -> dict[str, float]:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        assert boat(show).state == "none"
        await report(show, 25.0)
        followed_m = off_m(show, along_m(25.0))
        assert boat(show).state == "tracked"
        assert AlarmCause.TARGET_LOST not in alarms(show)
        await show.wait(2.0)
        assert boat(show).state == "coasting"
        coasting_m = off_m(show, along_m(27.0))
        assert AlarmCause.TARGET_LOST in alarms(show)
        await show.wait(10.0)
        assert boat(show).state == "lost"
        held_m = show.true_m.mean(axis=0)
        await show.wait(5.0)
        drift_m = off_m(show, held_m)
        await report(show, 15.0, begin_s=30.0)
        assert boat(show).state == "tracked"
        return {
            "followed": followed_m,
            "coasting": coasting_m,
            "drift": drift_m,
            "again": off_m(show, along_m(45.0)),
            "violations": float(show.floor_violations()),
        }

    off = fly(story, show_config(4, **TARGETS), after=running)
    assert off["followed"] < 1.0
    assert off["coasting"] < 1.5
    assert off["drift"] < 0.6
    assert off["again"] < 1.0
    assert off["violations"] == 0.0


@pytest.mark.soak
def test_target_that_jumps_is_not_followed_there() -> None:
    """Selected again it is believed, wherever it is."""

    async def story(show: VirtualShow) -> tuple[float, float]:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        await report(show, 2.0, lambda _: along_m(0.0))
        show.service.plan.select_target("boat")
        await report(show, 15.0, lambda _: along_m(0.0))
        stood_m = show.true_m.mean(axis=0)
        await report(show, 20.0, lambda _: THERE_M)
        went_m = off_m(show, stood_m)
        assert "from where it was expected" in boat(show).why
        show.service.plan.select_target("boat")
        await report(show, 30.0, lambda _: THERE_M)
        return went_m, off_m(show, THERE_M)

    went_m, there_m = fly(story, show_config(4, **TARGETS), after=running)
    assert went_m < 3.0
    assert there_m < 1.0


@pytest.mark.soak
def test_record_has_the_target_and_the_report_how_near(tmp_path: Path) -> None:
    """The plan is recorded where it changes, not at each tick that a target moves it."""
    config = show_config(4, **TARGETS)
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(config.ids)}

    async def story(show: VirtualShow) -> None:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 25.0)
        await show.wait(2.0)

    with Record(tmp_path, config.model_dump_json(), vehicles) as record:
        fly(story, config, record=record)
    assert len(rows(tmp_path, "SELECT 1 FROM events WHERE event = 'plan'")) < 5
    data = FlightData(record.folder / "flight.mcap")
    flown = estimated(data)
    (tracking,) = flown.tracking
    assert tracking.target == "boat"
    assert tracking.followed_s == pytest.approx(27.0, abs=1.0)
    assert 1.0 < tracking.coasting_s < 2.0
    assert tracking.median_m is not None
    assert 0.0 < tracking.median_m < 0.5
    assert "not from the true target" in tracking.text
    body = make_flight_report(flown, Standard.of(data.about.config, "it")).report("it")
    assert body.tracking == flown.tracking

    targets = list(data.ticks())[-1].features.targets
    assert targets is not None
    assert (targets.selected, targets.targets[0].state) == ("boat", "coasting")
    assert targets.targets[0].age_s == pytest.approx(2.2, abs=0.4)

    async def first_shown() -> Features:
        return Replay(data, 1.0).view.value.features

    assert asyncio.run(first_shown()).targets is not None


@pytest.mark.soak
def test_operator_holds_and_takes_the_target_back() -> None:
    async def story(show: VirtualShow) -> float:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 15.0)
        show.service.plan.hold_target()
        targets = show.view.features.targets
        assert targets is not None
        await report(show, 10.0, begin_s=15.0)
        assert show.view.features.targets.selected == ""  # type: ignore[union-attr]
        return off_m(show, along_m(15.0))

    assert fly(story, show_config(4, **TARGETS), after=running) < 3.0


@pytest.mark.soak
def test_target_beyond_the_fence_is_followed_along_it() -> None:
    async def story(show: VirtualShow) -> tuple[float, float]:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        fence_m = show.config.control.safety.fence.distance_max_m
        await report(show, 3.0, lambda _: np.array([0.0, fence_m + 50.0, 0.0]))
        assert AlarmCause.TARGET_BEYOND in alarms(show)
        await report(show, 90.0, lambda _: np.array([0.0, fence_m + 50.0, 0.0]))
        return float(np.hypot(*show.true_m[:, :2].T).max()), fence_m

    farthest_m, fence_m = fly(story, show_config(4, **TARGETS), after=running)
    assert 0.8 * fence_m < farthest_m < fence_m


def test_refusals_name_the_targets() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        plan = show.service.plan
        unknown = await refused(show, lambda: plan.select_target("bota"))
        assert unknown.kind is UnknownError
        assert "there are boat, dinghy" in unknown.text
        other = await refused(show, lambda: plan.report_target("dinghy", TargetFix(0.0, 47.0, 8.0)))
        assert other.kind is RefusedError
        assert "has no source of kind rest; it has nmea" in other.text

    fly(story, show_config(4, **TARGETS))


def test_start_needs_the_selected_target() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.service.plan.select_target("boat")
        check = {each.name: each for each in show.service.preflight.report().fleet}["target-tracked"]
        assert not check.passes
        assert "boat: nothing was received yet" in check.problem
        await report(show, 2.0, lambda _: along_m(0.0))
        check = {each.name: each for each in show.service.preflight.report().fleet}["target-tracked"]
        assert check.passes

    fly(story, show_config(4, **TARGETS))


@pytest.mark.soak
def test_show_that_follows_no_target_ignores_the_selected_one(tmp_path: Path) -> None:
    """Neither the start nor an alarm asks for it; a show that follows one later needs it."""

    def asked(show: VirtualShow) -> set[str]:
        checks = show.service.preflight.report().fleet
        return {each.name for each in checks if each.name.startswith("target-")}

    async def story(show: VirtualShow) -> None:
        plan, far_m = show.service.plan, np.array([0.0, 500.0, 0.0])
        await show.standby()
        plan.select_target("boat")
        await report(show, 3.0, lambda _: far_m)
        assert "target-followed" in asked(show)
        assert AlarmCause.TARGET_BEYOND not in alarms(show)
        select(show)
        assert "target-followed" in asked(show)
        show_hash = select(show, TEXT.replace("target: live, ", ""))
        await show.wait(1.1)
        assert not asked(show)
        plan.hold_target()
        await show.wait(0.1)
        assert show.view.features.targets.selected == ""  # type: ignore[union-attr]
        plan.select_target("boat")
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        await show.wait(2.0)
        assert alarms(show).isdisjoint({AlarmCause.TARGET_BEYOND, AlarmCause.TARGET_LOST})
        assert "decides the target" in (await refused(show, plan.hold_target)).text

    fly_on_pads(story, config(tmp_path, **TARGETS))


def test_two_targets_need_two_names() -> None:
    with pytest.raises(ValidationError, match="boat is there twice"):
        show_config(4, targets=[TARGETS["targets"][0]] * 2)


@pytest.mark.soak
def test_fast_formation_brakes_where_an_obstacle_becomes_known() -> None:
    """It follows at more than the 4 m/s with which ways past obstacles are planned."""

    async def story(show: VirtualShow) -> tuple[float, float, int]:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 14.0, lambda seconds: 2.0 * along_m(seconds))
        fast_m_s = center_m_s(show)
        x_m, y_m = show.true_m.mean(axis=0)[:2].tolist()
        show.service.plan.add_obstacle(Obstacle("tower", x_m + 60.0, y_m, 3.0, 3.0, 60.0))
        await report(show, 3.0, lambda seconds: 2.0 * along_m(seconds), begin_s=14.0)
        slower_m_s = center_m_s(show)
        await report(show, 25.0, lambda seconds: 2.0 * along_m(seconds), begin_s=17.0)
        return fast_m_s, slower_m_s, show.floor_violations()

    fast_m_s, slower_m_s, violations = fly(story, show_config(4, **TARGETS), after=running)
    assert fast_m_s > 5.0
    assert slower_m_s < 4.3
    assert violations == 0


@pytest.mark.soak
def test_formation_comes_home_when_its_target_stays_lost() -> None:
    async def story(show: VirtualShow) -> list[str]:
        await report(show, 2.0)
        show.service.plan.select_target("boat")
        await report(show, 10.0, begin_s=2.0)
        phases = [show.view.show]
        for seconds in (9.0, 3.0):
            await show.wait(seconds)
            phases.append(show.view.show)
        return [phase.value for phase in phases]

    lost = {"failsafes": {"target_stale": {"action": "return", "after_s": 10.0}}}
    assert fly(story, show_config(4, **TARGETS, **lost), after=running) == ["running", "running", "returning"]


@pytest.mark.soak
@pytest.mark.parametrize("is_configured", [True, False], ids=["configured", "configured no more"])
def test_restarted_service_follows_the_target_again(tmp_path: Path, *, is_configured: bool) -> None:
    """On its last motion until it is reported; one that is not configured any more is not followed."""

    async def begin(show: VirtualShow) -> None:
        show.service.plan.select_target("boat")
        await report(show, 1.0)
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        await report(show, 20.0, begin_s=1.0)

    async def go_on(show: VirtualShow) -> None:
        await found(show)
        await show.settled(show.service.recovery.settle(Offer.TAKE_OVER))
        await show.show(ShowAction.RESUME)
        await show.reach(ShowPhase.RUNNING)
        targets = show.view.features.targets
        assert targets is not None
        assert targets.selected == ("boat" if is_configured else "")
        stands_m = show.view.target_m
        await show.wait(5.0)
        assert show.view.target_m == pytest.approx(stands_m, abs=0.01)
        texts = [each.text for each in show.service.events.newest()]
        assert any("boat is not followed any more" in text for text in texts) is not is_configured
        if is_configured:
            await report(show, 10.0, begin_s=60.0)
            assert show.view.target_m == pytest.approx(along_m(70.0)[:2], abs=1.0)
            assert boat(show).state == "tracked"

    targets = TARGETS["targets"] if is_configured else TARGETS["targets"][1:]
    sessions(tmp_path, (four(**TARGETS), begin), (four(targets=targets), go_on))


@pytest.mark.soak
def test_target_that_is_too_fast_is_said_before_it_is_lost() -> None:
    """On the ground it refuses the start."""

    def away(speed_m_s: float, starts_s: float = 0.0) -> Callable[[float], Array]:
        """Straight on; it needs `starts_s` to be that fast."""

        def at_m(seconds: float) -> Array:
            share = min(seconds / starts_s, 1.0) if starts_s else 1.0
            return np.array([speed_m_s * (seconds - starts_s * share * (1.0 - share / 2.0)), 0.0, 0.0])

        return at_m

    async def story(show: VirtualShow) -> tuple[float, float]:
        await show.standby()
        await report(show, 4.0, away(20.0))
        show.service.plan.select_target("boat")
        check = {each.name: each for each in show.service.preflight.report().fleet}["target-followed"]
        assert "moves at 20" in check.problem
        show.service.plan.select_target("boat")
        show.service.plan.hold_target()
        await report(show, 3.0, lambda _: np.zeros(3))
        show.service.plan.set_target(Target())
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 6.0, lambda _: np.zeros(3))
        assert AlarmCause.TARGET_OUTRUNS not in alarms(show)
        for number in range(8):
            await report(show, 1.0, away(9.0, 3.0), begin_s=float(number))
            if AlarmCause.TARGET_OUTRUNS in alarms(show):
                break
        targets = show.view.features.targets
        assert targets is not None
        return number + 1.0, targets.follows_m_s or 0.0

    alarm_s, follows_m_s = fly(story, show_config(4, **TARGETS))
    assert follows_m_s < 9.0
    assert alarm_s <= 3.0 * follows_m_s / 9.0 + 3.0  # it is as fast as they are then, and 3 s later


@pytest.mark.soak
def test_formation_keeps_inside_the_circle_of_a_faster_target() -> None:
    """From its second round on, and the alarm says so; behind it, with 7.6 m/s, it would be 21 m away."""
    radius_m, speed_m_s = 40.0, 9.0

    def round_m(seconds: float) -> Array:
        angle = speed_m_s / radius_m * seconds
        return np.array([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0])

    async def story(show: VirtualShow) -> tuple[float, str]:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 66.0, round_m)
        texts = [each.text for each in show.view.alarms if each.cause is AlarmCause.TARGET_OUTRUNS]
        return off_m(show, round_m(66.0)), " ".join(texts)

    beside_m, text = fly(story, show_config(4, **TARGETS))
    assert beside_m < 16.0
    assert "keeps inside its circle" in text


@pytest.mark.soak
def test_target_that_is_not_tracked_is_held_after_a_while() -> None:
    """The formation does not fly on for ever on the motion of the one before."""

    async def story(show: VirtualShow) -> float:
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 15.0)
        show.service.plan.select_target("dinghy")
        await show.wait(10.0)
        stood_m = show.true_m.mean(axis=0)
        await show.wait(10.0)
        assert AlarmCause.TARGET_LOST in alarms(show)
        return off_m(show, stood_m)

    assert fly(story, show_config(4, **TARGETS), after=running) < 1.0
