"""Records cut or damaged anywhere: never "kept" where anything was lost, and what was lost is named."""

import json
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode

from gcs.cli.main import main
from gcs.config import schema as configuration
from gcs.control import ControlSettings
from gcs.model.lifecycle import Phase
from gcs.model.state import Landed, Mode
from gcs.recording import mcap_layout as layout
from gcs.recording import mcap_writer as flightfile
from gcs.recording.mcap_reader import FlightData
from gcs.recording.mcap_writer import _OpenFile
from gcs.recording.sample import Sample
from gcs.safety.walls import Fence
from tests.support.record_samples import changed, ids_of, sample

TICKS, EACH = 240, 20
CONFIG = configuration.load(configuration.find("demo"))
ABOUT = layout.about("s1", CONFIG.model_dump_json(), dict.fromkeys(ids_of(2), (1, "a")))
SPAN_M = 0.02
"""A tick moves them by that much, outwards: the last is farthest."""


def flying(tick: int, **changes: Any) -> Sample:
    made = sample(
        time_s=100.0 + tick / 20,
        position_m=np.array([[SPAN_M * tick, 0.0, -20.0], [10.0, 0.0, -20.0]]),
        phases=[Phase.FORMATION, Phase.FORMATION],
        control=CONFIG.control,
    )
    return replace(made, number=tick + 1, **changes)


def standing(tick: int) -> Sample:
    made = sample(
        time_s=100.0 + tick / 20,
        position_m=np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]),
        phases=[Phase.STANDBY, Phase.STANDBY],
        modes=[Mode.HOLD, Mode.HOLD],
        armed=(False, False),
    )
    made = changed(made, landed=[Landed.ON_GROUND] * 2)
    return replace(made, number=tick + 1, control=CONFIG.control)


def written(folder: Path, samples: list[Sample]) -> Path:
    """In chunks of `EACH` ticks."""
    folder.mkdir(exist_ok=True)
    made = _OpenFile(folder / "flight.mcap", ABOUT)
    for number, each in enumerate(samples, start=1):
        made.add(each)
        if number % EACH == 0:
            made.flush()
    made.finish()
    return made.path


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Twelve seconds in twelve chunks."""
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    return written(tmp_path, [flying(tick) for tick in range(TICKS)])


def judged(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any], str]:
    """The exit code, the report (empty without one) and the complaint."""
    capsys.readouterr()
    code = main(["report", str(path), "--json"])
    printed = capsys.readouterr()
    return code, json.loads(printed.out) if printed.out else {}, printed.err


def test_intact_record_is_kept(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, report, _ = judged(file, capsys)
    assert (code, report["verdict"], report["missing"], report["flew"]) == (0, "kept", [], 2)


def test_record_cut_anywhere_is_never_kept_and_names_the_place(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, places = file.read_bytes(), random.Random(1)
    for cut in [9000, *(places.randrange(len(whole)) for _ in range(24)), len(whole) - 1]:
        file.write_bytes(whole[:cut])
        code, report, complaint = judged(file, capsys)
        assert code in {2, 3}, cut
        if code == 3:
            assert report["verdict"] == "incomplete"
            assert any("cut off or damaged from byte" in text for text in report["missing"])
        else:
            assert "flight.mcap" in complaint


@pytest.mark.soak
def test_flipped_byte_with_loss_is_never_kept(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, places = file.read_bytes(), random.Random(2)
    every = [tick.vehicles.tobytes() for tick in FlightData(file).ticks()]
    codes = []
    for _ in range(80):
        data = bytearray(whole)
        at = places.randrange(len(data))
        data[at] ^= places.randrange(1, 256)
        file.write_bytes(data)
        code, report, complaint = judged(file, capsys)
        codes.append(code)
        if code == 0:  # of what MCAP has for searching nothing is needed
            assert [tick.vehicles.tobytes() for tick in FlightData(file).ticks()] == every, at
        elif code == 3:
            assert report["missing"], at
        else:
            assert (code, bool(complaint)) == (2, True), at
    assert codes.count(3) > 20


@pytest.mark.parametrize("kind", [kind for kind in range(20) if kind != Opcode.CHUNK])
def test_a_chunk_that_seems_another_record_is_damage(file: Path, kind: int) -> None:
    data, (_, at) = bytearray(file.read_bytes()), FlightData(file).chunks[5]
    data[at] = kind
    file.write_bytes(data)
    recorded = FlightData(file)
    assert len(list(recorded.ticks())) == TICKS - EACH
    assert f"bytes {at} to" in recorded.cut


def test_damaged_chunk_is_skipped_and_named(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Before: 13 s of 162 s were judged, and exit 0."""
    data, chunks = bytearray(file.read_bytes()), FlightData(file).chunks
    for number in (0, 3):
        data[chunks[number][1] + 200] ^= 0xFF
    file.write_bytes(data)
    code, report, _ = judged(file, capsys)
    assert (code, report["verdict"]) == (3, "incomplete")
    first, second = report["missing"]
    assert f"bytes {chunks[0][1]} to" in first
    assert "lost: from the beginning to 0.00 s" in first
    assert f"bytes {chunks[3][1]} to" in second
    assert "lost: from 1.95 s to 3.00 s" in second
    assert len(list(FlightData(file).ticks())) == TICKS - 2 * EACH
    (farthest,) = [each for each in report["checks"] if each["name"] == "greatest distance"]
    assert farthest["worst"] == pytest.approx(10.0)


