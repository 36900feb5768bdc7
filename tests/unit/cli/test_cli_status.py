"""`gcs status`: one line for each vehicle at any width, and nothing that matters cut."""

import re
from dataclasses import replace
from datetime import datetime

import pytest
from rich.console import Console

from gcs.api.schemas import fleet as schemas
from gcs.cli.status import COLUMNS, SORTED, _columns, board, preflight_board, station_board
from gcs.model.lifecycle import ShowPhase
from gcs.model.preflight_report import Check, PreflightReport, State, VehicleChecks
from gcs.preflight.causes import causes_of
from gcs.service import BeginState, BeginView, SelectedShow
from gcs.service.features import Features, TimecodeView
from tests.support.api_fake_service import FakeService
from tests.support.status_example import NOT_ORDINARY, PILOT, example_fleet

HEAD = "vehicle phase mode height m speed m/s battery link age s"


@pytest.fixture(scope="module")
def fleet() -> schemas.Fleet:
    return example_fleet()


def lines(fleet: schemas.Fleet, width: int, **options: object) -> list[str]:
    console = Console(width=width, color_system=None)
    with console.capture() as shown:
        console.print(board(fleet, width, **options))  # type: ignore[arg-type]
    return [line.rstrip() for line in shown.get().splitlines()]


def table(fleet: schemas.Fleet, width: int, **options: object) -> list[str]:
    """The lines of the table: its head, and one for each vehicle."""
    shown = lines(fleet, width, **options)
    first = next(index for index, line in enumerate(shown) if line.split()[:2] == ["vehicle", "phase"])
    return shown[first : first + 1 + len(fleet.vehicles)]


@pytest.mark.parametrize("width", [60, 80, 100, 120, 200])
def test_each_vehicle_has_one_line_with_its_phase_and_mode_whole(fleet: schemas.Fleet, width: int) -> None:
    rows = table(fleet, width)[1:]
    for vehicle, row in zip(fleet.vehicles, rows, strict=True):
        assert row.split()[:3] == [vehicle.id, vehicle.phase, vehicle.mode.name.lower()]
    assert all(len(line) <= width for line in lines(fleet, width))


def test_eighty_columns_hold_all_values_with_reasons_below(fleet: schemas.Fleet) -> None:
    shown = "\n".join(lines(fleet, 80))
    assert table(fleet, 80)[0].split() == [
        "vehicle",
        "phase",
        "mode",
        "height",
        "m",
        "speed",
        "m/s",
        "battery",
        "link",
        "age",
        "s",
    ]
    assert "flies with the formation" not in shown
    assert "d7, d8: its own failsafe: no setpoint for 1.2 s" in shown
    assert re.sub(r"\s+", " ", shown).count(PILOT) == 1
    assert len(lines(fleet, 80)) <= 12 + len(fleet.vehicles) + 2 * len(NOT_ORDINARY)


def test_wide_status_puts_unusual_reasons_in_the_last_column(
    fleet: schemas.Fleet,
) -> None:
    rows = {row.split()[0]: row for row in table(fleet, 120)}
    assert rows["vehicle"].split()[-1] == "why"
    assert rows["d11"].endswith("separation from d12")
    assert {name for name, row in rows.items() if len(row.split()) > 8} - {"vehicle"} == set(NOT_ORDINARY) - {
        "d14"
    }


def test_a_long_name_takes_columns_away_and_not_lines(fleet: schemas.Fleet) -> None:
    long = example_fleet(name="a-vehicle-with-a-name-of-27-{}")
    head = table(long, 80)[0]
    assert "why" not in head
    assert all(name in head for name in ("phase", "mode", "battery"))


def test_columns_are_chosen_and_a_wrong_one_is_named(fleet: schemas.Fleet) -> None:
    shown = lines(fleet, 80, columns=("vehicle", "phase", "battery", "why"))
    (row,) = (line for line in shown if line.split()[:1] == ["d17"])
    assert row.split()[:3] == ["d17", "lost", "?"]
    assert "no telemetry for 4.2 s" in row
    assert _columns("vehicle,mode,vehicle") == ("vehicle", "mode")
    with pytest.raises(Exception, match="there is no column 'volts'; there are vehicle, station, phase"):
        _columns("vehicle,volts")


