"""What tracks for TAK cost: `python -m tests.bench.tak`. 1,000 vehicles to a UDP and a TCP receiver, 20 Hz.

Beside it the same tracks that come back to a source of traffic, with and without being known as own ones.
"""

import asyncio
import socket
import time
from contextlib import suppress

import numpy as np

from gcs.control import Memory
from gcs.flight.features.tak import TakTracks
from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links.targets.cot import CotTraffic
from gcs.model.state import FleetState
from gcs.testing.virtual_show import show_config
from tests.support.reported import reported

VEHICLES, PER_LINK, TICKS, SECONDS = 1000, 250, 20, 10


def newest_of(ids: tuple[str, ...]) -> Newest:
    n = len(ids)
    newest, position_m = Newest(), np.arange(3.0 * n).reshape(n, 3) % 97.0
    newest.state = FleetState(0.0, ids, position_m, np.ones((n, 3)), np.zeros(n), np.zeros(n))
    newest.telemetry = reported(
        ids, horizontal_accuracy_m=np.ones(n), vertical_accuracy_m=np.ones(n), battery_remaining=np.ones(n)
    )
    newest.memory, newest.silent = Memory.fresh(n, 0.0), np.zeros(n, np.bool_)
    return newest


async def drained(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
    with suppress(asyncio.CancelledError):
        while not reader.at_eof():
            await reader.read(1 << 20)


async def main() -> None:
    links = [
        {
            "name": name,
            "transport": "native",
            "listen": f"udpin://127.0.0.1:{14540 + at}",
            "vehicles": {"count": PER_LINK, "id_pattern": "{link}-{system_id}"},
        }
        for at, name in enumerate("abcd")
    ]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.setblocking(False)
        server = await asyncio.start_server(drained, "127.0.0.1", 0)
        to = [
            f"udp://127.0.0.1:{opened.getsockname()[1]}",
            f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}",
        ]
        config = show_config(1, links=links, tak={"to": to, "callsign": "SHOW", "geoid_m": 47.0})
        newest = newest_of(config.ids)
        vehicles = FlightVehicles(Vehicle(name, row, 1, "a") for row, name in enumerate(config.ids))
        own = np.ones(VEHICLES, np.bool_)
        tak = TakTracks(config, newest, vehicles, lambda: own, lambda: True, time.time, lambda: 0.0)
        receiving = asyncio.create_task(tak.receive())
        await asyncio.sleep(0.5)
        spent_ms, events = [], []
        for tick in range(TICKS * SECONDS):
            state = newest.state
            newest.state = FleetState(
                tick / TICKS, state.ids, state.position_m, state.velocity_m_s, state.yaw_rad, state.age_s
            )
            begin_s = time.process_time()
            tak.send()
            spent_ms.append(1e3 * (time.process_time() - begin_s))
            try:
                while True:
                    events.append(opened.recv(65535))
            except BlockingIOError:
                await asyncio.sleep(0.001)
        receiving.cancel()
    sent = [(sender.at[:3], sender.sent, sender.dropped) for sender in tak.senders]
    print(f"{sent}; a tick {np.median(spent_ms):.2f} ms, at most {max(spent_ms):.2f} ms")
    print(f"a second {sum(spent_ms) / SECONDS:.1f} ms, {len(events[0])} bytes an event")
    second = events[:VEHICLES]
    for uid in (config.own_tracks.uid, ""):
        stream = CotTraffic(47.0, uid)
        begin_s = time.process_time()
        fixes = sum(len(stream.take(event, 0.0)) for event in second)
        print(f"{len(second)} that come back: {fixes} fixes, {1e3 * (time.process_time() - begin_s):.1f} ms")


if __name__ == "__main__":
    asyncio.run(main())
