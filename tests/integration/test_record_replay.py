"""`gcs replay`: the API over a recorded flight, as if live, but nothing can be ordered."""

import asyncio
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.client import connect

from gcs.api.schemas import binary_frame as frames
from gcs.cli.main import main
from gcs.cli.remote import document
from gcs.client import Client
from gcs.config import schema as configuration
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.lifecycle import Phase
from gcs.model.plan import Formation, Obstacle, Plan
from gcs.model.state import Mode
from gcs.recording import mcap_layout as layout
from gcs.recording.audit import AuditTrail
from gcs.recording.audit_database import Journal
from gcs.recording.audit_reader import AUDIT, PAD
from gcs.recording.mcap_writer import FlightFile
from gcs.recording.sample import Sample
from gcs.service import SelectedShow, TickView
from gcs.service.alarms import Alarm, AlarmCause, AlarmSeverity
from tests.support import record_samples
from tests.support.replays import replay

SECONDS, SPEED = 20.0, 10.0
BOX = Obstacle("tower", 5.0, 0.0, 1.0, 1.0, 30.0, velocity_x_m_s=1.0, time_s=500.0)

LOST = Alarm(
    "vehicle-lost-1",
    AlarmSeverity.WARNING,
    AlarmCause.VEHICLE_LOST,
    "Vehicle d2 lost: no telemetry for 2.0 s. Formation closes the gap.",
    "Watch where it flies.",
    ("d2",),
    1.7e9,
    1.7e9,
    "o3",
    "anna",
    1.7e9 + 1.0,
)


