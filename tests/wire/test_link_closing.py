"""A link closes while Python's garbage collector is at work on another thread, and the process lives."""

import asyncio
import gc
import multiprocessing
import time
from contextlib import ExitStack
from threading import Event, Thread

import pytest
from link_bench import a_link, running, until
from link_peer import Peer
from machine import free_ports

from gcs.links.mavsdk_link import MavsdkLink

pytestmark = pytest.mark.xdist_group("wire")

VEHICLES = 6
ROUNDS = 12
"""Each aborted one time in three while vehicles were left to the collector."""


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
    gc.disable()  # nobody but the thread shall collect
    async with running(link):
        await until(lambda: len(link._met) == VEHICLES)
        cycle: list[object] = [dict(link._met)]
        cycle.append(cycle)
        del cycle
        collector.start()
    closed.set()
    collector.join()


def open_and_close_often() -> None:
    """In a process of its own: MAVSDK aborts the whole process."""
    with ExitStack() as peers:
        port = free_ports()
        for system_id in range(1, VEHICLES + 1):
            peers.enter_context(Peer(port, system_id))
        for _ in range(ROUNDS):
            asyncio.run(open_and_close(port))


def test_closing_a_link_never_ends_the_process() -> None:
    process = multiprocessing.get_context("spawn").Process(target=open_and_close_often)
    process.start()
    process.join(120.0)
    assert process.exitcode == 0
