"""A whole show is recorded: commands and their callers, phases and paths of every vehicle."""

import json
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.main import main
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.recording import mcap_layout as layout
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from gcs.recording.session import Record
from gcs.service import ShowAction, VehicleAction
from gcs.testing.views import vehicles_of
from gcs.testing.virtual_show import FlownTrack, VirtualShow, fly, show_config
from tests.support.audit_rows import commands, events

pytestmark = pytest.mark.soak

CONFIG = show_config(4)


async def a_show(show: VirtualShow) -> FlownTrack:
    await show.start()
    await show.wait(5.0)
    await show.command("d2", VehicleAction.HOLD)
    await show.command("d2", VehicleAction.JOIN)
    await show.show(ShowAction.STOP)
    await show.reach(ShowPhase.LANDED)
    return show.track


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FlownTrack]:
    root = tmp_path_factory.mktemp("runs")
    vehicles = {name: (row + 1, "loop") for row, name in enumerate(CONFIG.ids)}
    with Record(root, CONFIG.model_dump_json(), vehicles) as record:
        track = fly(a_show, CONFIG, record=record)
        assert record.problems == ()
    return root, track


def test_every_command_is_recorded_with_vehicle_outcomes(flown: tuple[Path, FlownTrack]) -> None:
    done = dict.fromkeys(CONFIG.ids, ("done", ""))
    assert [(command.action, command.caller, dict(command.outcomes)) for command in commands(flown[0])] == [
        ("start", "service", done),
        ("hold", "service", {"d2": ("done", "")}),
        ("join", "service", {"d2": ("done", "")}),
        ("stop", "service", done),
    ]


def test_every_change_of_phase_is_an_event(flown: tuple[Path, FlownTrack]) -> None:
    root, track = flown
    reported = events(root)
    phases = [
        e["detail"]["phase"] for e in reported if e["event"] == "vehicle_phase" and e["vehicle"] == "d2"
    ]
    # those that were over within a tick too: the flight shows fewer
    assert phases == [
        "standby",
        "takeoff",
        "hold",
        "formation",
        "hold",
        "formation",
        "return",
        "landing",
        "standby",
    ]
    assert set(track.phases("d2")) <= {Phase(name) for name in phases} | {Phase.OFFLINE}
    shows = [event["detail"]["phase"] for event in reported if event["event"] == "show_phase"]
    assert shows == ["preflight", "arming", "assembling", "running", "returning", "landed"]
    modes = [e["detail"]["mode"] for e in reported if e["event"] == "vehicle_mode" and e["vehicle"] == "d1"]
    assert "takeoff" in modes
    assert "offboard" in modes


def test_the_last_known_is_what_the_show_ended_with(flown: tuple[Path, FlownTrack]) -> None:
    known = last_known(flown[0])
    assert known.show is not None
    assert known.show.phase == "landed"
    assert {vehicle.phase for vehicle in known.vehicles.values()} == {"standby"}
    assert (known.vehicles["d1"].host, known.vehicles["d1"].port) == ("10.0.0.1", 14580)
    for name, vehicle in known.vehicles.items():
        assert vehicle.home_m is not None
        row = CONFIG.ids.index(name)
        assert np.linalg.norm(np.subtract(vehicle.home_m, flown[1].true_m[0, row])) < 1.5


def test_every_tick_is_recorded_with_its_estimates(flown: tuple[Path, FlownTrack]) -> None:
    root, track = flown
    session = last_known(root).session
    assert session is not None
    ticks = list(FlightData(session.folder / "flight.mcap").ticks())
    seen = {sample.time_s: sample.view for sample in track.samples}
    shared = [tick for tick in ticks if tick.tick.time_s in seen]
    assert len(shared) > 0.95 * len(track.samples)
    for tick in shared[:: len(shared) // 50]:
        view = seen[tick.tick.time_s]
        for row, vehicle in enumerate(vehicles_of(view)):
            if vehicle.position_m is not None:
                np.testing.assert_allclose(
                    layout.vectors(tick.vehicles, layout.POSITION)[row], vehicle.position_m, atol=1e-4
                )
            assert tick.vehicles["armed"][row] == vehicle.armed
            assert np.isfinite(tick.vehicles["setpoint_x_m_s"][row]) == (vehicle.setpoint_m_s is not None)


def test_the_record_proves_the_flight(flown: tuple[Path, FlownTrack], tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    assert (
        main(["report", str(flown[0]), "--report", str(report), "--html", str(tmp_path / "page.html")]) == 0
    )
    judged = json.loads(report.read_text())
    assert (judged["verdict"], judged["flew"], judged["based_on"]) == ("kept", 4, "estimated positions")
    assert judged["duration_s"] > 30.0
    least_m = min(sample.view.minimum_separation_m or np.inf for sample in flown[1].samples)
    assert judged["nearest_pairs"][0]["distance_m"] == pytest.approx(least_m, abs=0.3)
    assert (tmp_path / "page.html").stat().st_size > 20_000
