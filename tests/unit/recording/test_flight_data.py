"""Flight data: what was recorded is read back, by us and by the mcap library, whatever ended the file."""

import json
import os
import random
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from gcs.model.errors import GcsError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle
from gcs.model.state import Mode
from gcs.model.vehicle_columns import unknown
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_reader import FlightData
from gcs.recording.mcap_writer import WAITING_MAX, FlightFile, LogLine
from gcs.recording.sample import RecordedElsewhere, Sample
from gcs.recording.session import Record
from gcs.recording.trajectories import estimated
from tests.support.machine import soon
from tests.support.record_samples import PLAN, changed, sample

ABOUT = layout.about("s1", '{"tick_rate_hz": 20.0}', {"d1": (1, "radio"), "d2": (2, "radio")})


def flight(folder: Path, samples: list[Sample], about: dict[str, str] = ABOUT) -> Path:
    file = FlightFile(folder, about)
    file.open()
    for each in samples:
        file.add(each)
    file.close()
    assert not file.problem
    return folder / "flight.mcap"


def moving(count: int) -> list[Sample]:
    return [
        sample(
            time_s=100.0 + tick / 20,
            position_m=np.array([[0.05 * tick, 0.0, -20.0], [10.0, 0.1 * tick, -20.0]]),
            velocity_m_s=np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]),
            phases=[Phase.FORMATION, Phase.LANDING if tick > 50 else Phase.FORMATION],
            reasons=["flies", "comes down" if tick > 50 else "flies"],
        )
        for tick in range(count)
    ]


def with_others(made: Sample, elsewhere: RecordedElsewhere) -> Sample:
    return replace(made, elsewhere=elsewhere)


def others_at(x_m: float, shown: list[int] | None = None) -> RecordedElsewhere:
    """Two vehicles of another station, at 2 m/s."""
    rows = layout.packed_state(
        np.array([[x_m, 5.0, -20.0], [x_m, 9.0, -20.0]]),
        np.tile([2.0, 0.0, 0.0], (2, 1)),
        np.tile([2.0, 0.0, 0.0], (2, 1)),
        {**unknown(2), "position_age_s": np.full(2, 0.1)},
        {},
    )
    one_each = None if shown is None else np.array(shown)
    return RecordedElsewhere(("e1", "e2"), rows, ("flown by station east",) * 2, one_each, ShowPhase.RUNNING)