@pytest.mark.parametrize(
    ("by", "first"), [("battery", "d17"), ("age", "d17"), ("link", "d17"), ("vehicle", "d1")]
)
def test_vehicles_with_problems_are_listed_first(fleet: schemas.Fleet, by: str, first: str) -> None:
    rows = table(fleet, 80, sort=by)[1:]
    assert rows[0].split()[0] == first
    if by == "battery":
        assert rows[1].split()[0] == "d14"
    assert set(SORTED) <= set(COLUMNS)


def test_mixed_fleet_has_a_column_of_autopilots(fleet: schemas.Fleet) -> None:
    count = len(fleet.vehicles)
    assert any(f"; {count} px4" in line for line in lines(fleet, 120))
    assert "autopilot" not in table(fleet, 120)[0]
    vehicles = [
        each.model_copy(update={"autopilot": "ardupilot"}) if row == 1 else each
        for row, each in enumerate(fleet.vehicles)
    ]
    mixed = fleet.model_copy(update={"vehicles": vehicles})
    assert any(f"; 1 ardupilot, {count - 1} px4" in line for line in lines(mixed, 120))
    head, first, second = table(mixed, 120)[:3]
    assert head.split()[2] == "autopilot"
    assert [first.split()[2], second.split()[2]] == ["px4", "ardupilot"]
    assert table(mixed, 120, sort="autopilot")[1].split()[0] == "d2"


