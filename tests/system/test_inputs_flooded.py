"""Each input of docs/invariants.md at ten times its bound, in flight: no tick is late because of it."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import pytest

from gcs.client import Client
from gcs.config.schema import Config
from tests.support.input_floods import ROWS
from tests.support.machine import Pauses, free_ports
from tests.support.processes import (
    SOON_S,
    close_together,
    flying_config,
    proper,
    service,
    vehicles,
    wait_passes,
    wait_until,
)
from tests.support.site_processes import Timing, timing_of
from tests.system.test_site_bus import keep_time

FLOOD_S = 10.0
NAMED_S = 2.0
TRANSPORTS = ("native", "mavsdk")
COUNTS = (6, 50)
NAMES = {
    "rtk": "rtk",
    "timecode": "timecode",
    "target": "target boat",
    "track": "target anna",
    "station": "forward",
    "connection": "link",
    "vehicles": "link",
}
"""How the alarm names the input."""


@dataclass
class Flying:
    """A service with all its inputs, its vehicles in formation."""

    client: Client
    config: Config
    ports: dict[str, int]  # of each input
    machine: Pauses

    def timing(self) -> Timing:
        return timing_of(self.client.metrics(), self.config.tick_rate_hz)

    def watched(self, seconds: float) -> Timing:
        before = self.timing()
        time.sleep(seconds)
        return self.timing().since(before)

    def flooded_alarm(self, name: str) -> str:
        """Text of the alarm that this input is flooded; empty: there is none."""
        texts = (one.text for one in self.client.alarms().alarms if one.cause == "input-flooded")
        return next((text for text in texts if text.startswith(f"Input {name}")), "")


def config_of(transport: str, count: int, base: int, ports: dict[str, int]) -> Config:
    raw = flying_config(count, base, silence_s=20.0).model_dump(mode="json")
    by_udp = [f"udpin://127.0.0.1:{base + at}" for at in range(count)]
    raw["links"][0] |= {
        "transport": transport,
        "listen": [*by_udp, f"tcpin://127.0.0.1:{ports['connection']}"],
        "ports": 1,
        "forward": [{"url": f"udp://127.0.0.1:{ports['station']}", "read_only": False}],
    }
    raw["rtk"] = {"source": f"udp://127.0.0.1:{ports['rtk']}"}
    raw["timecode"] = {"source": f"udp-midi://127.0.0.1:{ports['timecode']}"}
    sources = {
        "boat": {"kind": "nmea", "at": f"udp://127.0.0.1:{ports['target']}"},
        "anna": {"kind": "cot", "at": f"udp://127.0.0.1:{ports['track']}", "track": "ANNA"},
    }
    raw["targets"] = [{"name": name, "sources": [source]} for name, source in sources.items()]
    raw["scheduling"] = "real-time"  # as in operation: the machine's other work delays ticks less
    return Config.model_validate(raw)


@pytest.fixture(scope="module")
def flying(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Flying]:
    transport, count = request.param
    folder, base = tmp_path_factory.mktemp("flooded"), free_ports(count)
    ports = dict(zip(NAMES, range(free_ports(len(NAMES)), 1 << 16), strict=False))
    config, square = close_together(config_of(transport, count, base, ports))
    with ExitStack() as stack:
        stack.enter_context(vehicles(count, base, folder, "--telemetry-hz", "10", *square, *proper(config)))
        client, _ = stack.enter_context(service(config, folder / "record"))
        machine = stack.enter_context(Pauses())
        wait_passes(client)
        client.start()
        wait_until("running", SOON_S, lambda: client.show().phase == "running")
        yield Flying(client, config, ports | {"vehicles": base}, machine)


def rows() -> Iterator[object]:
    for transport in TRANSPORTS:
        for count in COUNTS:
            for row in ROWS:
                yield pytest.param((transport, count), row, id=f"{transport}-{count}-{row}")


@pytest.mark.soak
@pytest.mark.parametrize(("flying", "row"), list(rows()), indirect=["flying"])
def test_flooded_input_makes_no_tick_late(flying: Flying, row: str) -> None:
    name = row.partition("-")[0]
    far = ("far",) if name == "station" else ()
    usual = flying.watched(FLOOD_S)
    words = (row, str(flying.ports[name]), str(FLOOD_S), *far)
    command = [sys.executable, "-m", "tests.support.input_floods", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as flood:
        assert flood.stdout is not None
        flood.stdout.readline()
        before, began_s = flying.timing(), time.monotonic()
        wait_until("named", SOON_S, lambda: flying.flooded_alarm(NAMES[name]) != "")
        named_s = flying.machine.awake_s(began_s, time.monotonic())
        text = flying.flooded_alarm(NAMES[name])
        sent = int(flood.stdout.readline())
        ended_s = time.monotonic()
        during = flying.timing().since(before)
    assert sent > ROWS[row]().least_per_s * FLOOD_S, "the flood came"
    assert "a second from 127.0.0.1:" in text, text
    assert named_s < NAMED_S
    keep_time(usual, during, flying.config.tick_rate_hz, flying.machine.stalled_s(began_s, ended_s))
    assert flying.client.show().phase == "running"
    assert {one.phase for one in flying.client.vehicles()} == {"formation"}
