import asyncio
import socket
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from typing import TYPE_CHECKING, Any

import pytest
from link_bench import until
from machine import free_ports
from pymavlink.dialects.v20 import common as dialect

from gcs.errors import LinkError
from gcs.links.deadman import Deadman
from gcs.links.killlatch import KillLatch
from gcs.links.wire import Direction, Listen, Wire
from gcs.state import Mode

if TYPE_CHECKING:
    from gcs.links.mavlink_frames import Frame

pytestmark = pytest.mark.xdist_group("wire")

GROUND = dialect.MAVLink(None, srcSystem=245, srcComponent=190)


class Bench:
    """A wire and what it delivered."""

    def __init__(self, listen: Listen, system_ids: tuple[int, ...]) -> None:
        self.port = listen.first_port
        self.deadman = Deadman(0.2)
        self.delivered: list[Frame] = []
        self.wire = Wire(
            name="bench",
            system_ids=system_ids,
            listen=listen,
            deadman=self.deadman,
            latch=KillLatch(system_ids),
            clock=time.monotonic,
            deliver=self.delivered.append,
        )

    async def receive(self) -> None:
        while True:
            self.wire.receive()
            await asyncio.sleep(0.002)


@asynccontextmanager
async def bench(*system_ids: int, port_count: int = 1) -> AsyncIterator[Bench]:
    made = Bench(Listen("127.0.0.1", free_ports(port_count), port_count), system_ids)
    made.wire.open()
    receiving = asyncio.create_task(made.receive())
    try:
        yield made
    finally:
        receiving.cancel()
        made.wire.close()


def a_socket() -> closing[socket.socket]:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(("127.0.0.1", 0))
    made.setblocking(False)
    return closing(made)


def beat(system_id: int, autopilot: int = 12) -> bytes:
    packer = dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)
    return bytes(dialect.MAVLink_heartbeat_message(2, autopilot, 0x81, 6 << 16, 4, 3).pack(packer))


def packed(message: Any) -> bytes:
    return bytes(message.pack(GROUND))


def setpoint(target: int) -> bytes:
    return packed(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, target, 1, 1, 0x9C7, 0, 0, 0, 1.0, 2.0, 3.0, 0, 0, 0, 0, 0
        )
    )


def command(target: int) -> bytes:
    return packed(dialect.MAVLink_command_long_message(target, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))


async def arrived(sock: socket.socket) -> bytes:
    async with asyncio.timeout(30):
        return await asyncio.get_running_loop().sock_recv(sock, 2048)


def is_empty(sock: socket.socket) -> bool:
    try:
        sock.recv(2048)
    except BlockingIOError:
        return True
    return False


def address_of(sock: socket.socket) -> str:
    host, port = sock.getsockname()
    return f"{host}:{port}"


def test_a_frame_goes_to_its_target_only_and_one_for_everybody_to_all() -> None:
    async def main() -> None:
        async with bench(1, 2, port_count=2) as made:
            with a_socket() as one, a_socket() as two:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                two.sendto(beat(2), ("127.0.0.1", made.port + 1))
                await until(lambda: len(made.delivered) == 2)
                made.wire.send(command(2) + command(1))
                assert await arrived(two) == command(2)
                assert await arrived(one) == command(1)
                made.wire.send(beat(245))
                assert await arrived(one) == await arrived(two) == beat(245)
                assert is_empty(one)
                assert is_empty(two)

    asyncio.run(main())


def test_many_vehicles_behind_one_router_get_one_copy_of_what_is_for_everybody() -> None:
    async def main() -> None:
        async with bench(1, 2, 3) as made:
            with a_socket() as router:
                router.sendto(beat(1) + beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 2)
                made.wire.send(beat(245) + command(2) + command(3))
                assert [await arrived(router), await arrived(router)] == [beat(245), command(2)]
                assert is_empty(router)
                assert made.wire.counters.unroutable == 1

    asyncio.run(main())


def test_a_setpoint_leaves_only_with_permission_and_never_to_everybody() -> None:
    async def main() -> None:
        async with bench(1, 2) as made:
            with a_socket() as one:
                one.sendto(beat(1) + beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 2)
                made.wire.send(setpoint(1))
                made.deadman.refresh([1], time.monotonic() + 60.0)  # it does not expire before it is tried
                made.wire.send(setpoint(1) + setpoint(2) + setpoint(0))
                assert await arrived(one) == setpoint(1)
                made.deadman.refresh([1], time.monotonic() - 0.201)
                made.wire.send(setpoint(1))
                assert is_empty(one)
                counters = made.wire.counters
                assert (counters.setpoints_sent, counters.setpoints_dropped) == (1, 4)
                assert len(made.wire.setpoint_times_s(1)) == 1
                assert made.wire.setpoint_times_s(2) == ()

    asyncio.run(main())


