"""Flight data read from the middle: the same ticks, without reading what is before them."""

import random
from math import inf
from pathlib import Path

import numpy as np
import pytest

from gcs.recording import mcap_layout as layout
from gcs.recording import mcap_writer as flightfile
from gcs.recording.mcap_reader import FlightData
from gcs.recording.mcap_writer import _OpenFile
from gcs.recording.sample import Sample
from tests.support.record_samples import sample

TICKS, EACH = 600, 20
ABOUT = layout.about("s1", '{"tick_rate_hz": 20.0}', {"d1": (1, "radio"), "d2": (2, "radio")})


def samples() -> list[Sample]:
    return [
        sample(
            time_s=100.0 + tick / 20,
            position_m=np.array([[0.05 * tick, 0.0, -20.0], [10.0, 0.0, -20.0]]),
            reasons=["flies", f"since {tick // 50}"],
        )
        for tick in range(TICKS)
    ]


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Half a minute in thirty chunks."""
    monkeypatch.setattr(flightfile, "CHUNK_S", 0.0)
    made = _OpenFile(tmp_path / "flight.mcap", ABOUT)
    for number, each in enumerate(samples(), start=1):
        made.add(each)
        if number % EACH == 0:
            made.flush()
    made.finish()
    return made.path


def test_seeking_to_any_time_gives_the_same_ticks(file: Path) -> None:
    data = FlightData(file)
    every = list(data.ticks())
    assert len(every) == TICKS
    assert data.last_s() == every[-1].unix_s
    places = random.Random(5)
    for from_s in [places.uniform(every[0].unix_s - 5.0, every[-1].unix_s + 1.0) for _ in range(40)]:
        found = [data.decoded(each) for each in data.samples(from_s)]
        desired = [tick for tick in every if tick.unix_s >= from_s]
        assert [tick.unix_s for tick in found] == [tick.unix_s for tick in desired]
        for one, other in zip(found[:30], desired[:30], strict=True):
            assert one.vehicles.tobytes() == other.vehicles.tobytes()
            assert (one.tick, one.status) == (other.tick, other.status)


def test_earlier_data_is_not_read_when_seeking(file: Path) -> None:
    data = FlightData(file)
    assert len(data.chunks) == TICKS // EACH
    near_the_end = data.offset(data.chunks[-1][0])
    assert near_the_end >= data.chunks[-8][1]  # of a second each: the status is repeated every 5 s
    assert data.offset(-inf) == data.offset(0.0) == data.chunks[0][1]


def test_truncated_file_can_be_sought_up_to_its_cut(file: Path) -> None:
    whole = file.read_bytes()
    for share in (0.1, 0.5, 0.9):
        cut = file.with_name("cut.mcap")
        cut.write_bytes(whole[: round(share * len(whole))])
        data = FlightData(cut)
        ticks = list(data.ticks())
        assert data.last_s() == ticks[-1].unix_s
        middle_s = ticks[len(ticks) // 2].unix_s
        assert len(list(data.samples(middle_s))) == len(ticks) - len(ticks) // 2
        assert "cut off or damaged" in data.cut


def test_a_file_without_a_whole_chunk_has_no_last_tick(file: Path) -> None:
    cut = file.with_name("cut.mcap")
    cut.write_bytes(file.read_bytes()[: FlightData(file).chunks[0][1] + 100])
    assert FlightData(cut).last_s() is None
