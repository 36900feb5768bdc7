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
from gcs.model.lifecycle import Phase, ShowPhase
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
from gcs.service.features import Features, TargetView
from gcs.testing.virtual_show import VirtualShow, fly, refused, show_config
from tests.support.sessions import found, four, sessions

TARGETS: Final[dict[str, Any]] = {
    "targets": [
        {"name": "boat", "sources": [{"kind": "rest"}], "deviation_m": 0.5, "coast_s": 3.0},
        {"name": "dinghy", "sources": [{"kind": "nmea", "at": "udp://127.0.0.1:10110"}]},
    ]
}

SPEED_M_S, PERIOD_S = 3.0, 0.2

THERE_M = np.array([0.0, 65.0, 0.0])
"""60 m from where the boat begins."""


def boat(show: VirtualShow) -> TargetView:
    targets = show.view.features.targets
    assert targets is not None
    return targets.targets[0]


def along_m(seconds: float) -> Array:
    """(3,) straight on, to the north-east of the show's origin."""
    return np.array([SPEED_M_S * seconds, 5.0, 0.0])


async def report(
    show: VirtualShow, seconds: float, place: Callable[[float], Array] = along_m, *, begin_s: float = 0.0
) -> None:
    """Report the boat five times a second for so long; `place` gets the seconds since `begin_s`."""
    for number in range(round(seconds / PERIOD_S)):
        place_m = place(begin_s + number * PERIOD_S)
        latitude_deg, longitude_deg, _ = show.config.frame.geodetic(place_m[None])
        fix = TargetFix(show.now_s, float(latitude_deg[0]), float(longitude_deg[0]))
        show.service.plan.report_target("boat", fix)
        await show.wait(PERIOD_S)


def off_m(show: VirtualShow, place_m: Array) -> float:
    return float(np.hypot(*(show.true_m.mean(axis=0) - place_m)[:2]))


def center_m_s(show: VirtualShow) -> float:
    center = show.service.flight.newest.memory.center
    assert center is not None
    return float(np.hypot(*center.velocity_m_s[:2]))


def alarms(show: VirtualShow) -> set[AlarmCause]:
    return {alarm.cause for alarm in show.view.alarms if alarm.lasts}


def test_boat_is_followed_lost_and_found_again() -> None:
    async def story(show: VirtualShow) -> dict[str, float]:
        await show.start()
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

    off = fly(story, show_config(4, **TARGETS))
    assert off["followed"] < 1.0
    assert off["coasting"] < 1.5
    assert off["drift"] < 0.6
    assert off["again"] < 1.0
    assert off["violations"] == 0.0


def test_target_that_jumps_is_not_followed_there() -> None:
    """Selected again it is believed, wherever it is."""

    async def story(show: VirtualShow) -> tuple[float, float]:
        await show.start()
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

    went_m, there_m = fly(story, show_config(4, **TARGETS))
    assert went_m < 3.0
    assert there_m < 1.0


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


def test_operator_holds_and_takes_the_target_back() -> None:
    async def story(show: VirtualShow) -> float:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 15.0)
        show.service.plan.hold_target()
        targets = show.view.features.targets
        assert targets is not None
        await report(show, 10.0, begin_s=15.0)
        assert show.view.features.targets.selected == ""  # type: ignore[union-attr]
        return off_m(show, along_m(15.0))

    assert fly(story, show_config(4, **TARGETS)) < 3.0


def test_target_beyond_the_fence_is_followed_along_it() -> None:
    async def story(show: VirtualShow) -> tuple[float, float]:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        fence_m = show.config.control.safety.fence.distance_max_m
        await report(show, 3.0, lambda _: np.array([0.0, fence_m + 50.0, 0.0]))
        assert AlarmCause.TARGET_BEYOND in alarms(show)
        await report(show, 90.0, lambda _: np.array([0.0, fence_m + 50.0, 0.0]))
        return float(np.hypot(*show.true_m[:, :2].T).max()), fence_m

    farthest_m, fence_m = fly(story, show_config(4, **TARGETS))
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


