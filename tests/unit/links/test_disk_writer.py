"""The disk never blocks a caller: a disk that hangs, fails for a while, or a defect in the writer."""

import asyncio
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread

import pytest

from gcs.links.disk_writer import DiskWriter
from tests.support.machine import soon


class Disk(DiskWriter[int]):
    PERIOD_S = 0.0
    REPEATS = True

    def __init__(self) -> None:
        super().__init__(Path("disk"), "numbers", 5)
        self.stored: list[int] = []
        self.error: Exception | None = None
        self.works = Event()
        self.works.set()
        self.begun = Event()

    def _write(self, batch: Sequence[int]) -> None:
        self.begun.set()
        self.works.wait()
        if self.error is not None:
            raise self.error
        self.stored += batch

    def _end(self) -> None:
        pass


def test_a_disk_that_hangs_blocks_neither_put_nor_close(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.links.disk_writer.JOIN_S", 0.05)
    monkeypatch.setattr("gcs.links.disk_writer.WAIT_S", 0.05)
    disk = Disk()
    disk.works.clear()
    disk.open()
    disk.put([0])
    disk.begun.wait()
    for number in range(1, 8):
        disk.put([number])
    assert not asyncio.run(disk.kept())
    assert (disk.waiting, disk.dropped) == (5, 2)
    disk.close()
    assert disk.stored == []
    disk.works.set()
    soon(lambda: disk.stored == list(range(6)))


def test_a_thread_that_is_being_started_has_not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    disk, seen = Disk(), list[str]()

    class SlowThread(Thread):
        def start(self) -> None:
            reader.start()
            reader.join(0.2)  # it waits until the thread has started
            super().start()

    monkeypatch.setattr("gcs.links.disk_writer.Thread", SlowThread)
    for _ in range(2):
        reader = Thread(target=lambda: seen.append(disk.problem))
        disk.open()
        reader.join()
        disk.close()
    assert seen == ["", ""]


def test_reopened_while_the_disk_hangs_one_thread_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.links.disk_writer.JOIN_S", 0.05)
    disk = Disk()
    disk.works.clear()
    disk.open()
    disk.put([0])
    disk.begun.wait()
    disk.close()
    disk.begun.clear()
    disk.open()
    disk.put([1])
    assert not disk.begun.wait(0.1)  # a second thread would begin to write
    disk.works.set()
    soon(lambda: disk.stored == [0, 1])
    disk.close()
    disk.open()
    disk.put([2])
    assert asyncio.run(disk.kept())
    disk.close()
    assert disk.stored == [0, 1, 2]


def test_repeated_batches_keep_their_order_until_stored() -> None:
    disk = Disk()
    disk.error = OSError("no space")
    disk.open()
    disk.put([1, 2])
    assert not asyncio.run(disk.kept())
    soon(lambda: disk.problem == "numbers are not recorded: disk: no space")
    disk.put([3])
    disk.error = None
    soon(lambda: not disk.problem)
    assert asyncio.run(disk.kept())
    disk.close()
    assert (disk.stored, disk.written, disk.dropped) == ([1, 2, 3], 3, 0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_defect_ends_the_thread_and_is_reported() -> None:
    disk = Disk()
    disk.error = KeyError("a defect")
    disk.open()
    disk.put([1])
    soon(lambda: disk.problem == "disk: the thread that writes numbers has ended; the log says why")
    assert not asyncio.run(disk.kept())
    disk.close()
