"""Two hundred calls of junk a second while vehicles fly: ticks go on, and an emergency stop gets through."""

import asyncio
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from gcs.api.auth.tokens import create_token
from gcs.cli.service.serve import running
from gcs.client import Client
from gcs.config.schema import Config
from gcs.model.errors import LinkError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import ShowAction
from gcs.service.access import Role
from gcs.testing.views import vehicles_of
from tests.support.machine import Pauses, free_ports
from tests.support.processes import SOON_S, flying_config, proper, until, vehicles

COUNT, FEW = 20, 8
JUNK_PER_S = 200.0
JUNK_S = 5.0
CALLS = 12

JUNK = """
import http.client, random, sys, threading, time
ports, seconds, rate = (int(sys.argv[1]), int(sys.argv[2])), float(sys.argv[3]), float(sys.argv[4])
chance, lock, due, statuses = random.Random(5), threading.Lock(), iter(range(10**9)), []
junk = [
    ("POST", "/api/v1/show/stop", b""), ("POST", "/api/v1/show/start", b"{" * 3000),
    ("GET", "/api/v1/fleet", None), ("PUT", "/api/v1/target", chance.randbytes(20000)),
    ("BREW", "/" + "x" * 4000, None), ("GET", "/metrics", None), ("GET", "/openapi.json", None),
    ("DELETE", "/api/v1/obstacles/..", b"null"), ("PATCH", "/api/v1/formation", b'{"radius_m": NaN}'),
]
begin_s = time.monotonic()
def ask():
    connection = None
    while True:
        with lock:
            turn_s = begin_s + next(due) / rate
        if turn_s > begin_s + seconds:
            return
        time.sleep(max(0.0, turn_s - time.monotonic()))
        try:
            if connection is None or chance.random() < 0.5:  # half of it comes as somebody new
                connection = http.client.HTTPConnection("127.0.0.1", chance.choice(ports), timeout=60)
            connection.request(*chance.choice(junk))
            answer = connection.getresponse()
            answer.read()
            statuses.append(answer.status)
        except (OSError, http.client.HTTPException):
            connection = None
threads = [threading.Thread(target=ask) for _ in range(16)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len(statuses), min(statuses, default=0))
"""

BUTTON = """
import json, sys, time
from gcs.client import Client
url, lane, token, seconds, calls = *sys.argv[1:4], float(sys.argv[4]), int(sys.argv[5])
times = []
with Client(url, token=token, emergency_url=lane) as client:
    client.access()  # loads what reads answers, as a page that is open has done
for turn in range(calls):
    time.sleep(seconds / calls / 2)
    with Client(url, token=token, emergency_url=lane) as client:  # as from a button
        began_s = time.monotonic()
        order = client.stop() if turn == calls - 1 else client.command("d1", "hold")
        times.append((began_s, time.monotonic()))
print(json.dumps({"times": times, "by": order.by}))
"""


class Flooded(NamedTuple):
    """What was seen."""

    waits_s: list[float]  # of each emergency call, of what the machine was awake
    by: str
    answered: int
    ticks: int  # while it lasted
    awake_s: float
    late_p99_ms: float  # of the ticks at its end


async def printed(program: str, *words: object) -> bytes:
    """What a Python program prints."""
    command = [sys.executable, "-c", program, *map(str, words)]
    process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
    out, _ = await process.communicate()
    assert process.returncode == 0
    return out


async def lane_of(client: Client) -> int | None:
    """Asked until the service is well: the machine may have stood still for a moment."""
    while True:
        try:
            return (await asyncio.to_thread(client.health)).emergency_port
        except LinkError:
            await asyncio.sleep(0.1)


async def fly_and_flood(folder: Path, machine: Pauses, junk_s: float = JUNK_S, count: int = COUNT) -> Flooded:
    """Vehicles in formation, junk without a token at both listeners, and a token that may stop them."""
    base = free_ports(count)
    file = folder / "tokens.json"
    button, crew = (create_token(file, role.value, role) for role in (Role.EMERGENCY, Role.OPERATE))
    raw = flying_config(count, base, silence_s=20.0).model_dump() | {"access": {"tokens_file": file}}
    raw["links"][0]["transport"] = "native"
    raw["formation"] = {"radius_m": 20.0, "height_m": 30.0}
    config = Config.model_validate(raw)
    with vehicles(count, base, folder, "--telemetry-hz", "10", *proper(config)):
        async with running(config) as (orchestrator, port):
            view = orchestrator.view
            await until("ready", SOON_S, lambda: all(each.ready for each in vehicles_of(view.value)))
            orchestrator.commands.command_show(ShowAction.START)
            formed = {Phase.FORMATION}
            await until("flying", SOON_S, lambda: {each.phase for each in vehicles_of(view.value)} == formed)
            url = f"http://127.0.0.1:{port}"
            with Client(url, token=crew, timeout_s=30.0) as client:
                lane_port = await lane_of(client)
            ticks, began_s = view.value.tick.count, time.monotonic()
            lane = f"http://127.0.0.1:{lane_port}"
            junk, stated = await asyncio.gather(
                printed(JUNK, port, lane_port, junk_s, JUNK_PER_S),
                printed(BUTTON, url, lane, button, junk_s, CALLS),
            )
            ticks, awake_s = view.value.tick.count - ticks, machine.awake_s(began_s, time.monotonic())
            late_p99_ms = view.value.tick.lateness_p99_ms or 0.0
            down = {ShowPhase.RETURNING, ShowPhase.LANDED}
            assert view.value.show in down
    answered, least = map(int, junk.split())
    reported = json.loads(stated)
    assert least in {200, 401}
    waits_s = [machine.awake_s(began_s, ended_s) for began_s, ended_s in reported["times"]]
    return Flooded(waits_s, reported["by"], answered, ticks, awake_s, late_p99_ms)


def test_emergency_stop_passes_a_flood_of_junk(tmp_path: Path) -> None:
    with Pauses() as machine:
        seen = asyncio.run(fly_and_flood(tmp_path, machine, count=FEW))
    assert seen.answered > 0.2 * JUNK_PER_S * JUNK_S, "the flood came"
    assert seen.by == "emergency"
    # on a machine with nothing else to do it takes less than 0.1 s: tests/bench/flood.py judges that
    assert max(seen.waits_s) < 1.0
    assert seen.ticks >= 10.0 * seen.awake_s