def test_two_targets_need_two_names() -> None:
    with pytest.raises(ValidationError, match="boat is there twice"):
        show_config(4, targets=[TARGETS["targets"][0]] * 2)


def test_fast_formation_brakes_where_an_obstacle_becomes_known() -> None:
    """It follows at more than the 4 m/s with which ways past obstacles are planned."""

    async def story(show: VirtualShow) -> tuple[float, float, int]:
        await show.start()
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

    fast_m_s, slower_m_s, violations = fly(story, show_config(4, **TARGETS))
    assert fast_m_s > 5.0
    assert slower_m_s < 4.3
    assert violations == 0


PERSON = {
    "targets": [{"name": "boat", "sources": [{"kind": "rest"}], "deviation_m": 0.5, "clearance_m": 12.0}]
}
FAR_M = np.array([60.0, 5.0, 0.0])


def test_formation_flies_clear_of_a_person() -> None:
    """The sphere rises above them. A vehicle stands too near to their first place: the start is refused."""

    async def story(show: VirtualShow) -> tuple[float, float]:
        await show.standby()
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: np.zeros(3))
        check = {each.name: each for each in show.service.preflight.report().fleet}["kept clear"]
        assert "clearance of 12 m" in check.problem
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: FAR_M)
        await show.start()
        await report(show, 40.0, lambda _: FAR_M)
        nearest_m = np.inf
        for _ in range(20):
            await report(show, 1.0, lambda _: FAR_M)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        assert AlarmCause.TARGET_NEAR not in alarms(show)
        return nearest_m, off_m(show, FAR_M)

    nearest_m, off = fly(story, show_config(4, **PERSON))
    assert nearest_m > 12.0
    assert off < 1.0


def test_person_under_a_low_fence_is_kept_clear_of_and_said() -> None:
    """The fence leaves no room for the sphere above them: the filter keeps the distance, not the shape."""
    low = {"control": {"safety": {"fence": {"height_max_m": 24.0}}}}

    async def story(show: VirtualShow) -> tuple[float, set[AlarmCause]]:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.select_target("boat")
        seen, nearest_m = set(), np.inf
        for _ in range(60):
            await report(show, 1.0, lambda _: FAR_M)
            seen |= alarms(show)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        return nearest_m, seen

    nearest_m, seen = fly(story, show_config(4, **PERSON, **low))
    assert AlarmCause.TARGET_NO_ROOM in seen
    assert nearest_m > 12.0


def test_vehicle_that_a_person_walks_under_is_an_alarm() -> None:
    async def story(show: VirtualShow) -> set[AlarmCause]:
        await show.start()
        await show.wait(5.0)
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        under_m = show.true_m[0] * (1.0, 1.0, 0.0)
        await report(show, 1.0, lambda _: under_m)
        show.service.plan.select_target("boat")
        await report(show, 2.0, lambda _: under_m)
        seen = alarms(show)
        await report(show, 30.0, lambda _: under_m)
        assert AlarmCause.TARGET_NEAR not in alarms(show)
        return seen

    config = show_config(4, targets=[PERSON["targets"][0] | {"clearance_m": 25.0}])
    assert AlarmCause.TARGET_NEAR in fly(story, config)


def test_formation_comes_home_when_its_target_stays_lost() -> None:
    async def story(show: VirtualShow) -> list[str]:
        await show.start()
        await report(show, 2.0)
        show.service.plan.select_target("boat")
        await report(show, 10.0, begin_s=2.0)
        phases = [show.view.show]
        for seconds in (9.0, 3.0):
            await show.wait(seconds)
            phases.append(show.view.show)
        return [phase.value for phase in phases]

    lost = {"failsafes": {"target_stale": {"action": "return", "after_s": 10.0}}}
    assert fly(story, show_config(4, **TARGETS, **lost)) == ["running", "running", "returning"]


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