def test_violation_after_the_damage_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    samples = [flying(tick) for tick in range(TICKS)]
    near_m = np.array([[9.0, 0.0, -20.0], [10.0, 0.0, -20.0]])
    samples[200] = changed(samples[200], position_m=near_m)
    file = written(tmp_path, samples)
    data = bytearray(file.read_bytes())
    data[FlightData(file).chunks[2][1] + 300] ^= 0x10
    file.write_bytes(data)
    code, report, _ = judged(file, capsys)
    assert (code, report["verdict"]) == (1, "broken")
    assert len(report["missing"]) == 1


def test_no_straight_path_is_assumed_across_lost_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """They change sides while the record is damaged: their paths are unknown."""
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    samples = []
    for tick in range(TICKS):
        made = flying(tick)
        place_m = np.array([[0.0, 0.0, -20.0], [10.0, 0.0, -20.0]])[:: 1 if tick < 60 else -1].copy()
        samples.append(changed(made, position_m=place_m))
    file = written(tmp_path, samples)
    assert judged(file, capsys)[0] == 1  # whole: they jump through each other
    data = bytearray(file.read_bytes())
    data[FlightData(file).chunks[3][1] + 300] ^= 0x10
    file.write_bytes(data)
    assert judged(file, capsys)[0] == 3


def test_a_record_without_flight_is_never_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    file = written(tmp_path, [standing(tick) for tick in range(60)])
    code, report, _ = judged(file, capsys)
    assert (code, report["verdict"], report["flew"]) == (3, "incomplete", 0)
    assert report["missing"] == ["no vehicle was in the air: there was nothing to judge"]
    assert {each["kept"] for each in report["checks"] if each["worst"] is None} == {None}
    assert main(["report", str(file)]) == 3
    printed = capsys.readouterr().out
    assert "verdict: incomplete" in printed
    assert "kept    separation" not in printed


def test_ticks_that_were_not_recorded_in_flight_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    file = written(tmp_path, [flying(tick) for tick in range(TICKS) if not 50 <= tick < 53])
    code, report, _ = judged(file, capsys)
    assert (code, report["missing"]) == (3, ["3 ticks were not recorded from 2.45 s to 2.65 s"])


@pytest.mark.parametrize("key", ["height_max_m", "distance_max_m"])
def test_damaged_limit_is_not_applied(file: Path, capsys: pytest.CaptureFixture[str], key: str) -> None:
    """MCAP has no checksum for what a file says of itself."""
    data = file.read_bytes()
    at = data.index(key.encode()) + len(key) + 2
    damaged = data[:at] + b"9" + data[at + 1 :]
    assert damaged != data
    file.write_bytes(damaged)
    code, _, complaint = judged(file, capsys)
    assert code == 2
    assert "configuration, vehicles) is damaged" in complaint


def narrow(distance_max_m: float) -> ControlSettings:
    """The demo's, within the fence of a show."""
    safety = CONFIG.control.safety
    fence = Fence(height_min_m=3.0, height_max_m=60.0, distance_max_m=distance_max_m)
    return CONFIG.control.model_copy(update={"safety": safety.model_copy(update={"fence": fence})})


def test_fence_of_the_show_is_broken_inside_the_services_fence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    assert CONFIG.control.safety.fence.distance_max_m >= 100.0
    samples = [flying(tick, control=narrow(9.0)) for tick in range(TICKS)]
    code, report, _ = judged(written(tmp_path / "broken", samples), capsys)
    (farthest,) = [each for each in report["checks"] if each["name"] == "greatest distance"]
    assert (code, report["verdict"]) == (1, "broken")
    assert (farthest["limit"], farthest["worst"], farthest["vehicle"]) == (9.0, 10.0, "d2")
    assert judged(written(tmp_path / "kept", [flying(tick) for tick in range(TICKS)]), capsys)[0] == 0


def test_each_limit_applies_while_it_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """d2 stands at 10 m throughout: outside of the fence that held for the last quarter alone."""
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    wide, small = narrow(40.0), narrow(9.0)
    samples = [flying(tick, control=wide if tick < 180 else small) for tick in range(TICKS)]
    code, report, _ = judged(written(tmp_path, samples), capsys)
    (farthest,) = [each for each in report["checks"] if each["name"] == "greatest distance"]
    assert (code, farthest["limit"]) == (1, 9.0)
    assert farthest["at_s"] == pytest.approx(9.0, abs=0.06)
