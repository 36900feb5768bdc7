"""The API's process dies or hangs in flight: control goes on, and the API answers again on the same port."""

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from gcs.cli.service.serve import StationService, running
from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import GcsError
from gcs.model.lifecycle import Phase
from gcs.service import ShowAction
from gcs.testing.views import vehicles_of
from tests.support.machine import Pauses, TickTimes, free_ports
from tests.support.processes import SOON_S, flying_config, proper, until, vehicles, wait_until

COUNT = 2

LONGEST_GAP_S = 0.5
"""Half of what PX4 takes for the loss of its ground station."""


def api_process() -> int | None:
    """Process id of this process's API; None: there is none."""
    for folder in Path("/proc").iterdir():
        with suppress(OSError, ValueError):
            words = (folder / "cmdline").read_bytes().split(b"\0")
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid() and b"gcs.cli.service.api_child" in words:
                return int(folder.name)
    return None


@asynccontextmanager
async def flying(folder: Path, ticks: TickTimes) -> AsyncIterator[tuple[StationService, int]]:
    """Vehicles in formation. Yields the service and the API's port."""
    base = free_ports(COUNT)
    raw = flying_config(COUNT, base, silence_s=20.0).model_dump()
    raw["links"][0]["transport"] = "native"
    config = Config.model_validate(raw)
    with vehicles(COUNT, base, folder, "--telemetry-hz", "10", *proper(config)):
        async with running(config, ticks) as (orchestrator, port):
            view = orchestrator.view
            await until("ready", SOON_S, lambda: all(each.ready for each in vehicles_of(view.value)))
            orchestrator.commands.command_show(ShowAction.START)
            formed = {Phase.FORMATION}
            await until("flying", SOON_S, lambda: {each.phase for each in vehicles_of(view.value)} == formed)
            yield orchestrator, port


def answers(port: int) -> bool:
    with suppress(GcsError), Client(f"http://127.0.0.1:{port}", timeout_s=1.0) as client:
        return client.health().alive
    return False


async def lose_api(folder: Path, ticks: TickTimes, number: signal.Signals) -> tuple[float, float, int]:
    """Send the signal to the API's process. Returns: when, when it was replaced, and setpoints sent since."""
    async with flying(folder, ticks) as (orchestrator, port):
        lost = api_process()
        assert lost is not None
        assert await asyncio.to_thread(answers, port)
        began_s, sent = time.monotonic(), orchestrator.view.value.setpoints_sent
        os.kill(lost, number)
        replaced = partial(wait_until, "replaced", SOON_S, lambda: api_process() != lost and answers(port))
        await asyncio.to_thread(replaced)
        ended_s, sent = time.monotonic(), orchestrator.view.value.setpoints_sent - sent
        with pytest.raises(ProcessLookupError):
            os.kill(lost, 0)
        with Client(f"http://127.0.0.1:{port}", timeout_s=30.0) as client:
            await asyncio.to_thread(client.command, "d1", "hold")
        phases = [Phase.HOLD, Phase.FORMATION]
        view = orchestrator.view
        await until("held", SOON_S, lambda: [each.phase for each in vehicles_of(view.value)] == phases)
    return began_s, ended_s, sent


@pytest.mark.soak
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_lost_api_is_replaced_while_control_flies_on(
    tmp_path: Path, number: signal.Signals, caplog: pytest.LogCaptureFixture
) -> None:
    ticks = TickTimes()
    with Pauses() as machine:
        began_s, ended_s, sent = asyncio.run(lose_api(tmp_path, ticks, number))
    assert [record.message for record in caplog.records if record.name == "gcs.cli.service.api_process"] == [
        "api_failed"
    ]
    count, awake_s = ticks.count(began_s, ended_s), machine.awake_s(began_s, ended_s)
    assert count >= 10.0 * awake_s
    assert sent >= 0.9 * COUNT * count
    times_s = [time_s for time_s in ticks.times_s if began_s <= time_s < ended_s]
    assert max(machine.awake_s(first_s, next_s) for first_s, next_s in pairwise(times_s)) < LONGEST_GAP_S