def test_person_who_is_not_followed_is_kept_clear_of_too() -> None:
    """The formation is sent over them, to a place behind; also after they are lost."""
    people = {"targets": [PERSON["targets"][0] | {"coast_s": 3.0}]}

    async def story(show: VirtualShow) -> float:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        await report(show, 2.0, lambda _: FAR_M)
        show.service.plan.set_target(Target(2.0 * FAR_M[0], FAR_M[1]))
        nearest_m = np.inf
        for number in range(40):
            if number < 5:
                await report(show, 1.0, lambda _: FAR_M)
            else:
                await show.wait(1.0)
            nearest_m = min(nearest_m, float(np.linalg.norm(show.true_m - FAR_M, axis=1).min()))
        assert off_m(show, 2.0 * FAR_M) < 8.0
        return nearest_m

    assert fly(story, show_config(4, **people)) > 12.0


async def walks_with(show: VirtualShow, seconds: float, place_m: Array) -> tuple[float, set[Phase]]:
    """Report the person there; how near a vehicle in the air came, and the phases at the end."""
    nearest_m = np.inf
    for _ in range(round(seconds)):
        await report(show, 1.0, lambda _: place_m)
        aloft_m = show.true_m[show.true_m[:, 2] < -0.5]
        off_m = np.linalg.norm(aloft_m - place_m, axis=1)
        nearest_m = min(nearest_m, float(off_m.min(initial=np.inf)))
    return nearest_m, {show.vehicle(name).phase for name in show.config.ids}


@pytest.mark.parametrize("action", [ShowAction.ABORT, ShowAction.STOP])
def test_all_land_clear_of_a_person(action: ShowAction) -> None:
    """An abort over the person who is followed, and a return to pads at which the person stands by now."""

    async def story(show: VirtualShow) -> tuple[float, set[Phase]]:
        await report(show, 1.0, lambda _: FAR_M)
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await walks_with(show, 30.0, FAR_M)
        there_m = FAR_M
        if action is ShowAction.STOP:
            show.service.plan.hold_target()
            show.service.plan.select_target("boat")  # it is believed to be elsewhere now
            show.service.plan.hold_target()
            there_m = np.zeros(3)
            await report(show, 1.0, lambda _: there_m)
        await show.show(action)
        return await walks_with(show, 120.0, there_m)

    nearest_m, phases = fly(story, show_config(4, **PERSON))
    assert phases == {Phase.STANDBY}
    assert nearest_m > 12.0


def test_target_that_is_not_tracked_is_held_after_a_while() -> None:
    """The formation does not fly on for ever on the motion of the one before."""

    async def story(show: VirtualShow) -> float:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 4.0))
        show.service.plan.select_target("boat")
        await report(show, 15.0)
        show.service.plan.select_target("dinghy")
        await show.wait(10.0)
        stood_m = show.true_m.mean(axis=0)
        await show.wait(10.0)
        assert AlarmCause.TARGET_LOST in alarms(show)
        return off_m(show, stood_m)

    assert fly(story, show_config(4, **TARGETS)) < 1.0


def test_target_can_be_held_where_the_fence_leaves_no_room() -> None:
    low = {"control": {"safety": {"fence": {"height_max_m": 24.0}}}}

    async def story(show: VirtualShow) -> float:
        await show.start()
        show.service.plan.set_orbit(Orbit(0.0, 2.0))
        await report(show, 2.0)
        show.service.plan.select_target("boat")
        await report(show, 10.0, begin_s=2.0)
        show.service.plan.hold_target()
        await show.wait(1.0)
        held_m = np.array(show.view.target_m)
        await report(show, 10.0, begin_s=12.0)
        return float(np.hypot(*(np.array(show.view.target_m) - held_m)))

    assert fly(story, show_config(4, **PERSON, **low)) < 0.1


def test_person_who_is_lost_is_forgotten_by_a_command() -> None:
    """Selected again, and held: the start is no longer refused."""

    async def story(show: VirtualShow) -> list[bool]:
        await show.standby()
        await report(show, 2.0, lambda _: np.zeros(3))
        await show.wait(60.0)
        passes = []
        for name in ("", "boat", ""):
            if name:
                show.service.plan.select_target(name)
            else:
                show.service.plan.hold_target()
            await show.wait(1.0)
            checks = {each.name: each for each in show.service.preflight.report().fleet}
            passes.append("kept clear" not in checks or checks["kept clear"].passes)
        return passes

    assert fly(story, show_config(4, **PERSON)) == [False, True, True]
