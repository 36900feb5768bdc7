"""Floods over real sockets, and streams that arrive in pieces: what the other vehicles send is received."""

import asyncio
import socket
import time
from contextlib import closing
from functools import partial
from itertools import pairwise

import pytest

from gcs.links.settings import TcpIn
from gcs.mavlink.codec import split
from tests.support.floods import FLOODS, cut, flood, frames, heartbeat, position
from tests.support.link_bench import Ticks, a_link, ready, running, until
from tests.support.link_peer import Peer
from tests.support.machine import Pauses, free_ports
from tests.support.wire_bench import Bench, a_socket, address_of, beat, bench

FLOOD_S, PER_S = 3.0, 3000.0
LONGEST_GAP_S = 0.5


@pytest.mark.alternates(0)
@pytest.mark.usefixtures("transport")
@pytest.mark.parametrize("kind", ["heartbeats", "texts", "parameters"])
def test_a_vehicle_that_floods_costs_no_other_its_setpoints(kind: str) -> None:
    async def main(flooding: Peer, other: Peer, machine: Pauses) -> None:
        link = a_link(port, [1, 2])
        async with running(link):
            await ready(link)
            ticks = Ticks(link, "v1", "v2")
            async with ticks.running():
                await until(lambda: link.setpoint_times_s("v2"))
                datagrams = FLOODS[kind]([1])
                began_s = time.monotonic()
                sending = asyncio.to_thread(flood, flooding.send_bytes, datagrams, PER_S, FLOOD_S)
                flooded = asyncio.create_task(sending)
                (intake,) = link.counters.intakes
                await until(lambda: f"from 127.0.0.1:{flooding.port}" in intake.why_over(time.monotonic()))
                assert machine.awake_s(began_s, time.monotonic()) < 2.0
                await flooded
                ended_s = time.monotonic()
        arrived_s = [
            at for at, _ in other.messages("SET_POSITION_TARGET_LOCAL_NED") if began_s < at < ended_s
        ]
        ticked = sum(began_s < at < ended_s for at in ticks.times_s)
        assert len(arrived_s) >= 0.9 * ticked
        assert ticked >= 10.0 * machine.awake_s(began_s, ended_s)
        assert max(machine.awake_s(*pair) for pair in pairwise(arrived_s)) < LONGEST_GAP_S

    port = free_ports()
    with Peer(port, 1) as flooding, Peer(port, 2) as other, Pauses() as machine:
        asyncio.run(main(flooding, other, machine))


@pytest.mark.parametrize("size", [1, 32, 37, 250, 1400])
def test_a_stream_over_udp_is_read_however_it_is_cut(size: int) -> None:
    stream = b"".join(frames(position, [1])[:3])
    sent = [frame.raw for frame in split(stream).frames]

    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as bridge:
                bridge.sendto(beat(1), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                for at, piece in enumerate(cut([stream], size)):
                    bridge.sendto(piece, ("127.0.0.1", made.port))
                    if at % 100 == 99:
                        await asyncio.sleep(0.02)
                await until(lambda: len(made.delivered) == 1 + len(sent), 20.0)
                assert [frame.raw for frame in made.delivered[1:]] == sent

    asyncio.run(main())


def test_a_flooded_connection_keeps_no_other_out() -> None:
    """TCP: as much is written as the flooded side accepts."""

    def write(flooding: socket.socket, data: bytes) -> None:
        try:
            while flooding.send(data):
                pass
        except BlockingIOError:
            return

    async def main() -> None:
        port = free_ports()
        async with bench(1, 2, listen=TcpIn("127.0.0.1", port)) as made:
            connect = partial(socket.create_connection, ("127.0.0.1", port))
            with closing(connect()) as flooding, closing(connect()) as other:
                flooding.setblocking(False)
                data = b"".join(frames(heartbeat, [1]))
                for turn in range(1, 41):
                    write(flooding, data)
                    other.sendall(beat(2))
                    await until(partial(has, made, 2, turn), 20.0)
                assert address_of(flooding) in made.counters.intakes[0].why_over(time.monotonic())

    def has(made: Bench, system_id: int, count: int) -> bool:
        return sum(frame.system_id == system_id for frame in made.delivered) == count

    asyncio.run(main())
