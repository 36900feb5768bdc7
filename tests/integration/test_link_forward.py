"""Further ground stations: what they see, and what they may say."""

import asyncio
import socket
import time
from contextlib import closing
from typing import Any

from pymavlink.dialects.v20 import common as dialect

from gcs.links.settings import Forward
from tests.support.link_bench import until
from tests.support.wire_bench import Bench, a_socket, arrived, beat, bench, command, is_empty, setpoint


def to(station: socket.socket, *, read_only: bool) -> Forward:
    return Forward(url=f"udp://127.0.0.1:{station.getsockname()[1]}", read_only=read_only)


def packed_by(message: Any, system_id: int = 255) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system_id, srcComponent=190)))


def arm(target: int, system_id: int = 255) -> bytes:
    return packed_by(dialect.MAVLink_command_long_message(target, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0), system_id)


async def introduced(made: Bench, vehicle: socket.socket, station: socket.socket) -> tuple[str, int]:
    """A vehicle has been received, and the station has seen it. Returns: where the station may answer."""
    vehicle.sendto(beat(1), ("127.0.0.1", made.port))
    async with asyncio.timeout(120):
        data, ground = await asyncio.get_running_loop().sock_recvfrom(station, 2048)
    assert data == beat(1)
    address: tuple[str, int] = ground
    return "127.0.0.1", address[1]


def test_read_only_station_receives_vehicles_and_sends_nothing() -> None:
    async def main() -> None:
        with a_socket() as vehicle, a_socket() as station:
            async with bench(1, forward=[to(station, read_only=True)]) as made:
                ground = await introduced(made, vehicle, station)
                vehicle.sendto(beat(9) + beat(1) * 2, ("127.0.0.1", made.port))
                assert await arrived(station) == beat(1) * 2, "strangers are not shown, datagrams are shared"
                station.sendto(arm(1), ground)
                await asyncio.sleep(0.1)
                assert is_empty(vehicle)
                assert made.counters.forwarded == 3
                assert made.counters.taken_from_others == 0

    asyncio.run(main())


def test_answering_station_reaches_only_the_vehicle_it_targets() -> None:
    async def main() -> None:
        with a_socket() as vehicle, a_socket() as station, a_socket() as intruder:
            async with bench(1, forward=[to(station, read_only=False)]) as made:
                ground = await introduced(made, vehicle, station)
                manual = packed_by(dialect.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0))
                for refused in (beat(255, 8), setpoint(1), manual, arm(0), arm(7), arm(1, 1), arm(1, 254)):
                    station.sendto(refused, ground)
                intruder.sendto(arm(1), ground)
                station.sendto(arm(1), ground)
                assert await arrived(vehicle) == arm(1)
                await until(lambda: made.counters.refused_from_others == 7)
                assert is_empty(vehicle)
                assert made.counters.taken_from_others == 1

    asyncio.run(main())


def test_kill_latch_holds_for_other_stations() -> None:
    async def main() -> None:
        with a_socket() as vehicle, a_socket() as station:
            async with bench(1, forward=[to(station, read_only=False)]) as made:
                ground = await introduced(made, vehicle, station)
                made.latch.shut(1)
                station.sendto(arm(1), ground)
                await until(lambda: made.counters.refused_from_others == 1)
                assert made.counters.commands_dropped == 1
                assert is_empty(vehicle)

    asyncio.run(main())


def test_dead_station_delays_no_other() -> None:
    async def main() -> None:
        with a_socket() as vehicle:
            with a_socket() as station:
                gone = to(station, read_only=False)
            async with bench(1, forward=[gone]) as made:
                for _ in range(200):
                    vehicle.sendto(beat(1), ("127.0.0.1", made.port))
                    await asyncio.sleep(0.001)
                await until(lambda: len(made.delivered) == 200)
                made.send(command(1))
                assert await arrived(vehicle) == command(1)
                counters = made.counters
                assert counters.forwarded + counters.not_forwarded == 200

    asyncio.run(main())


def test_flood_from_a_station_is_received_in_portions() -> None:
    async def main() -> None:
        with a_socket() as vehicle, closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as station:
            station.bind(("127.0.0.1", 0))
            station.setblocking(False)
            async with bench(1, forward=[to(station, read_only=False)]) as made:
                ground = await introduced(made, vehicle, station)
                for _ in range(100):
                    station.sendto(b"\xfe" * 60000, ground)
                began_s = time.thread_time()
                made.receive()
                assert time.thread_time() - began_s < 0.5

    asyncio.run(main())
