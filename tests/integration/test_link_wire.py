import asyncio
import socket
import time
from contextlib import closing

import pytest

from gcs.links.framed.router import Direction, Listen, Router
from gcs.links.kill_latch import KillLatch
from gcs.links.setpoint_watchdog import SetpointWatchdog
from gcs.model.errors import LinkError
from gcs.model.state import Mode
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
    setpoint,
)


def test_frame_goes_to_its_target_and_broadcast_to_all() -> None:
    async def main() -> None:
        async with bench(1, 2, port_count=2) as made:
            with a_socket() as one, a_socket() as two:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                two.sendto(beat(2), ("127.0.0.1", made.port + 1))
                await until(lambda: len(made.delivered) == 2)
                made.router.send(command(2) + command(1))
                assert await arrived(two) == command(2)
                assert await arrived(one) == command(1)
                made.router.send(beat(245))
                assert await arrived(one) == await arrived(two) == beat(245)
                assert is_empty(one)
                assert is_empty(two)

    asyncio.run(main())


def test_flooded_port_delays_neither_the_loop_nor_the_others() -> None:
    now_s = 0.0

    def slow_clock() -> float:  # as if every frame cost a millisecond
        nonlocal now_s
        now_s += 0.001
        return now_s

    delivered: list[int] = []
    port = free_ports(2)
    router = Router(
        name="bench",
        system_ids=(1, 2),
        listen=Listen("127.0.0.1", port, 2),
        setpoint_watchdog=SetpointWatchdog(0.18),
        latch=KillLatch((1, 2)),
        clock=slow_clock,
        deliver=lambda frame: delivered.append(frame.system_id),
    )
    router.open()
    with closing(router), a_socket() as flood, a_socket() as other:
        for _ in range(200):
            flood.sendto(beat(1), ("127.0.0.1", port))
        other.sendto(beat(2), ("127.0.0.1", port + 1))
        router.receive()
        assert delivered.count(2) == 1
        assert 1 <= delivered.count(1) <= 12, "half of 20 ms"
        for _ in range(40):
            router.receive()
        assert delivered.count(1) == 200, "nothing is lost"


def test_vehicles_behind_one_router_get_one_broadcast_copy() -> None:
    async def main() -> None:
        async with bench(1, 2, 3) as made:
            with a_socket() as router:
                router.sendto(beat(1) + beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 2)
                made.router.send(beat(245) + command(2) + command(3))
                assert [await arrived(router), await arrived(router)] == [beat(245), command(2)]
                assert is_empty(router)
                assert made.router.counters.unroutable == 1

    asyncio.run(main())


def test_setpoint_leaves_only_with_permission_and_one_target() -> None:
    async def main() -> None:
        async with bench(1, 2) as made:
            with a_socket() as one:
                one.sendto(beat(1) + beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 2)
                made.router.send(setpoint(1))
                made.setpoint_watchdog.refresh(
                    [1], time.monotonic() + 60.0
                )  # it does not expire before it is tried
                made.router.send(setpoint(1) + setpoint(2) + setpoint(0))
                assert await arrived(one) == setpoint(1)
                made.setpoint_watchdog.refresh([1], time.monotonic() - 0.201)
                made.router.send(setpoint(1))
                assert is_empty(one)
                counters = made.router.counters
                assert (counters.setpoints_sent, counters.setpoints_dropped) == (1, 4)
                assert len(made.router.setpoint_times_s(1)) == 1
                assert made.router.setpoint_times_s(2) == ()

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
                await until(lambda: made.router.counters.duplicates == 5)
                text = f"system id 3 at {address_of(one)} and at {address_of(other)}"
                assert made.router.conflicts() == {3: text}
                assert len(made.delivered) == 1
                made.router.send(command(3))
                assert await arrived(one) == command(3)
                assert is_empty(other)
                assert [
                    vars(record)["cause"] for record in caplog.records if record.msg == "duplicate_system_id"
                ] == [text]

    with caplog.at_level("INFO", logger="gcs.links.framed.router"):
        asyncio.run(main())


def test_unknown_senders_and_garbage_are_counted_only(caplog: pytest.LogCaptureFixture) -> None:
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
                assert made.router.counters.strangers == 3
                assert made.router.counters.garbage_bytes == 1 + 300 + len(beat(1)) - 1
                assert made.router.telemetry[1].mode is Mode.OFFBOARD
                assert sum(record.msg == "stranger_ignored" for record in caplog.records) == 2

    with caplog.at_level("INFO", logger="gcs.links.framed.router"):
        asyncio.run(main())


def test_a_port_in_use_is_named_and_no_other_stays_open() -> None:
    async def main() -> None:
        port = free_ports(2)
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
            taken.bind(("127.0.0.1", port + 1))
            with pytest.raises(LinkError, match=f"UDP port {port + 1} on 127.0.0.1"):
                Bench(Listen("127.0.0.1", port, 2), (1,)).router.open()
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
            free.bind(("127.0.0.1", port))

    asyncio.run(main())


@pytest.mark.parametrize("listen", [Listen("256.0.0.1", 14540), Listen("127.0.0.1", 65535, 2)])
def test_impossible_address_is_a_link_error(listen: Listen) -> None:
    async def main() -> None:
        with pytest.raises(LinkError, match="UDP port"):
            Bench(listen, (1,)).router.open()

    asyncio.run(main())


def test_vehicle_with_a_closed_port_does_not_disturb_others() -> None:
    async def main() -> None:
        async with bench(1, 2) as made:
            with a_socket() as living:
                with a_socket() as dying:
                    dying.sendto(beat(1), ("127.0.0.1", made.port))
                    living.sendto(beat(2), ("127.0.0.1", made.port))
                    await until(lambda: len(made.delivered) == 2)
                for _ in range(3):
                    made.router.send(command(1) + command(2))
                    assert await arrived(living) == command(2)
                living.sendto(beat(2), ("127.0.0.1", made.port))
                await until(lambda: len(made.delivered) == 3)

    asyncio.run(main())


def test_observers_receive_exactly_the_delivered_frames() -> None:
    async def main() -> None:
        async with bench(1) as made:
            seen: list[tuple[Direction, bytes, int]] = []
            made.router.observers = (
                lambda _time_s, way, data, system_id: seen.append((way, data, system_id)),
            )
            with a_socket() as one:
                one.sendto(beat(1) + beat(9), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                made.router.send(setpoint(1) + command(1))
            assert seen == [(Direction.RECEIVED, beat(1), 1), (Direction.SENT, command(1), 1)]

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
                assert before_s - 1.0 < made.router.telemetry[1].heartbeat_time_s < after_s + 0.05

    asyncio.run(main())


def test_closed_router_sends_and_logs_nothing() -> None:
    async def main() -> None:
        async with bench(1) as made:
            with a_socket() as one:
                one.sendto(beat(1), ("127.0.0.1", made.port))
                await until(lambda: made.delivered)
                made.router.close()
                made.router.send(command(1))
                assert is_empty(one)

    asyncio.run(main())
