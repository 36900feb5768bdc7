"""Preflight through the service: every check made to fail is named, and keeps the show on the ground."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from gcs.config.schema import Config
from gcs.model.errors import GcsError, InvalidError, RefusedError, UnknownError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Target
from gcs.model.preflight_report import Check, PreflightReport
from gcs.recording.session import Record
from gcs.service import CALLER, Outcome, ShowAction
from gcs.testing.virtual_show import VirtualShow, alarm_texts, fly, refused, show_config
from tests.flight.test_show_autopilots import config_of
from tests.support.audit_rows import commands
from tests.support.written_show import NAME, check, config, keep, on_pads, select
from tests.support.written_show import TEXT as SHOW
from tests.support.written_show import fly as fly_show

MOVED_M = 12.0

RECEIVED_S = 3.0
"""Whatever a vehicle tells seldom has come by then."""


class Refused(NamedTuple):
    """What preflight said, and what a start did."""

    report: PreflightReport
    text: str


async def start_refused(show: VirtualShow, show_hash: str) -> Refused:
    """Look, and start all the same."""
    report = show.service.preflight.report()
    refusal = await refused(
        show, lambda: show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
    )
    assert refusal.kind is RefusedError
    assert show.view.show is ShowPhase.IDLE
    assert not any(pilot.commander.armed for pilot in show.fleet.autopilots)
    assert not report.passes
    return Refused(report, refusal.text)


def failing(report: PreflightReport) -> dict[str, Check]:
    """By vehicle and check, or by the fleet's check."""
    fleet = {check.name: check for check in report.fleet if not check.passes}
    own = {
        f"{vehicle.id} {check.name}": check
        for vehicle in report.vehicles
        if vehicle.flies
        for check in vehicle.failed
    }
    return fleet | own


def stands_so(tmp_path: Path, **settings: Any) -> Refused:
    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        return await start_refused(show, select(show))

    return fly_show(story, config(tmp_path), **settings)


