"""Links open side by side, and close while Python's garbage collector is at work: the process lives."""

import asyncio
import gc
import multiprocessing
import time
from collections.abc import Callable
from contextlib import ExitStack
from threading import Event, Thread

import pytest

from gcs.links.mavsdk.binding import MavsdkBinding
from gcs.links.mavsdk.link import MavsdkLink
from tests.support.link_bench import a_link, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports

VEHICLES = 6
ROUNDS, ROUNDS_SOAK = 6, 24
"""Each aborted one time in three while vehicles were left to the collector."""

OPENINGS, OPENINGS_SOAK = 10, 40
"""They ended in a segmentation fault while each instance took MAVSDK's messages anew."""

SOON_S = 300.0


async def open_and_close(port: int) -> None:
    """Leave the vehicles in a cycle, as a traceback or a callback can, and collect while the link closes."""
    link = a_link(port, range(1, VEHICLES + 1))
    assert isinstance(link, MavsdkLink)
    closed = Event()

    def collect() -> None:
        while not closed.is_set():
            gc.collect()
            time.sleep(0.0001)

    collector = Thread(target=collect)
    gc.disable()  # only the thread shall collect
    async with running(link):
        await until(lambda: len(link._discovered) == VEHICLES)
        cycle: list[object] = [dict(link._discovered)]
        cycle.append(cycle)
        del cycle
        collector.start()
    closed.set()
    collector.join()


def open_and_close_often(times: int) -> None:
    """In a process of its own: MAVSDK aborts the whole process."""
    with ExitStack() as peers:
        port = free_ports()
        for system_id in range(1, VEHICLES + 1):
            peers.enter_context(Peer(port, system_id, beat_s=0.1))
        for _ in range(times):
            asyncio.run(open_and_close(port))


def open_side_by_side_often(times: int) -> None:
    """In a process of its own, four at a time."""

    def one() -> None:
        fleet = MavsdkBinding(245)
        fleet.open()
        fleet.destroy()

    for _ in range(times):
        threads = [Thread(target=one) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


@pytest.mark.keeps("open_and_close_often-6")
@pytest.mark.parametrize(
    ("what", "times"),
    [
        (open_and_close_often, ROUNDS),
        (open_side_by_side_often, OPENINGS),
        pytest.param(open_and_close_often, ROUNDS_SOAK, marks=pytest.mark.soak),
        pytest.param(open_side_by_side_often, OPENINGS_SOAK, marks=pytest.mark.soak),
    ],
)
def test_opening_and_closing_links_never_ends_the_process(what: Callable[[int], None], times: int) -> None:
    process = multiprocessing.get_context("spawn").Process(target=what, args=(times,))
    process.start()
    process.join(SOON_S)
    assert process.exitcode == 0
