"""A ground station (a link and a control loop) in a separate process that tests stop and kill."""

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

from tests.support import link_bench
from tests.support.link_bench import DatedTicks, ready, running


def station(port: int, transport: str, record: Path | None, file_max_bytes: int) -> None:
    """Fly "v1" until ended, with a limit on the size of files; the log is beside the recording."""
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
    """Run a station until the block ends."""
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
    """Send SIGSTOP; the process is stopped when this returns."""
    assert process.pid is not None
    os.kill(process.pid, signal.SIGSTOP)
    os.waitpid(process.pid, os.WUNTRACED)


def go_on(process: BaseProcess) -> None:
    """Send SIGCONT."""
    assert process.pid is not None
    os.kill(process.pid, signal.SIGCONT)