def test_fleet_on_its_pads_passes_all_checks_and_starts(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        report = show.service.preflight.report()
        assert failing(report) == {}
        assert report.passes
        assert (report.show, report.show_hash) == (NAME, show_hash)
        assert {check.name for check in report.fleet} == {
            *("vehicles", "show", "formation", "obstacles"),
            *("start pattern", "rotation of the start pattern", "shift of the start pattern"),
        }
        assert report.not_checked == (
            "loss times, loss of the ground station: operation.require_safe_setpoint_loss is false",
        )
        show.service.commands.command_show(ShowAction.START, show_hash=show_hash)
        await show.reach(ShowPhase.RUNNING)
        flown_by = show.service.preflight.report()
        assert not flown_by.passes, "a start is refused"
        assert (
            flown_by.in_flight
            == "the show is running, 4 of 4 vehicles fly; a start is refused until all are down"
        )
        assert failing(flown_by) == {}
        assert flown_by.unix_time_s < show.unix() - 5.0, "in the air nothing is looked at again"

    fly_show(story, config(tmp_path))


@pytest.mark.keeps("7.0")
@pytest.mark.parametrize("by_deg", [7.0, -7.0])
def test_a_start_pattern_rotated_by_7_degrees_is_refused_by_name(tmp_path: Path, by_deg: float) -> None:
    found = stands_so(tmp_path, **on_pads(turned_deg=by_deg))
    assert set(failing(found.report)) == {"rotation of the start pattern"}
    check = failing(found.report)["rotation of the start pattern"]
    assert check.value == pytest.approx(by_deg, abs=1.5)
    assert check.unit == "deg"
    assert "the start pattern is turned by" in found.text
    assert ("counterclockwise" in found.text) == (by_deg < 0.0)
    assert "check show_frame (heading" in found.text


@pytest.mark.soak
def test_a_start_pattern_shifted_by_5_m_is_refused_by_name(tmp_path: Path) -> None:
    found = stands_so(tmp_path, **on_pads(north_m=3.0, east_m=-4.0))
    assert set(failing(found.report)) == {"shift of the start pattern"}
    check = failing(found.report)["shift of the start pattern"]
    assert check.value == pytest.approx(5.0, abs=0.5)
    assert (check.unit, check.limit) == ("m", "at most 2 m")
    assert "the start pattern is shifted by" in found.text


@pytest.mark.soak
def test_show_that_was_moved_is_to_be_selected_again(tmp_path: Path) -> None:
    """What the old place asks for is folded under that; selected again it starts."""
    moved = SHOW.replace("spacing_m: 5.0", f"spacing_m: 5.0, x_m: {MOVED_M}").replace("{x_m: 3,", "{x_m: 9,")

    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        show_hash = select(show)
        check(show, moved)
        found = await start_refused(show, show_hash)
        select(show, moved)
        await show.wait(1.1)
        assert show.service.preflight.report().passes
        return found

    beside = on_pads(north_m=MOVED_M * np.cos(np.radians(30.0)), east_m=MOVED_M * np.sin(np.radians(30.0)))
    found = fly_show(story, config(tmp_path), **beside)
    (cause,) = found.report.causes
    assert cause.text == "show 'small' was moved or changed since it was selected"
    assert cause.to_do.startswith("select it again")
    assert "shift of the start pattern" in cause.follows
    assert found.text.startswith(cause.text)


@pytest.mark.soak
def test_show_frame_wrong_by_7_degrees_is_refused(
    tmp_path: Path,
) -> None:
    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        return await start_refused(show, select(show, SHOW.replace("heading_deg: 30.0", "heading_deg: 37.0")))

    wrong = config(tmp_path, show_frame={"heading_deg": 37.0})
    found = fly_show(story, wrong)
    assert set(failing(found.report)) == {"rotation of the start pattern"}
    assert "counterclockwise" in found.text


def swap(show: VirtualShow) -> None:
    """The first two stand each on the other's pad."""
    (x_m, y_m, _), (u_m, v_m, _) = show.fleet.bodies.position_m[:2].tolist()
    show.befall("d1", "gps-jump", north_m=u_m - x_m, east_m=v_m - y_m)
    show.befall("d2", "gps-jump", north_m=x_m - u_m, east_m=y_m - v_m)


def mistune(show: VirtualShow) -> None:
    """Somebody has changed a parameter; the vehicle restarts."""
    show.autopilot("d2").parameters.set("GF_ACTION", 0)
    show.befall("d2", "reboot", off_s=3.0)


FAULTS: dict[str, tuple[Callable[[VirtualShow], object], str]] = {
    "d2 address": (
        lambda show: show.ports.duplicated.add("d2"),
        "system id 2 at 10.0.0.2:14580 and at 10.0.1.2:14580",
    ),
    "d2 fix": (lambda show: show.befall("d2", "fix", type="2d"), "its receiver's fix is 2D"),
    "d2 accuracy sideways": (
        lambda show: show.befall("d2", "accuracy", eph_m=9.0),
        "its receiver reports an accuracy of 9.0 m sideways",
    ),
    "d2 autopilot": (
        lambda show: show.befall("d2", "sensor", which="magnetometer"),
        "its autopilot does not yet pass its own arming checks: magnetometer",
    ),
    "d2 battery": (lambda show: show.befall("d2", "battery", remaining=0.3), "for this show"),
    "d2 clock": (
        lambda show: show.befall("d2", "wrong-time", ahead_s=60.0),
        "s ahead of this machine's, at most 2 s",
    ),
    "d2 height of the pad": (
        lambda show: show.befall("d2", "gps-jump", down_m=-2.8),
        "above the middle one of all pads, at most 2 m",
    ),
    "d2 height of the origin": (
        lambda show: show.befall("d2", "gps-jump", down_m=-6.0),
        "above the show's origin, at most 3 m",
    ),
    "d2 place": (swap, "off its start place, on that of d1"),
    "d2 own fence": (mistune, "GF_ACTION is 0, 2 is needed"),
    "show": (lambda show: keep(show, SHOW + "\n# a word\n"), "has changed since it was checked"),
    "d2 received": (lambda show: show.ports.silence("d2"), "offline: no telemetry for "),
}


@pytest.mark.alternates(0)
@pytest.mark.parametrize("name", FAULTS)
def test_each_check_that_fails_is_named_and_refuses_the_start(tmp_path: Path, name: str) -> None:
    fault, says = FAULTS[name]

    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        show_hash = select(show)
        assert show.service.preflight.report().passes
        fault(show)
        await show.wait(RECEIVED_S)
        if name == "d2 own fence":
            await show.wait(10.0)
        return await start_refused(show, show_hash)

    found = fly_show(story, config(tmp_path))
    assert says in found.text
    check = failing(found.report)[name]
    assert says in check.problem
    assert check.limit


def test_a_refused_start_names_all_that_fails_causes_first(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        show_hash = select(show)
        show.ports.silence("d1")
        show.befall("d2", "battery", remaining=0.1)
        show.befall("d3", "fix", type="2d")
        await show.wait(RECEIVED_S)
        return await start_refused(show, show_hash)

    found = fly_show(story, config(tmp_path))
    assert {"d1 received", "d2 battery", "d3 fix"} <= failing(found.report).keys()
    first = ("d1: offline: no telemetry for ", "d2: battery at 10%", "d3: its receiver's fix is 2D")
    assert all(text in found.text for text in first)
    causes, _, follows = found.text.partition("; follows: ")
    assert "d3: its receiver does not tell its accuracy" in follows
    assert "accuracy" not in causes
    assert "d1: " not in follows, "it is absent"
    lines = re.split(r"; (?=\d\. )", causes)
    for number, (cause, line) in enumerate(zip(found.report.causes, lines, strict=True), 1):
        assert line.startswith(f"{number}. ")
        assert cause.to_do in line


@pytest.mark.soak
def test_an_empty_fleet_is_no_cause_where_all_vehicles_fail(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> Refused:
        await show.standby()
        show_hash = select(show)
        for vehicle in show.config.ids:
            show.befall(vehicle, "battery", remaining=0.1)
        await show.wait(RECEIVED_S)
        return await start_refused(show, show_hash)

    found = fly_show(story, config(tmp_path))
    (cause,) = found.report.causes
    assert (cause.check, cause.vehicles, cause.follows) == ("battery", ("d1", "d2", "d3", "d4"), ())
    assert "no vehicle" not in found.text


COMPLAINTS: dict[str, tuple[tuple[str, str], str]] = {
    "px4": (("px4", "px4"), '"Compass 0 fault"'),
    "ardupilot": (("ardupilot", "ardupilot"), '"Compass not healthy"'),
}


@pytest.mark.soak
@pytest.mark.parametrize("name", COMPLAINTS)
def test_complaints_of_an_autopilot_show_until_they_are_over(name: str) -> None:
    kinds, says = COMPLAINTS[name]

    async def story(show: VirtualShow) -> None:
        def complaint() -> Check | None:
            show.service.preflight._last = None
            return failing(show.service.preflight.report()).get("d2 autopilot")

        def says_so() -> bool:
            return (check := complaint()) is not None and says in check.problem

        await show.standby()
        show.befall("d2", "sensor", which="magnetometer")
        await show.until(says_so, 35.0)  # ArduPilot repeats its reasons every 30 s
        for _ in range(10):
            await show.wait(8.0)
            assert says_so()
        check = complaint()
        assert check is not None
        assert check.to_do == "mend what it says"
        show.befall("d2", "none")
        await show.wait(RECEIVED_S)
        assert complaint() is None
        assert not any(
            says[1:-1] in text.text for text in show.service.preflight.flight.newest.telemetry.texts[1]
        )

    fly(story, config_of(kinds, 2))


@pytest.mark.soak
def test_a_battery_is_measured_against_the_show_that_is_selected(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.befall("d2", "battery", remaining=0.3)
        await show.wait(RECEIVED_S)
        assert show.service.preflight.report().passes, "without a show a quarter is enough"
        show_hash = select(show)
        found = await start_refused(show, show_hash)
        need = show.service.shows.checked(NAME).figures.battery_need  # type: ignore[union-attr]
        check = failing(found.report)["d2 battery"]
        assert check.value == pytest.approx(0.3, abs=0.01)
        assert check.limit == f"at least {need:.0%} for this show"

    fly_show(story, config(tmp_path))


@pytest.mark.soak
def test_equal_clock_offsets_show_that_this_clock_is_wrong(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show.unix.ahead_s += 30.0
        found = failing(show.service.preflight.report())
        assert set(found) == {f"d{number} clock" for number in range(1, 5)}
        assert found["d1 clock"].value == pytest.approx(-30.0, abs=0.5)
        assert "set this machine's clock (NTP) if all differ alike" in found["d1 clock"].to_do

    fly_show(story, config(tmp_path))


def test_show_at_a_clock_time_is_called_off_by_a_failed_check(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        show_hash = select(show)
        record = show.service.commands.command_show(
            ShowAction.START, show_hash=show_hash, at_unix_time_s=show.unix() + 10.0
        )
        assert (await refused(show, lambda: show.service.preflight.exclude("d2", ""))).kind is RefusedError
        show.befall("d2", "fix", type="none")
        await show.until(lambda: show.view.show is ShowPhase.IDLE, 20.0)
        assert "its receiver's fix is none" in show.view.reason
        assert show.service.command_log.get(record.id).outcome is Outcome.FAILED

    fly_show(story, config(tmp_path))


@pytest.mark.soak
def test_excluded_vehicles_stay_grounded_with_operator_named(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        show_hash = select(show)
        show.befall("d2", "battery", remaining=0.1)
        await show.wait(RECEIVED_S)
        await start_refused(show, show_hash)
        CALLER.set("anna")
        record = service.preflight.exclude("d2", "a cracked propeller")
        assert (record.action, record.by, record.outcome) == ("exclude", "anna", Outcome.DONE)
        why = "taken out of the show by anna: a cracked propeller"
        report = service.preflight.report()
        assert failing(report) == {}
        assert {vehicle.id: vehicle.reason for vehicle in report.vehicles if not vehicle.flies} == {"d2": why}
        await show.wait(0.2)
        assert f"Vehicle d2 not flying: {why}." in alarm_texts(show)
        started = service.commands.command_show(ShowAction.START, show_hash=show_hash)
        assert (started.outcomes["d2"].outcome, started.outcomes["d2"].reason) == (Outcome.NOT_INCLUDED, why)
        await show.reach(ShowPhase.RUNNING)
        assert f"Vehicle d2 not flying: {why}." in alarm_texts(show)
        assert show.vehicle("d2").phase is Phase.STANDBY
        assert not show.autopilot("d2").commander.armed
        for change in (lambda: service.preflight.exclude("d1", ""), lambda: service.preflight.include("d2")):
            refusal = await refused(show, change)
            assert "excluded or included only on the ground" in refusal.text
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        service.preflight.include("d2")
        await show.until(lambda: not any("d2" in text for text in alarm_texts(show)), 2.0)
        assert "d2 battery" in failing(service.preflight.report()), "who is in again is judged again"

    asked = config(tmp_path)
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(asked.ids)}
    with Record(tmp_path / "runs", asked.model_dump_json(), vehicles) as record:
        fly_show(story, asked, record=record)
    noted = [(each.action, each.caller) for each in commands(tmp_path / "runs")]
    assert ("exclude", "anna") in noted
    assert ("include", "anna") in noted


def test_bad_exclusions_change_nothing(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        bad: list[tuple[Callable[[], object], type[GcsError], str]] = [
            (lambda: service.preflight.exclude("d9", ""), UnknownError, "there is no vehicle d9"),
            (lambda: service.preflight.include("d9"), UnknownError, "there is no vehicle d9"),
            (lambda: service.preflight.include("d2"), RefusedError, "d2 was not taken out"),
            (lambda: service.preflight.exclude("d2", "x" * 201), InvalidError, "at most 200 characters"),
            (lambda: service.preflight.report(["d1", "d9"]), UnknownError, "there is no vehicle d9"),
        ]
        for request, kind, says in bad:
            refusal = await refused(show, request)
            assert (refusal.kind, says in refusal.text) == (kind, True)
        assert all(vehicle.flies for vehicle in service.preflight.report().vehicles)
        service.preflight.exclude("d2", "")
        start = lambda: service.commands.command_show(ShowAction.START, ["d1", "d2"])  # noqa: E731
        assert "include it first" in (await refused(show, start)).text

    fly(story, show_config(3))


@pytest.mark.soak
def test_vehicles_that_fail_to_climb_are_listed_as_not_flying() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d4")
        await show.standby()
        show.service.commands.command_show(ShowAction.START, ["d1", "d2"])
        show.fleet.state.unhealthy_sensors[1] = 0x1
        await show.reach(ShowPhase.RUNNING)
        (text,) = alarm_texts(show)
        assert text.startswith("Vehicles d3, d4, d2 not flying: ")
        assert "d3, d4: not chosen" in text
        assert "d2: its autopilot does not yet pass its own arming checks" in text
        await show.show(ShowAction.STOP)
        await show.reach(ShowPhase.LANDED)
        await show.wait(1.5)
        assert [alarm.cause for alarm in show.view.alarms] == ["silent"], (
            "d4 is not received, and it was not left out"
        )

    fly(story, show_config(4))


@pytest.mark.soak
def test_a_silent_vehicle_is_an_issue_until_it_is_left_out() -> None:
    async def story(show: VirtualShow) -> None:
        service = show.service
        await show.standby()
        assert alarm_texts(show) == []
        show.ports.silence("d3")
        await show.phase("d3", Phase.OFFLINE)
        await show.wait(1.5)
        (alarm,) = show.view.alarms
        assert (alarm.cause, alarm.vehicles, alarm.action) == ("silent", ("d3",), "leave-out")
        await show.wait(30.0)
        report = service.preflight.report()
        (cause,) = report.causes
        assert re.fullmatch(r"d3: offline: no telemetry for 3\d s", cause.text)
        assert cause.action is not None
        assert (cause.action.label, cause.action.then) == ("Leave d3 out", "ready")
        refusal = await refused(show, lambda: service.commands.command_show(ShowAction.START))
        assert refusal.text.startswith("d3: offline: no telemetry for 3")
        service.preflight.exclude("d3", "stays here")
        assert service.preflight.report().passes
        await show.wait(0.5)
        assert [alarm.cause for alarm in show.view.alarms] == ["not-flying"]
        service.commands.command_show(ShowAction.START)
        await show.reach(ShowPhase.RUNNING)
        assert show.view.reason == "formation reached"
        show.befall("d2", "battery", remaining=0.05)
        await show.until(lambda: show.view.reason != "formation reached", 20.0)
        assert show.view.reason == "3 of 4 in formation, without d2", "it is not reached for ever"

    fly(story, show_config(5))


@pytest.mark.soak
def test_a_vehicle_never_received_has_no_values() -> None:
    async def story(show: VirtualShow) -> None:
        show.ports.silence("d2")
        await show.standby()
        rows = show.view.rows
        for column in (rows.uncertainty_m, rows.link_quality, rows.battery_remaining, rows.fix_type):
            assert np.isfinite(column).tolist() == [True, False]

    fly(story, show_config(2))


@pytest.mark.soak
def test_no_vehicle_left_is_no_pass() -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        for name in show.config.ids:
            show.service.preflight.exclude(name, "")
        report = show.service.preflight.report()
        assert not report.passes
        assert [cause.text for cause in report.causes] == ["no vehicle is left"]

    fly(story, show_config(2))


def placed(**places: tuple[float, float]) -> Config:
    """Three vehicles with start places in the configuration."""
    named = {name: {"x_m": x_m, "y_m": y_m} for name, (x_m, y_m) in places.items()}
    return show_config(3, show_frame={"heading_deg": 0.0}, preflight={"start_places": named})


@pytest.mark.soak
def test_without_a_written_show_configured_pads_count() -> None:
    async def story(show: VirtualShow) -> PreflightReport:
        await show.standby()
        return show.service.preflight.report()

    settings: dict[str, Any] = {"grid_columns": 1}  # at 0, 5 and 10 m north
    good = fly(story, placed(d1=(0, 0), d2=(5, 0), d3=(10, 0)), **settings)
    assert failing(good) == {}
    assert not any("start pattern" in text for text in good.not_checked)
    shifted = fly(story, placed(d1=(0, 6), d2=(5, 6), d3=(10, 6)), **settings)
    assert set(failing(shifted)) == {"shift of the start pattern"}
    nowhere = fly(story, placed(d1=(0, 0), d3=(10, 0)), **settings)
    assert set(failing(nowhere)) == {"d2 place"}
    none = fly(story, show_config(3))
    assert any("start pattern" in text for text in none.not_checked)


@pytest.mark.soak
def test_on_the_ground_a_report_is_made_at_most_once_a_second(tmp_path: Path) -> None:
    async def story(show: VirtualShow) -> None:
        await show.standby()
        first = show.service.preflight.report()
        await show.wait(0.5)
        assert show.service.preflight.report() is first
        assert show.service.preflight.report(["d1"]) is not first, "another question"
        show_hash = select(show)
        assert show.service.preflight.report().show_hash == show_hash, "another show"
        second = show.service.preflight.report()
        await show.wait(1.1)
        assert show.service.preflight.report() is not second

    fly_show(story, config(tmp_path))


@pytest.mark.soak
def test_radius_refused_for_one_receiver_names_that_vehicle() -> None:
    async def story(show: VirtualShow) -> str:
        await show.standby()
        show.befall("d3", "accuracy", eph_m=0.6)
        await show.wait(1.0)
        return (await refused(show, lambda: show.service.commands.command_show(ShowAction.START))).text

    text = fly(story, show_config(4, positioning={"share": 1.0}), spacing_m=12.0, ideal=True)
    assert text.startswith("radius_m = 6.0: at least 6.9 m for 4 vehicles 10.7 m apart, because ")
    assert text.endswith(
        "2.8 m is enough at 0.05 m, as with RTK; the least certain is d3, with an RTK fixed fix of 0.6 m;"
        " choose a larger radius, better receivers, or fewer vehicles"
    )


def test_a_target_that_moved_out_of_reach_refuses_the_start() -> None:
    """It goes on after a landing: the next start would follow it to the fence."""

    async def story(show: VirtualShow) -> None:
        await show.standby()
        reach_m = show.config.control.safety.fence.distance_max_m - 30.0
        show.service.plan.set_target(Target(reach_m, 0.0, 3.0, 0.0))
        assert show.service.preflight.report().passes
        await show.wait(20.0)
        assert list(failing(show.service.preflight.report())) == ["target"]
        refusal = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        assert "the target has moved out of reach" in refusal.text
        show.service.plan.set_target(Target(0.0, 0.0))
        await show.wait(2.0)
        assert show.service.preflight.report().passes

    fly(story, show_config(2))


@pytest.mark.soak
def test_a_refused_start_names_the_cause_before_its_consequences() -> None:
    async def story(show: VirtualShow) -> str:
        await show.standby()
        show.befall("d2", "fix", type="2d")
        await show.wait(2.5)
        start = await refused(show, lambda: show.service.commands.command_show(ShowAction.START))
        return start.text

    text = fly(story, show_config(4))
    assert re.match(r"d2: its receiver's fix is 2D", text), text
    assert "d1: stands" in text
