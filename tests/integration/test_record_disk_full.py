"""A full disk: what was recorded is whole, the operator is notified, and recording resumes with room."""

import asyncio
import multiprocessing
import resource
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Mode
from gcs.recording.audit_reader import last_known
from gcs.recording.mcap_reader import FlightData
from gcs.recording.sample import Sample
from gcs.recording.session import Record
from gcs.service.commands import CommandLog
from tests.support import record_samples
from tests.support.audit_rows import commands

VEHICLES = {f"d{row}": (row, "radio") for row in range(1, 101)}
ROOM_BYTES = 150_000


def sample(tick: int) -> Sample:
    n = len(VEHICLES)
    return record_samples.sample(
        n,
        time_s=tick / 20,
        position_m=np.random.default_rng(tick).normal(size=(n, 3)),
        phases=(Phase.STANDBY,) * n,
        modes=(Mode.HOLD,) * n,
        armed=(False,) * n,
        show=ShowPhase.IDLE,
    )


def fill_the_disk(root: Path, reported: Connection) -> None:
    """Record until nothing more fits, then with room again. A file may have so many bytes."""
    hardest = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, hardest))
    ticks = iter(range(100_000))

    def tick_until(holds: Callable[[], bool]) -> None:
        end_s = time.monotonic() + 120.0
        while not holds():
            assert time.monotonic() < end_s
            record.note(sample(next(ticks)), [])
            book.open("hold", list(VEHICLES), {})
            time.sleep(0.01)

    with Record(root, "{}", VEHICLES) as record:
        book = CommandLog(record.audit)
        assert asyncio.run(record.audit.kept())
        full: tuple[str, ...] = ()

        def nothing_is_recorded() -> bool:
            nonlocal full
            full = record.problems
            desired = ("rows of the audit are not recorded", "flight data are not recorded")
            return len(full) == 2 and all(
                text in problem for text, problem in zip(desired, full, strict=True)
            )

        tick_until(nothing_is_recorded)
        refused = not asyncio.run(record.audit.kept())
        resource.setrlimit(resource.RLIMIT_FSIZE, (hardest, hardest))
        tick_until(lambda: len(record.problems) == 1 and "were not recorded" in record.problems[0])
        last = book.open("stop", list(VEHICLES), {})
        reported.send((full, refused, asyncio.run(record.audit.kept()), last.id))


def test_full_disk_is_reported_and_recording_resumes_with_room(tmp_path: Path) -> None:
    context = multiprocessing.get_context("forkserver")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=fill_the_disk, args=(tmp_path, sender))
    process.start()
    sender.close()
    full, refused, kept, last = receiver.recv()
    process.join()
    assert "rows of the audit are not recorded" in full[0]
    assert "flight data are not recorded" in full[1]
    assert refused
    assert kept
    found = commands(tmp_path)
    assert [command.id for command in found] == [f"o{number}" for number in range(1, len(found) + 1)], (
        "none is lost"
    )
    assert (found[-1].id, found[-1].action) == (last, "stop")
    session = last_known(tmp_path).session
    assert session is not None
    # while the disk was full another file may have been begun, and have ended like the first
    first, *_, second = sorted(session.folder.glob("*.mcap"), key=lambda path: (len(path.name), path.name))
    assert first.stat().st_size <= ROOM_BYTES
    before, after = FlightData(first), FlightData(second)
    assert len(list(before.ticks())) > 0
    assert "cut off" in before.cut
    assert len(list(after.ticks())) > 0
    assert not after.cut