def sample(at_s: float) -> Sample:
    made = record_samples.sample(
        time_s=500.0 + at_s,
        position_m=np.array([[at_s, 0.0, -20.0], [0.0, 10.0, -20.0]]),
        phases=(Phase.FORMATION, Phase.LOST),
        reasons=("flies", "silent for 2.1 s in the air"),
        modes=(Mode.OFFBOARD, Mode.HOLD),
        plan=Plan(Formation(10.0, 20.0), obstacles=(BOX,)),
        selected=SelectedShow("small", "ab" * 32, "walk", ("stand", "walk"), at_s, 42.0, True, False),
    )
    return record_samples.changed(
        made,
        unix_time_s=1.7e9 + at_s,
        battery_remaining=np.array([0.8, np.nan]),
        ready=(True, False),
        limited_by=["limits", ""],
        start_unix_time_s=1.7e9 + 60.0,
        minimum_separation_m=9.0,
        tick=TickView(20.0, round(at_s * 20), 0, 1.0, 2.0, 3.0),
        alarms=(LOST,),
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("record") / "s1"
    config = configuration.load(configuration.find("demo"))
    file = FlightFile(folder, layout.about("s1", config.model_dump_json(), {"d1": (1, "a"), "d2": (2, "a")}))
    for tick in range(round(SECONDS * 20)):
        file.add(sample(tick / 20))
    file.open()
    file.close()
    journal = Journal(folder.parent / AUDIT)
    audit = AuditTrail(journal, "s1", {"d1": (1, "a"), "d2": (2, "a")})
    journal.open()
    audit.begin(folder, config.model_dump_json())
    audit.event(1.7e9 + 2.0, "info", PAD, "d1", {"pad_m": [1.0, 2.0, -3.0]})
    audit.event(1.7e9 + 5.0, "info", "vehicle_phase", "d1", {"phase": "takeoff", "reason": "all agree"})
    audit.event(1.7e9 + 15.0, "warning", "vehicle_phase", "d2", {"phase": "lost", "reason": "silent"})
    journal.close()
    return folder


async def watched(address: str, count: int) -> list[dict[str, Any]]:
    async with connect(f"{address.replace('http', 'ws')}/api/v1/stream?rate_hz=20") as stream:
        return [json.loads(await stream.recv()) for _ in range(count)]


def test_stream_replays_in_recorded_time_and_refuses_commands(recorded: Path) -> None:
    with replay(recorded, "--speed", f"{SPEED:g}") as address, Client(address, timeout_s=30.0) as client:
        fleet = client.fleet()
        texts = [alarm.text for alarm in fleet.alarms]
        assert texts == [
            "Vehicle d2 lost: no telemetry for 2.0 s. Formation closes the gap.",
            f"Replay: this is a record of {recorded / 'flight.mcap'}. Nothing here flies.",
        ]
        assert fleet.severity == "warning"
        d1, d2 = fleet.vehicles
        assert (d1.phase, d1.mode, d1.limited_by, d2.phase) == ("formation", "offboard", "limits", "lost")
        assert d1.battery == pytest.approx(0.8)
        assert d2.battery is None
        assert d1.setpoint_x_m_s is not None
        assert d2.setpoint_x_m_s is None
        assert d1.latitude_deg == pytest.approx(47.3977, abs=0.01)
        assert fleet.show.selected is not None
        assert (fleet.show.selected.name, fleet.show.selected.cue) == ("small", "walk")
        assert fleet.show.start_unix_time_s == pytest.approx(1.7e9 + 60.0)
        assert client.shows.stored() == []
        with pytest.raises(RefusedError, match=r"this is a replay of .*: it keeps no shows"):
            client.shows.upload("small", "about: nothing")
        seek = partial(client.shows.seek, "stand")
        for command in (client.stop, client.start, lambda: client.change_orbit(radius_m=5.0), seek):
            with pytest.raises(
                RefusedError, match=r"this is a replay of .*: nothing can be commanded or changed"
            ):
                command()
        seen = asyncio.run(watched(address, 10))
        passed_s = float(str(seen[-1]["unix_time_s"])) - float(str(seen[0]["unix_time_s"]))
        live_s = float(str(seen[-1]["time_s"])) - float(str(seen[0]["time_s"]))
        assert 0.5 * SPEED < passed_s / live_s < 1.5 * SPEED or "has ended" in str(seen[-1]["alarms"])
        for state in seen:  # what moves is where it was then
            (box,) = state["obstacles"]
            flown_s = float(str(state["unix_time_s"])) - 1.7e9
            assert box["x_m"] == pytest.approx(5.0 + flown_s, abs=0.1)


async def headers(address: str, count: int) -> list[Any]:
    """Of so many frames of the console's stream."""
    seen: list[Any] = []
    async with connect(f"{address.replace('http', 'ws')}/api/v1/stream/console?rate_hz=20") as stream:
        while len(seen) < count:
            message = await stream.recv()
            if isinstance(message, bytes):
                seen.append(np.frombuffer(message, frames.HEADER, 1)[0])
    return seen


def positions_s(address: str, count: int) -> list[float]:
    return [float(each["unix_time_s"]) - 1.7e9 for each in asyncio.run(headers(address, count))]


def test_replay_pauses_seeks_and_reports_past_events(recorded: Path) -> None:
    with replay(recorded) as address, Client(address, timeout_s=30.0) as client:
        reported = client.playback.change(paused=True, position_s=12.5)
        assert (reported.paused, reported.position_s, reported.ended) == (True, 12.5, False)
        assert reported.duration_s == pytest.approx(SECONDS - 0.05)
        assert positions_s(address, 5)[-1] == pytest.approx(12.5, abs=0.06)
        assert asyncio.run(headers(address, 1))[0]["control_alive"]
        status = client.status()
        assert [(each.text, each.vehicle) for each in status.events] == [("takeoff: all agree", "d1")]
        home = status.vehicles[0].home
        assert home is not None
        assert (home.x_m, home.y_m, home.height_m) == (1.0, 2.0, 3.0)
        assert status.replay is not None
        assert status.replay.began_unix_time_s == pytest.approx(1.7e9)
        client.playback.change(position_s=1.0)  # backwards
        assert positions_s(address, 3)[-1] == pytest.approx(1.0, abs=0.06)
        assert client.status().vehicles[0].home is None
        assert client.status().events == []
        client.playback.change(paused=False, speed=2.0)
        moving = positions_s(address, 5)
        assert 1.0 <= moving[0] < moving[-1]
        with pytest.raises(InvalidError, match="position_s"):
            client.playback.change(position_s=SECONDS + 1.0)
        with pytest.raises(InvalidError, match="speed"):
            client.playback.change(speed=1000.0)
        client.playback.change(position_s=SECONDS - 0.5)
        while not client.playback.now().ended:
            pass
        with pytest.raises(RefusedError, match="the record has ended"):
            client.playback.change(paused=False)
        assert asyncio.run(headers(address, 1))[0]["control_alive"]  # nothing that could have stopped
        now = client.status()
        assert (now.control_reason, [each.cause for each in now.alarms]) == ("", ["vehicle-lost", "replay"])
        assert client.playback.change(position_s=3.0, paused=True).ended is False
        assert positions_s(address, 3)[-1] == pytest.approx(3.0, abs=0.06)


def test_flight_report_is_made_beside_the_replay(recorded: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(recorded), "--json"]) in {0, 1}
    judged = json.loads(capsys.readouterr().out)
    with replay(recorded) as address, Client(address, timeout_s=30.0) as client:
        found = client.playback.report()
        while found.state == "running":
            time.sleep(0.5)
            assert positions_s(address, 1)  # meanwhile it plays on
            found = client.playback.report()
        assert found.reason == ""
        assert found.report is not None
        assert document(found.report) == judged


def test_file_that_is_no_flight_record_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "other.mcap").write_bytes(b"no mcap")
    assert main(["replay", str(tmp_path / "other.mcap")]) == 2
    assert "other.mcap: not flight data of this program" in capsys.readouterr().err
    assert main(["replay", str(tmp_path / "other.mcap"), "--speed", "0"]) == 2
    assert "--speed 0: above 0" in capsys.readouterr().err
    file = FlightFile(tmp_path, layout.about("s1", '{"show_frame": {}}', {}))
    file.open()
    file.add(sample(0.0))
    file.close()
    assert main(["replay", str(tmp_path)]) == 2
    assert "its configuration has no show frame" in capsys.readouterr().err
