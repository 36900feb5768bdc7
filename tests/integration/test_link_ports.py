"""Where frames go: to their target's newest address, once to each address for all; floods and garbage."""

import asyncio
import socket
import time
from contextlib import closing

import pytest

from gcs.links.endpoints.ports import Datagrams
from gcs.links.endpoints.streams import LinkPorts
from gcs.links.settings import Listen, Place, TcpIn
from gcs.model.errors import LinkError
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.wire_bench import (
    Bench,
    a_socket,
    address_of,
    arrived,
    beat,
    bench,
    command,
    is_empty,
    is_our_heartbeat,
)


def test_frame_goes_to_its_target_and_broadcast_to_all() -> None:
    async def main() -> None:
        async with bench(1, 2, port_count=2) as made:
            with a_socket() as one, a_socket() as two:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                two.sendto(beat(2), ("127.0.0.1", made.port + 1))
                await until(lambda: len(made.delivered) == 2)
                made.send(command(2) + command(1))
                assert await arrived(two) == command(2)
                assert await arrived(one) == command(1)
                made.broadcast()
                assert is_our_heartbeat(await arrived(one))
                assert is_our_heartbeat(await arrived(two))
                assert is_empty(one)
                assert is_empty(two)

    asyncio.run(main())


def test_flooded_port_delays_neither_the_loop_nor_the_others() -> None:
    now_s = 0.0

    def slow_clock() -> float:  # as if every batch cost six milliseconds
        nonlocal now_s
        now_s += 0.006
        return now_s

    came: list[int] = []

    def take(arrived: Datagrams) -> None:
        came.extend((arrived.source >> 48).tolist())

    port = free_ports(2)
    ports = LinkPorts("bench", Listen("127.0.0.1", port, 2), slow_clock)
    ports.open()
    with closing(ports), a_socket() as flood, a_socket() as other:
        for _ in range(2000):
            flood.sendto(beat(1), ("127.0.0.1", port))
        other.sendto(beat(2), ("127.0.0.1", port + 1))
        ports.receive(take)
        assert came.count(1) == 1
        assert 1 <= came.count(0) <= 768, "half of 20 ms"
        for _ in range(40):
            ports.receive(take)
        assert came.count(0) == 2000, "nothing is lost"


def test_vehicles_behind_one_router_get_one_broadcast_copy() -> None:
    async def main() -> None:
        async with bench(1, 2, 3) as made:
            with a_socket() as router:
                router.sendto(beat(1) + beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 2)
                made.broadcast()
                made.send(command(2) + command(3))
                assert is_our_heartbeat(await arrived(router))
                assert await arrived(router) == command(2)
                assert is_empty(router)
                assert made.counters.unroutable == 1

    asyncio.run(main())


def test_duplicate_system_id_is_dropped_naming_both_addresses(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        async with bench(3) as made:
            with a_socket() as one, a_socket() as other:
                one.sendto(beat(3), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                for _ in range(5):
                    other.sendto(beat(3), ("127.0.0.1", made.port))
                await until(lambda: made.counters.duplicates == 5)
                text = f"system id 3 at {address_of(one)} and at {address_of(other)}"
                assert made.link.conflicts == {"v3": text}
                assert len(made.delivered) == 1
                made.send(command(3))
                assert await arrived(one) == command(3)
                assert is_empty(other)
                causes = [vars(each)["cause"] for each in caplog.records if each.msg == "duplicate_system_id"]
                assert causes == [text]

    asyncio.run(main())


def test_unknown_senders_and_garbage_are_counted_only(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as sender:
                strangers = (beat(255, autopilot=8), beat(9), beat(9))
                for data in (*strangers, b"", b"\xfd", bytes(300), beat(1)[:-1], beat(1)):
                    sender.sendto(data, ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                assert [frame.system_id for frame in made.delivered] == [1]
                assert made.counters.strangers == 3
                assert made.counters.garbage_bytes == 1 + 300 + len(beat(1)) - 1
                assert sum(record.msg == "stranger_ignored" for record in caplog.records) == 2

    with caplog.at_level("INFO", logger="gcs.links.address_book"):
        asyncio.run(main())


@pytest.mark.parametrize("listen", [Listen("256.0.0.1", 14540), Listen("127.0.0.1", 65535, 2)])
def test_impossible_address_is_a_link_error(listen: Listen) -> None:
    with pytest.raises(LinkError, match="UDP port"):
        Bench(listen, (1,)).open()


def test_vehicle_with_a_closed_port_does_not_disturb_others() -> None:
    async def main() -> None:
        async with bench(1, 2) as made:
            with a_socket() as living:
                with a_socket() as dying:
                    dying.sendto(beat(1), ("127.0.0.1", made.port))
                    living.sendto(beat(2), ("127.0.0.1", made.port))
                    await until(lambda: len(made.delivered) == 2)
                for _ in range(3):
                    made.send(command(1) + command(2))
                    assert await arrived(living) == command(2)
                living.sendto(beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 3)

    asyncio.run(main())


def test_frame_delayed_in_the_socket_keeps_its_arrival_time() -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as one:
                before_s = time.monotonic()
                one.sendto(beat(1), ("127.0.0.1", made.port))
                after_s = time.monotonic()
                time.sleep(0.2)  # noqa: ASYNC251  a stalled loop is the subject
                await until(lambda: made.delivered)
                # older where the machine pauses between two clocks
                assert before_s - 1.0 < made.link.snapshot().heartbeat_time_s[0] < after_s + 0.05

    asyncio.run(main())


def test_closed_link_sends_nothing() -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as one:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                made.close()
                made.send(command(1))
                assert is_empty(one)

    asyncio.run(main())


def test_several_kinds_of_ports_serve_one_link() -> None:
    """UDP ports and a TCP port: each vehicle is reached where it was received."""

    async def main() -> None:
        tcp_port, udp_port = free_ports(), free_ports()
        places: list[Place] = [TcpIn("127.0.0.1", tcp_port), Listen("127.0.0.1", udp_port)]
        async with bench(1, 2, listen=places) as made:
            with a_socket() as one, closing(socket.create_connection(("127.0.0.1", tcp_port))) as two:
                two.setblocking(False)
                one.sendto(beat(1), ("127.0.0.1", udp_port))
                two.sendall(beat(2))
                await until(lambda: len(made.delivered) == 2)
                made.send(command(2) + command(1))
                assert await arrived(one) == command(1)
                assert await arrived(two) == command(2)

    asyncio.run(main())
