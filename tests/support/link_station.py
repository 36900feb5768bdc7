"""A ground station in a process of its own, to be stopped and killed: a link, and a control loop for it."""

import asyncio
import logging
import multiprocessing
import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path

import link_bench
from link_bench import DatedTicks, ready, running


def station(port: int, transport: str, record: Path | None, file_max_bytes: int) -> None:
    """Fly "v1" until ended. No file may have more bytes; its log lies beside the recording."""
    if record is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_max_bytes, file_max_bytes))
        logging.basicConfig(filename=record / "log", level=logging.WARNING)
    link_bench.chosen = transport

    async def main() -> None:
        link = link_bench.a_link(port, [1], record=record)
        async with running(link):
            await ready(link)
            async with DatedTicks(link, "v1").running():
                await asyncio.sleep(600.0)

    asyncio.run(main())


@contextmanager
def a_station(
    port: int, transport: str, record: Path | None = None, file_max_bytes: int = resource.RLIM_INFINITY
) -> Iterator[BaseProcess]:
    """Until the block ends."""
    arguments = (port, transport, record, file_max_bytes)
    if record is not None:
        (record / "log").touch()
    process = multiprocessing.get_context("spawn").Process(target=station, args=arguments)
    process.start()
    try:
        yield process
    finally:
        process.kill()
        process.join()


def stop(process: BaseProcess) -> None:
    """SIGSTOP; it stands when this returns."""
    assert process.pid is not None
    os.kill(process.pid, signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)


def go_on(process: BaseProcess) -> None:
    """SIGCONT."""
    assert process.pid is not None
    os.kill(process.pid, signal.SIGCONT)