def test_a_duplicate_system_id_is_dropped_and_both_addresses_are_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        async with bench(3) as made:
            with a_socket() as one, a_socket() as other:
                one.sendto(beat(3), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                for _ in range(5):
                    other.sendto(beat(3), ("127.0.0.1", made.port))
                await until(lambda: made.wire.counters.duplicates == 5)
                text = f"system id 3 at {address_of(one)} and at {address_of(other)}"
                assert made.wire.conflicts() == {3: text}
                assert len(made.delivered) == 1
                made.wire.send(command(3))
                assert await arrived(one) == command(3)
                assert is_empty(other)
                assert [
                    vars(record)["cause"] for record in caplog.records if record.msg == "duplicate_system_id"
                ] == [text]

    with caplog.at_level("INFO", logger="gcs.links.wire"):
        asyncio.run(main())


def test_strangers_and_garbage_are_counted_and_change_nothing(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as sender:
                for data in (
                    beat(255, autopilot=8),
                    beat(9),
                    beat(9),
                    b"",
                    b"\xfd",
                    bytes(300),
                    beat(1)[:-1],
                ):
                    sender.sendto(data, ("127.0.0.1", made.port))
                sender.sendto(beat(1), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                assert [frame.system_id for frame in made.delivered] == [1]
                assert made.wire.counters.strangers == 3
                assert made.wire.counters.garbage_bytes == 1 + 300 + len(beat(1)) - 1
                assert made.wire.heard[1].mode is Mode.OFFBOARD
                assert sum(record.msg == "stranger_ignored" for record in caplog.records) == 2

    with caplog.at_level("INFO", logger="gcs.links.wire"):
        asyncio.run(main())


def test_a_port_in_use_is_named_and_no_other_stays_open() -> None:
    async def main() -> None:
        port = free_ports(2)
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
            taken.bind(("127.0.0.1", port + 1))
            with pytest.raises(LinkError, match=f"UDP port {port + 1} on 127.0.0.1"):
                Bench(Listen("127.0.0.1", port, 2), (1,)).wire.open()
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
            free.bind(("127.0.0.1", port))

    asyncio.run(main())


@pytest.mark.parametrize("listen", [Listen("256.0.0.1", 14540), Listen("127.0.0.1", 65535, 2)])
def test_an_address_that_cannot_be_is_a_link_error(listen: Listen) -> None:
    async def main() -> None:
        with pytest.raises(LinkError, match="UDP port"):
            Bench(listen, (1,)).wire.open()

    asyncio.run(main())


def test_a_vehicle_whose_port_is_closed_does_not_disturb_the_others() -> None:
    async def main() -> None:
        async with bench(1, 2) as made:
            with a_socket() as living:
                with a_socket() as dying:
                    dying.sendto(beat(1), ("127.0.0.1", made.port))
                    living.sendto(beat(2), ("127.0.0.1", made.port))
                    await until(lambda: len(made.delivered) == 2)
                for _ in range(3):
                    made.wire.send(command(1) + command(2))
                    assert await arrived(living) == command(2)
                living.sendto(beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 3)

    asyncio.run(main())


def test_observers_see_every_frame_that_passed_and_no_other() -> None:
    async def main() -> None:
        async with bench(1) as made:
            seen: list[tuple[Direction, bytes, int]] = []
            made.wire.observers = (lambda _time_s, way, data, system_id: seen.append((way, data, system_id)),)
            with a_socket() as one:
                one.sendto(beat(1) + beat(9), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                made.wire.send(setpoint(1) + command(1))
            assert seen == [(Direction.RECEIVED, beat(1), 1), (Direction.SENT, command(1), 1)]

    asyncio.run(main())


def test_what_waited_in_the_socket_is_as_old_as_it_is() -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as one:
                before_s = time.monotonic()
                one.sendto(beat(1), ("127.0.0.1", made.port))
                after_s = time.monotonic()
                time.sleep(0.2)  # noqa: ASYNC251  a stalled loop is the subject
                await until(lambda: made.delivered)
                assert before_s - 0.05 < made.wire.heard[1].heartbeat_time_s < after_s + 0.05

    asyncio.run(main())


def test_a_closed_wire_sends_nothing_and_says_nothing() -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as one:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                made.wire.close()
                made.wire.send(command(1))
                assert is_empty(one)

    asyncio.run(main())