def test_vehicles_elsewhere_are_read_at_each_tick(tmp_path: Path) -> None:
    """They are recorded less often than ticks."""
    recorded = [others_at(50.0 + 0.4 * number) for number in range(5)]
    flown = [with_others(made, recorded[tick // 4]) for tick, made in enumerate(moving(20))]
    vehicles = dict.fromkeys(("d1", "d2", "e1", "e2"), (1, "radio"))
    path = flight(tmp_path, flown, layout.about("s1", "{}", vehicles, elsewhere=2))
    ticks = list(FlightData(path).ticks())
    x_m = np.array([tick.vehicles["x"] for tick in ticks])
    assert x_m[:, 0] == pytest.approx(0.05 * np.arange(20), abs=1e-4)
    assert x_m[:, 2] == pytest.approx(50.0 + 0.1 * np.arange(20), abs=1e-4)
    assert ticks[3].vehicles["position_age_s"][2] == pytest.approx(0.25, abs=1e-3)
    assert ticks[0].status.reasons == ["flies", "flies", *["flown by station east"] * 2]
    with path.open("rb") as file:
        assert len(list(make_reader(file).iter_messages(topics=["/fleet/elsewhere"]))) == 5


def test_vehicle_that_a_standby_receives_is_recorded_once(tmp_path: Path) -> None:
    """Of d2 the row is that of the station that flies it."""
    flown = [with_others(made, others_at(50.0, [0, 3, 2])) for made in moving(2)]
    vehicles = dict.fromkeys(("d1", "d2", "e1"), (1, "radio"))
    path = flight(tmp_path, flown, layout.about("s1", "{}", vehicles, elsewhere=1))
    for tick in FlightData(path).ticks():
        assert tick.vehicles["y"].tolist() == pytest.approx([0.0, 9.0, 5.0])


def test_each_autopilot_is_named_in_the_record_and_its_report(tmp_path: Path) -> None:
    vehicles, kinds = {"d1": (1, "radio"), "d2": (2, "radio")}, {"d1": "px4", "d2": "ardupilot"}
    data = FlightData(flight(tmp_path, moving(3), layout.about("s1", "{}", vehicles, kinds)))
    assert data.about.autopilots == estimated(data).autopilots == ("px4", "ardupilot")


def test_record_without_autopilots_is_of_the_usual_one(tmp_path: Path) -> None:
    assert FlightData(flight(tmp_path, moving(3))).about.autopilots == ("px4", "px4")


def test_every_tick_is_read_back_unchanged(tmp_path: Path) -> None:
    data = FlightData(flight(tmp_path, samples := moving(100)))
    assert (data.about.ids, data.about.system_ids) == (("d1", "d2"), (1, 2))
    assert data.about.config == {"tick_rate_hz": 20.0}
    ticks = list(data.ticks())
    assert not data.cut
    assert len(ticks) == len(samples)
    for tick, was in zip(ticks, samples, strict=True):
        assert tick.unix_s == pytest.approx(was.view.unix_time_s, abs=2e-6)
        np.testing.assert_allclose(
            layout.vectors(tick.vehicles, layout.POSITION), was.view.rows.position_m, atol=1e-5
        )
        np.testing.assert_allclose(layout.vectors(tick.vehicles, layout.VELOCITY), was.view.rows.velocity_m_s)
        np.testing.assert_allclose(layout.vectors(tick.vehicles, layout.SETPOINT)[0], [1.0, 0.0, -0.5])
        assert np.isnan(layout.vectors(tick.vehicles, layout.SETPOINT)[1]).all()
        assert [data.about.phases[number] for number in tick.vehicles["phase"]] == list(was.view.rows.phases)
        assert [data.about.modes[number] for number in tick.vehicles["mode"]] == [Mode.OFFBOARD] * 2
        assert tick.status.reasons == list(was.view.rows.reasons)
        assert tick.status.plan.formation == was.view.plan.formation
        assert tick.tick.limited_by == {"d2": "separation from d1"}
        assert tick.tick.time_s == was.view.time_s


def test_mcap_library_reads_the_schemas_that_foxglove_draws(tmp_path: Path) -> None:
    box = Obstacle("tower", 5.0, 6.0, 1.0, 2.0, 30.0)
    whole = [changed(each, plan=replace(PLAN, obstacles=(box,))) for each in moving(60)]
    path = flight(tmp_path, whole)
    seen: dict[str, list[dict[str, object]]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.channel_message_counts[1] == 60
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            reported = json.loads(message.data)
            declared = json.loads(schema.data)["properties"]
            assert set(reported) <= set(declared), channel.topic
            seen.setdefault(f"{channel.topic} {schema.name}", []).append(reported)
    assert {"/fleet/vehicles foxglove.PointCloud", "/fleet/tick gcs.Tick", "/fleet/status gcs.Status"} <= set(
        seen
    )
    assert {"/fleet/scene foxglove.SceneUpdate", "/tf foxglove.FrameTransform"} <= set(seen)
    cloud = seen["/fleet/vehicles foxglove.PointCloud"][0]
    assert cloud["point_stride"] == layout.VEHICLE.itemsize
    assert cloud["frame_id"] == seen["/tf foxglove.FrameTransform"][0]["child_frame_id"]
    scene = seen["/fleet/scene foxglove.SceneUpdate"][0]
    assert [each["id"] for each in scene["entities"]] == [  # type: ignore[attr-defined]
        "target",
        "formation",
        "obstacle tower",
        "names",
    ]


def test_events_are_in_the_log_of_the_file(tmp_path: Path) -> None:
    file = FlightFile(tmp_path, ABOUT)
    file.open()
    file.add(sample())
    file.add(LogLine(1.7e9, "warning", "vehicle_phase", "d1 was=hold phase=lost"))
    file.close()
    with (tmp_path / "flight.mcap").open("rb") as found:
        (logged,) = [json.loads(m.data) for _, _, m in make_reader(found).iter_messages(topics=["/log"])]
    assert (logged["level"], logged["message"]) == (3, "vehicle_phase d1 was=hold phase=lost")


def test_unknown_value_is_null(tmp_path: Path) -> None:
    unknown = sample(position_m=np.full((2, 3), np.nan))
    (tick,) = FlightData(flight(tmp_path, [changed(unknown, minimum_separation_m=None)])).ticks()
    assert np.isnan(layout.vectors(tick.vehicles, layout.POSITION)).all()
    assert tick.tick.minimum_separation_m is None


def test_file_truncated_anywhere_is_read_up_to_its_cut(tmp_path: Path) -> None:
    file = FlightFile(tmp_path, ABOUT)
    file.open()
    for count, each in enumerate(moving(60)):
        file.add(each)
        if count % 20 == 19:
            soon(lambda count=count: file.written > count)  # type: ignore[misc]
            time.sleep(1.0)  # a chunk is closed
    file.close()
    whole = (tmp_path / "flight.mcap").read_bytes()
    count = len(list(FlightData(tmp_path / "flight.mcap").ticks()))
    counts, places = set(), random.Random(3)
    for _ in range(40):
        (tmp_path / "cut.mcap").write_bytes(whole[: places.randrange(2500, len(whole) - 20)])
        data = FlightData(tmp_path / "cut.mcap")
        found = len(list(data.ticks()))
        assert "cut off or damaged" in data.cut
        assert found <= count
        counts.add(found)
    assert len(counts) >= 3, "chunk after chunk is there"


def test_damaged_chunk_is_rejected(tmp_path: Path) -> None:
    whole = bytearray(flight(tmp_path, moving(60)).read_bytes())
    whole[len(whole) // 8] ^= 0xFF  # behind it are schemas and index
    (tmp_path / "flight.mcap").write_bytes(whole)
    data = FlightData(tmp_path / "flight.mcap")
    assert list(data.ticks()) == []
    assert "are damaged and were skipped" in data.cut
    assert "lost: from the beginning to the end" in data.cut


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0", b"no mcap at all" * 100, os.urandom(5000)])
def test_a_foreign_file_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "other.mcap").write_bytes(content)
    with pytest.raises(GcsError, match=r"other\.mcap: not flight data of this program"):
        FlightData(tmp_path / "other.mcap")
    with pytest.raises(GcsError, match=r"absent\.mcap: cannot be read: No such file"):
        FlightData(tmp_path / "absent.mcap")


def test_mcap_of_another_program_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema_id = writer.register_schema("birds", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/birds", "json", schema_id), 1, b"{}", 1)
        writer.finish()
    with pytest.raises(GcsError, match="an MCAP file, but not flight data of this program"):
        FlightData(tmp_path / "other.mcap")


def test_fields_of_points_are_found_by_their_names() -> None:
    """As in a file of version 4, or of a program that records fewer numbers."""
    rows = layout.packed(sample(battery_remaining=np.array([0.5, 0.25])).view.rows)
    cloud = json.loads(layout.vehicles_message(1.0, rows))
    cloud["fields"] = [field for field in reversed(cloud["fields"]) if field["name"] != "battery_remaining"]
    read = layout.rows_of(json.dumps(cloud).encode())
    assert np.isnan(read["battery_remaining"]).all()
    rest = [name for name in layout.VEHICLE.names or () if name != "battery_remaining"]
    for name in rest:
        np.testing.assert_array_equal(read[name], rows[name])
    cloud["fields"] = [field for field in cloud["fields"] if field["name"] != "phase"]
    with pytest.raises(ValueError, match="phase"):
        layout.rows_of(json.dumps(cloud).encode())


def test_another_version_is_refused(tmp_path: Path) -> None:
    file = FlightFile(tmp_path, {**ABOUT, "version": "9"})
    file.open()
    file.add(sample())
    file.close()
    with pytest.raises(
        GcsError,
        match=r"flight\.mcap: not flight data of this program: they are of version 9; .* versions 4 and 5",
    ):
        FlightData(tmp_path / "flight.mcap")


def test_failing_disk_is_reported_and_a_new_file_follows(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "s1"
    folder.touch()  # a file where the folder should be
    file = FlightFile(folder, ABOUT)
    file.open()
    file.add(sample())
    soon(lambda: "flight data are not recorded" in file.problem)
    assert file.dropped == 1
    folder.unlink()
    file.add(sample(time_s=101.0))
    soon(lambda: "1 ticks of flight data were not recorded" in file.problem)
    assert file.written == 1
    file.close()
    assert len(list(FlightData(folder / "flight.mcap").ticks())) == 1
    assert [line.msg for line in caplog.records] == ["recording_failed", "recording_resumed"]


def test_frames_beyond_the_disk_rate_are_counted_and_dropped(tmp_path: Path) -> None:
    file = FlightFile(tmp_path, ABOUT)  # not opened: a disk that hangs
    for _ in range(WAITING_MAX + 100):
        file.add(sample())
    assert file.dropped == 100
    assert "100 ticks of flight data were not recorded" in file.problem


def test_producer_faster_than_the_writer_is_delayed(tmp_path: Path) -> None:
    record = Record(tmp_path, "{}", {"d1": (1, "radio"), "d2": (2, "radio")})  # not entered
    for _ in range(WAITING_MAX // 2):
        assert record.has_room
        record.note(sample(), [])
    assert not record.has_room
    with record:
        soon(lambda: record.has_room)
        assert record.problems == ()