@pytest.fixture
def site(fleet: schemas.Fleet) -> schemas.Fleet:
    """Twenty vehicles of four stations, one of which is not received."""
    names = ("north", "south", "west", "east")
    service = FakeService(20, station_names=names)
    service.silent_s["west"] = 2.5
    service.lead = "south"
    service.tick()
    vehicles = [
        each.model_copy(update={"station": names[row // 5]}) for row, each in enumerate(fleet.vehicles)
    ]
    return fleet.model_copy(update={"stations": list(service.view.value.stations), "vehicles": vehicles})


@pytest.mark.parametrize("width", [60, 80, 120])
def test_site_status_names_the_station_of_each_vehicle(site: schemas.Fleet, width: int) -> None:
    shown = lines(site, width)
    first = next(index for index, line in enumerate(shown) if line.split()[:2] == ["vehicle", "station"])
    rows = [line.split() for line in shown[first + 1 : first + 21]]
    assert [row[1] for row in rows[::5]] == ["north", "south", "west", "east"]
    assert [row[2] == "!" for row in rows[::5]] == [False, False, True, False]
    assert all(len(line) <= width for line in shown)


def test_station_that_is_not_received_is_on_top(site: schemas.Fleet) -> None:
    shown = lines(site, 100)
    assert shown[0].startswith(" NOT RECEIVED: station west, silent for 2.5 s. Its vehicles (5)")
    text = "\n".join(shown)
    assert "north: idle, 5 vehicles (asked)" in text
    assert "south: idle, 5 vehicles, delay 2 ms (leads)" in text
    assert "west: NOT RECEIVED, silent for 2.5 s" in text


def test_silent_lead_is_shown_with_what_to_do(site: schemas.Fleet) -> None:
    stations = [replace(each, leads=each.name == "west") for each in site.stations]
    shown = lines(site.model_copy(update={"stations": stations}), 200)
    assert shown[0].endswith("It leads; gcs lead take has the station that is asked lead.")


def test_status_of_one_station_has_no_column_for_it(fleet: schemas.Fleet) -> None:
    assert "station" not in "\n".join(lines(fleet, 200))


def test_stations_are_a_table(site: schemas.Fleet) -> None:
    console = Console(width=100, color_system=None)
    with console.capture() as shown:
        console.print(station_board(site.stations))
        console.print(station_board([]))
    rows = [line.split() for line in shown.get().splitlines()]
    assert rows[1] == ["station", "leads", "received", "show", "vehicles", "delay"]
    assert rows[2] == ["north", "(asked)", "-", "idle", "5", "-"]
    assert rows[3] == ["south", "leads", "yes", "idle", "5", "2", "ms"]
    assert rows[4] == ["west", "NO,", "silent", "for", "2.5", "s", "idle", "5", "4", "ms"]
    assert rows[6] == ["one", "station", "flies", "all", "vehicles"]


def test_status_has_the_timecode_and_how_the_show_stands(fleet: schemas.Fleet) -> None:
    timecode = TimecodeView(
        source="udp-midi://127.0.0.1:5006",
        followed=True,
        state="stopped",
        label="01:00:02:12",
        frame_rate="25",
        age_s=3.0,
        behind_s=-1.2,
        slope=None,
        tempo=0.0,
        problem="the timecode has stopped",
        readings=80,
        garbage=0,
        dropped=0,
    )
    shown = "\n".join(lines(fleet.model_copy(update={"features": Features(timecode=timecode)}), 160))
    where = "01:00:02:12 25 stopped, udp-midi://127.0.0.1:5006"
    assert f"{where}, show -1200 ms behind, tempo 0.000, the timecode has stopped" in shown
    since_s = fleet.unix_time_s - 12.0
    frozen = replace(timecode, frozen_since_unix_time_s=since_s)
    shown = "\n".join(lines(fleet.model_copy(update={"features": Features(timecode=frozen)}), 160))
    assert f"{where}, SHOW FROZEN for 12 s, show" in shown
    let_go = replace(timecode, followed=False)
    assert "shows run by this station's clock" in "\n".join(
        lines(fleet.model_copy(update={"features": Features(timecode=let_go)}), 160)
    )


def test_status_says_when_a_waiting_show_begins(fleet: schemas.Fleet) -> None:
    at_s = 1.8e9
    selected = SelectedShow("tour", "ab", "stand", ("stand",), 0.0, 60.0, runs=False, target_is_live=False)

    def shown(begin: BeginView) -> str:
        show = fleet.show.model_copy(update={"selected": replace(selected, begin=begin)})
        return "\n".join(lines(fleet.model_copy(update={"show": show}), 160))

    local = f"{datetime.fromtimestamp(at_s).astimezone():%H:%M:%S %Z}"
    waiting = shown(BeginView(BeginState.WAITING, at_s, 12.34))
    assert f"waiting: begins at {local}, in 12.3 s" in waiting
    assert "held: no time to begin is given" in shown(BeginView(BeginState.HELD, None, None))


def preflight_text(found: PreflightReport) -> str:
    console = Console(width=160)
    with console.capture() as shown:
        console.print(preflight_board(found, everything=False))
    return shown.get()


def test_preflight_names_the_command_that_mends_a_cause() -> None:
    battery = Check("battery", State.FAIL, 0.1, "of 1", "at least 25%", "battery at 10%", "charge it")
    failed = {name: [battery] if name in {"d2", "d4"} else [] for name in ("d1", "d2", "d3", "d4")}
    causes = causes_of(failed, lambda _out: [], lambda _check, _out: None, 40)
    vehicles = tuple(VehicleChecks(name, True, "", tuple(checks), "px4") for name, checks in failed.items())
    shown = preflight_text(PreflightReport(0.0, None, None, (), vehicles, (), causes))
    assert "not ready to start: 4 of 4 vehicles, 0 of 2 checks pass" in shown
    assert "1. d2, d4: battery at 10%\n  charge it\n" in shown
    assert "Leave d2, d4 out: ready  (for v in d2 d4; do gcs exclude $v; done)" in shown


def test_status_on_the_ground_says_what_keeps_it_there(fleet: schemas.Fleet) -> None:
    counts = replace(fleet.counts, controlled=0, uncontrolled=0)

    def shown(**show: object) -> str:
        seen = fleet.show.model_copy(update={"phase": ShowPhase.IDLE, "possible": [], **show})
        update = {"counts": counts, "show": seen, "control_alive": True}
        return "\n".join(lines(fleet.model_copy(update=update), 100))

    refused = shown(start_refused="checklist pads: 2 of 2 items are open (+1)")
    assert "not ready: checklist pads: 2 of 2 items are open (+1); see gcs preflight" in refused
    assert "possible   -; no start: not ready" in refused
    assert "ready to start" not in refused
    good = shown(start_refused="", possible=["start"])
    assert "ready to start" in good
    assert "possible   start" in good
    assert "no start" not in good
    flying = "\n".join(lines(fleet, 100))
    assert "ready to start" not in flying
    assert "no start" not in flying


def test_preflight_in_flight_says_that_it_flies() -> None:
    passed = VehicleChecks("d1", True, "", (Check("battery", State.PASS, 0.9),), "px4")
    report = PreflightReport(
        0.0, None, None, (), (passed,), (), (), "the show is running, 1 of 1 vehicles fly"
    )
    assert not report.passes
    shown = preflight_text(report)
    assert shown.startswith(
        "in flight: the show is running, 1 of 1 vehicles fly: before take-off 1 of 1 vehicles"
    )
    assert "ready to start" not in shown
