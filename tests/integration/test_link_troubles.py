"""Whatever befalls the station: setpoints cease in time or go on correctly, and no old one ever leaves.

Every setpoint says when it was asked for, and the kernel of its vehicle when it came.
"""

import asyncio
import time
from contextlib import closing
from pathlib import Path

import pytest
from pymavlink import mavutil

from gcs.links.mavsdk.link import MavsdkLink
from tests.support.link_bench import DatedTicks, a_link, asked_s, ready, running, until
from tests.support.link_peer import Peer
from tests.support.link_station import a_station, go_on, stop
from tests.support.machine import Pauses, free_ports

SETPOINT_TIMEOUT_S = 0.2
ON_ITS_WAY_S = 0.02
"""From a station that stands, what had left it still arrives."""

SOON_S = 120.0

TRANSPORTS = pytest.mark.parametrize("transport", ["mavsdk", "native"])


def arrivals_s(peer: Peer) -> list[float]:
    return [time_s for time_s, _ in peer.messages("SET_POSITION_TARGET_LOCAL_NED")]


def wait_for_more(peer: Peer, count: int) -> None:
    """Until so many more setpoints have come."""
    desired, end_s = len(arrivals_s(peer)) + count, time.monotonic() + SOON_S
    while len(arrivals_s(peer)) < desired:
        assert time.monotonic() < end_s, "no setpoints"
        time.sleep(0.01)


def assert_all_fresh(peer: Peer, machine: Pauses) -> None:
    """Each came within the watchdog's time after its tick, in the order of the ticks."""
    setpoints = peer.messages("SET_POSITION_TARGET_LOCAL_NED")
    asked = [asked_s(setpoint, arrived_s) for arrived_s, setpoint in setpoints]
    assert len(asked) > 20
    assert asked == sorted(asked), "an old one came behind a new one"
    for (arrived_s, _), since_s in zip(setpoints, asked, strict=True):
        assert machine.awake_s(since_s, arrived_s) <= SETPOINT_TIMEOUT_S


@pytest.mark.keeps("native")
@TRANSPORTS
def test_process_stopped_and_continued(transport: str) -> None:
    with Peer(port := free_ports(), 1) as peer, a_station(port, transport) as process, Pauses() as machine:
        for _ in range(6):
            wait_for_more(peer, 7)
            stop(process)
            stopped_s = time.monotonic()
            time.sleep(0.6)
            goes_on_s = time.monotonic()
            go_on(process)
            wait_for_more(peer, 1)
            assert not [t for t in arrivals_s(peer) if stopped_s + ON_ITS_WAY_S < t < goes_on_s]
        assert_all_fresh(peer, machine)


@pytest.mark.keeps("native")
@TRANSPORTS
def test_process_killed(transport: str) -> None:
    with Peer(port := free_ports(), 1) as peer, a_station(port, transport) as process, Pauses() as machine:
        wait_for_more(peer, 30)
        process.kill()
        process.join()
        killed_s = time.monotonic()
        time.sleep(1.0)
        assert arrivals_s(peer)[-1] < killed_s
        assert_all_fresh(peer, machine)


@pytest.mark.usefixtures("transport")
def test_control_loop_late() -> None:
    async def main(peer: Peer) -> list[float]:
        link = a_link(port, [1])
        async with running(link):
            await ready(link)
            ticks = DatedTicks(link, "v1")
            late_s = []
            for late in (0.12, 0.5, 0.3, 1.0, 0.25):
                for _ in range(10):
                    ticks.tick()
                    await asyncio.sleep(0.05)
                await ticks.last()
                late_s.append(ticks.last_s)
                await asyncio.sleep(late)
            ticks.tick()
            await until(lambda: arrivals_s(peer)[-1] > ticks.last_s)
        return late_s

    with Peer(port := free_ports(), 1) as peer, Pauses() as machine:
        late_s = asyncio.run(main(peer))
        assert_all_fresh(peer, machine)
        times_s = arrivals_s(peer)
        for last_s, pause_s in zip(late_s, (0.12, 0.5, 0.3, 1.0, 0.25), strict=True):
            between_s = [t for t in times_s if last_s < t < last_s + pause_s]
            assert between_s, "it was sent once more"
            assert machine.awake_s(last_s, between_s[-1]) <= SETPOINT_TIMEOUT_S


@pytest.mark.parametrize("transport", ["mavsdk"], indirect=True)
@pytest.mark.usefixtures("transport")
def test_mavsdk_thread_stuck() -> None:
    """What MAVSDK's thread writes late is old when it comes, whatever the ticks have allowed since."""

    async def main(peer: Peer) -> list[float]:
        link = a_link(port, [1])
        assert isinstance(link, MavsdkLink)
        frees_s: list[float] = []
        async with running(link):
            await ready(link)
            fleet = link._fleet
            assert fleet is not None
            take = fleet.take
            async with DatedTicks(link, "v1").running():
                for _ in range(5):
                    before = len(arrivals_s(peer))
                    await until(lambda before=before: len(arrivals_s(peer)) > before + 10)  # type: ignore[misc]
                    dropped = link.counters.setpoints_dropped
                    fleet.take = lambda room: 0  # type: ignore[method-assign]  # nothing comes, and all waits
                    await asyncio.sleep(0.5)
                    fleet.take = take  # type: ignore[method-assign]
                    frees_s.append(time.monotonic())
                    await until(lambda dropped=dropped: link.counters.setpoints_dropped > dropped + 5)  # type: ignore[misc]
                await until(lambda: arrivals_s(peer)[-1] > frees_s[-1])
        return frees_s

    with Peer(port := free_ports(), 1) as peer, Pauses() as machine:
        asyncio.run(main(peer))
        assert_all_fresh(peer, machine)


@pytest.mark.keeps("native")
@TRANSPORTS
def test_disk_full(tmp_path: Path, transport: str) -> None:
    with (
        Peer(port := free_ports(), 1) as peer,
        a_station(port, transport, tmp_path, file_max_bytes=8_000),
        Pauses() as machine,
    ):
        end_s = time.monotonic() + SOON_S
        while "recording_failed" not in (tmp_path / "log").read_text():
            assert time.monotonic() < end_s
            time.sleep(0.1)
        failed_s = time.monotonic()
        time.sleep(2.0)
        wait_for_more(peer, 1)
        assert_all_fresh(peer, machine)
        after_s = [t for t in arrivals_s(peer) if t > failed_s]
        assert len(after_s) > 10.0 * machine.awake_s(failed_s, after_s[-1]), "they keep their rate"
    assert (tmp_path / "log").read_text().count("recording_failed") == 1
    (path,) = tmp_path.glob("*.tlog")
    with closing(mavutil.mavlink_connection(str(path))) as log:
        kinds = set()
        while (message := log.recv_match()) is not None:
            kinds.add(message.get_type())
    assert "GLOBAL_POSITION_INT" in kinds
    assert "BAD_DATA" not in kinds
