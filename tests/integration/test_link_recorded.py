"""What a link records, also of one that is killed."""

import asyncio
import multiprocessing
import os
import signal
import time
from contextlib import closing
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs.links import Verb
from gcs.links.link import FrameDirection
from gcs.links.settings import Listen
from gcs.model.frames import ShowFrame
from tests.support.link_bench import KINDS, AnyLink, do, ready, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports


def a_link(port: int, folder: Path, kind: str = "mavsdk") -> AnyLink:
    frame = ShowFrame(47.4, 8.5, 500.0, 0.0)
    return KINDS[kind]("bench", {"v1": 1}, Listen("127.0.0.1", port), frame, record=folder)


def recorded(path: Path) -> list[bytes]:
    with closing(mavutil.mavlink_connection(str(path))) as log:
        frames = []
        while (message := log.recv_match()) is not None:
            frames.append(bytes(message.get_msgbuf()))
        return frames


@pytest.mark.parametrize(("kind", "station_id"), [("mavsdk", 245), ("native", 254)])
def test_recording_holds_every_frame_in_order(tmp_path: Path, kind: str, station_id: int) -> None:
    seen: list[bytes] = []

    def see(_time_s: float, _direction: FrameDirection, raw: bytes, _system_id: int) -> None:
        seen.append(raw)

    async def main(link: AnyLink) -> None:
        link.observe(see)
        async with running(link):
            await ready(link)
            await do(link, Verb.ARM, "v1")
            await until(lambda: len(seen) > 50)
        assert link._recorder is not None
        assert link._recorder.written == len(seen)

    with Peer(port := free_ports(), 1):
        asyncio.run(main(a_link(port, tmp_path, kind)))
    (path,) = tmp_path.glob("*.tlog")
    frames = recorded(path)
    assert len(frames) == len(seen) > 50
    assert sorted(frames) == sorted(seen)
    # threads may come between a frame's two observers, so only each side's own order is exact
    for sender in (1, station_id):
        assert [raw for raw in frames if raw[5] == sender] == [raw for raw in seen if raw[5] == sender]


def record_for_ever(port: int, folder: Path) -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await asyncio.sleep(600.0)

    asyncio.run(main(a_link(port, folder)))


def test_a_recording_can_be_read_after_the_process_was_killed(tmp_path: Path) -> None:
    with Peer(port := free_ports(), 1):
        process = multiprocessing.get_context("spawn").Process(target=record_for_ever, args=(port, tmp_path))
        process.start()
        end_s = time.monotonic() + 120.0
        while not (paths := list(tmp_path.glob("*.tlog"))) or paths[0].stat().st_size < 4000:
            assert time.monotonic() < end_s
            time.sleep(0.1)
        time.sleep(1.0)
        killed_s = time.time()
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        process.join()
    (path,) = paths
    with closing(mavutil.mavlink_connection(str(path))) as log:
        last_s = 0.0
        while (message := log.recv_match()) is not None:
            assert message.get_type() != "BAD_DATA"
            last_s = message._timestamp
    assert killed_s - last_s < 3.0  # it is written once a second, when the machine has time for it


def test_a_link_flies_though_its_recording_fails(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").touch()

    async def main(link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            await do(link, Verb.ARM, "v1")
            recorder = link._recorder
            assert recorder is not None
            await until(lambda: recorder.dropped > 0)
        assert recorder.written == 0

    with Peer(port := free_ports(), 1):
        asyncio.run(main(a_link(port, tmp_path / "file")))
    assert [record.msg for record in caplog.records].count("recording_failed") == 1
