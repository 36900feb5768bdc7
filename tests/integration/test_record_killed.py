"""The service's process is killed at any moment: every acknowledged command is in the record."""

import asyncio
import multiprocessing
import os
import random
import signal
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from gcs.recording.audit_reader import last_known
from gcs.recording.session import Record
from gcs.service import Outcome
from gcs.service.commands import CommandLog
from tests.support.audit_rows import commands

VEHICLES = {f"d{row}": (row, "radio") for row in range(1, 21)}


def command_for_ever(root: Path, reported: Connection) -> None:
    """Accept commands as fast as the disk takes them, four at a time; send the kept ones."""

    async def commands_of_one(record: Record, book: CommandLog) -> None:
        while True:
            command = book.open("hold", list(VEHICLES), {})
            for name in VEHICLES:
                book.close(command.id, name, Outcome.DONE)
            assert await record.audit.kept()
            reported.send((record.session, command.id))

    async def main() -> None:
        with Record(root, "{}", VEHICLES) as record:
            book = CommandLog(record.audit)
            async with asyncio.TaskGroup() as group:
                for _ in range(4):
                    group.create_task(commands_of_one(record, book))

    asyncio.run(main())


@pytest.mark.parametrize("kills", [4, pytest.param(20, marks=pytest.mark.soak)])
def test_no_acknowledged_command_is_missing_after_kill_9(tmp_path: Path, kills: int) -> None:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["gcs.recording.session", "gcs.service.commands"])
    samples, acknowledged = random.Random(5), set()
    for _ in range(kills):
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=command_for_ever, args=(tmp_path, sender))
        process.start()
        sender.close()
        acknowledged.add(receiver.recv())  # it works
        process.join(samples.uniform(0.0, 0.15))
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        while receiver.poll():
            try:
                acknowledged.add(receiver.recv())
            except (EOFError, OSError):  # killed while it sent
                break
    kept = {(command.session, command.id): command for command in commands(tmp_path)}
    assert len({session for session, _ in acknowledged}) == kills
    assert len(acknowledged) > kills, "some were killed at work"
    assert not acknowledged - kept.keys()
    for key in acknowledged:
        assert kept[key].outcomes == dict.fromkeys(VEHICLES, ("done", ""))
    newest = last_known(tmp_path).session
    assert newest is not None
    assert newest.ended_unix_s is None, "it did not end as it should"
