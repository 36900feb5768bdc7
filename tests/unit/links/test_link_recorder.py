import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as dialect

from gcs.links.link import FrameDirection
from gcs.links.tlog import Recorder, record


def a_recorder(folder: Path, name: str = "radio") -> Recorder:
    return Recorder(folder, name, time.monotonic)


def frames(count: int) -> list[bytes]:
    packer = dialect.MAVLink(None, srcSystem=3, srcComponent=1)
    made = []
    for index in range(count):
        packer.seq = index % 256
        made.append(bytes(dialect.MAVLink_system_time_message(index, index).pack(packer)))
    return made


def read(path: Path) -> list[Any]:
    log = mavutil.mavlink_connection(str(path))
    messages = []
    while (message := log.recv_match()) is not None:
        messages.append(message)
    log.close()
    return messages


def test_record_is_a_time_and_a_frame() -> None:
    assert record(0x0102030405060708, b"\xfd\x00") == b"\x01\x02\x03\x04\x05\x06\x07\x08\xfd\x00"


def test_pymavlink_reads_every_frame_in_order_with_its_time(tmp_path: Path) -> None:
    recorder = a_recorder(tmp_path)
    recorder.open()
    began_s = time.time()
    for raw in frames(3000):
        recorder.record(time.monotonic(), FrameDirection.SENT, raw, 3)
    recorder.close()
    assert recorder.path is not None
    messages = read(recorder.path)
    assert [message.time_boot_ms for message in messages] == list(range(3000))
    times_s = [message._timestamp for message in messages]
    assert times_s == sorted(times_s)
    assert began_s - 1 < times_s[0] <= times_s[-1] < time.time() + 1
    assert (recorder.written, recorder.dropped) == (3000, 0)


def test_arrival_dated_back_keeps_the_order(tmp_path: Path) -> None:
    recorder = a_recorder(tmp_path)
    recorder.open()
    now_s = time.monotonic()
    for age_s, raw in zip((0.0, 0.2, 0.1), frames(3), strict=True):
        recorder.record(now_s - age_s, FrameDirection.RECEIVED, raw, 3)
    recorder.close()
    assert recorder.path is not None
    messages = read(recorder.path)
    assert [message.time_boot_ms for message in messages] == [0, 1, 2]
    assert len({message._timestamp for message in messages}) == 1


def test_two_recordings_of_one_second_have_separate_files(tmp_path: Path) -> None:
    for _ in range(2):
        recorder = a_recorder(tmp_path / "new" / "folder", "radio/7 ü")
        recorder.open()
        recorder.record(0.0, FrameDirection.SENT, frames(1)[0], 3)
        recorder.close()
    assert len(list((tmp_path / "new" / "folder").glob("*-radio_7__*.tlog"))) == 2


def test_no_file_before_the_first_frame(tmp_path: Path) -> None:
    recorder = a_recorder(tmp_path)
    recorder.record(0.0, FrameDirection.SENT, frames(1)[0], 3)
    recorder.open()
    recorder.close()
    recorder.record(0.0, FrameDirection.SENT, frames(1)[0], 3)
    assert list(tmp_path.iterdir()) == []


def test_unavailable_folder_is_reported_once_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    recorder = a_recorder(tmp_path / "file")
    recorder.open()
    for raw in frames(5):
        recorder.record(0.0, FrameDirection.SENT, raw, 3)
        recorder._write_once()
    recorder.close()
    assert (recorder.written, recorder.dropped) == (0, 5)
    assert [record.msg for record in caplog.records] == ["recording_failed"]


@contextmanager
def files_end_at(size_bytes: int) -> Iterator[None]:
    """No file of this process may grow beyond that: the rest of a write fails, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_full_disk_loses_whole_frames_and_the_file_goes_on(tmp_path: Path) -> None:
    recorder = a_recorder(tmp_path)
    recorder._closed = False  # its turns are taken here
    problems = []
    for index, raw in enumerate(frames(6)):
        recorder.record(float(index), FrameDirection.SENT, raw, 3)
        with files_end_at(70 if index < 4 else 1000):  # two of them and a half
            recorder._write_once()
        problems.append(recorder.problem)
    recorder._end()
    assert problems[:2] == ["", ""]
    assert problems[2] == f"frames are not recorded: {tmp_path}: [Errno 27] File too large"
    assert problems[3] == problems[2]
    assert problems[4] == problems[5] == f"{tmp_path}: 2 frames were not recorded"
    assert recorder.path is not None
    assert [message.time_boot_ms for message in read(recorder.path)] == [0, 1, 4, 5]
    assert (recorder.written, recorder.dropped) == (4, 2)


def test_frames_beyond_the_disk_rate_are_counted_and_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.links.tlog._QUEUE_MAX_BYTES", 100)
    recorder = a_recorder(tmp_path)
    recorder._closed = False  # its thread never comes to writing
    for raw in frames(50):
        recorder.record(0.0, FrameDirection.SENT, raw, 3)
    assert recorder.dropped > 40
