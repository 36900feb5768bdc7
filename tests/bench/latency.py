"""From measurement to motor, as far as it is ours: how old the position is when its setpoint leaves.

`python -m tests.bench.latency` flies a few fake vehicles in formation, over MAVSDK and over the native
transport, and prints the latency budget of docs/latency.md; `... native 50` measures one row.
"""

import asyncio
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import yaml

from gcs.cli.service.serve import make_link
from gcs.config.schema import Config, parse
from gcs.flight.orchestrator import Orchestrator
from gcs.links.link import FrameDirection
from gcs.mavlink.framing import GLOBAL_POSITION_INT, SET_POSITION_TARGET_LOCAL_NED
from gcs.model.lifecycle import ShowPhase
from gcs.preflight.parameters import settings_of
from gcs.service import ShowAction, TickView
from gcs.sim.cli import parameter_options
from gcs.testing.views import vehicles_of

FIRST_PORT = 15900
MEASURED_S = 20.0
SOON_S = 120.0
SPEED_M_S = 5.0
"""The fastest that the law flies."""


def config_of(transport: str, count: int) -> Config:
    """The demo's field, a port for each vehicle."""
    raw = {
        "show_frame": {"latitude_deg": 47.397742, "longitude_deg": 8.545594, "altitude_amsl_m": 488.0},
        "links": [
            {
                "name": "bench",
                "transport": transport,
                "listen": f"udpin://127.0.0.1:{FIRST_PORT}",
                "ports": count,
                "vehicles": {"count": count},
            }
        ],
        "formation": {"radius_m": 12.0, "height_m": 20.0},
        "operation": {"takeoff_stagger_s": 0.2, "silence_s": 20.0},
    }
    return parse(yaml.safe_dump(raw), "bench")


@contextmanager
def fleet(config: Config) -> Iterator[None]:
    """Fake vehicles in a process of their own, with the parameters that the configuration asks for."""
    options = parameter_options(settings_of(config))
    command = [
        sys.executable,
        "-m",
        "gcs.sim",
        "--count",
        str(len(config.ids)),
        "--port-base",
        str(FIRST_PORT),
        "--ideal",
    ]
    process = subprocess.Popen([*command, *options], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(30)


class Passing:
    """Notes when which vehicle's positions came, and when its setpoints left."""

    def __init__(self) -> None:
        self.came_s: dict[int, list[float]] = {}
        self.left_s: dict[int, list[float]] = {}

    def see(self, time_s: float, direction: FrameDirection, raw: bytes, system_id: int) -> None:
        """An `Observer`."""
        message_id = int.from_bytes(raw[7:10], "little")
        if direction is FrameDirection.RECEIVED and message_id == GLOBAL_POSITION_INT:
            self.came_s.setdefault(system_id, []).append(time_s)
        elif direction is FrameDirection.SENT and message_id == SET_POSITION_TARGET_LOCAL_NED:
            self.left_s.setdefault(system_id, []).append(time_s)

    def ages_ms(self) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        """Of the newest position, at the moment when a setpoint leaves."""
        ages = []
        for system_id, left in self.left_s.items():
            came_s, left_s = np.array(self.came_s[system_id]), np.array(left)
            newest = np.searchsorted(came_s, left_s, side="right") - 1
            ages.append((left_s - came_s[newest])[newest >= 0])
        return np.concatenate(ages) * 1e3


async def reached(what: str, holds: Callable[[], bool]) -> None:
    """Poll `holds()`. Raises: TimeoutError."""
    end_s = time.monotonic() + SOON_S
    while not holds():
        if time.monotonic() > end_s:
            raise TimeoutError(what)
        await asyncio.sleep(0.1)


async def measure(config: Config) -> tuple[Passing, TickView]:
    """Fly, and watch for a while."""
    link = make_link(config.links[0], config)
    orchestrator = Orchestrator(config, [link])
    view = orchestrator.view
    control = asyncio.create_task(orchestrator.run())
    await reached("ready", lambda: all(vehicle.ready for vehicle in vehicles_of(view.value)))
    orchestrator.commands.command_show(ShowAction.START)
    await reached("running", lambda: view.value.show is ShowPhase.RUNNING)
    passing = Passing()
    stop = link.observe(passing.see)
    await asyncio.sleep(MEASURED_S)
    stop()
    seen = view.value.tick
    control.cancel()
    await asyncio.wait([control])
    return passing, seen


def row(transport: str, count: int) -> None:
    """Measure, and print one row."""
    config = config_of(transport, count)
    with fleet(config):
        passing, tick = asyncio.run(measure(config))
    ages_ms = passing.ages_ms()
    p50_ms, p99_ms = np.percentile(ages_ms, (50, 99))
    figures = f"{p50_ms:>10.0f}{p99_ms:>10.0f}{tick.duration_p99_ms:>10.1f}{tick.lateness_p99_ms:>10.1f}"
    flown_m = f"{p50_ms * 1e-3 * SPEED_M_S:>10.2f}{p99_ms * 1e-3 * SPEED_M_S:>10.2f}"
    print(f"{transport:<10}{count:>5}{figures}{flown_m}", flush=True)


def main(desired: list[str]) -> None:
    """All, or the row asked for."""
    heads = ("age p50", "age p99", "tick p99", "late p99", "m p50", "m p99")
    print(f"{'':<10}{'N':>5}" + "".join(f"{head:>10}" for head in heads) + "   (ms; metres at 5 m/s)")
    for transport, count in [(desired[0], int(desired[1]))] if desired else [("mavsdk", 8), ("native", 8)]:
        row(transport, count)


if __name__ == "__main__":
    main(sys.argv[1:])
