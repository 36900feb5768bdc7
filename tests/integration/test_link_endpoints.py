"""UDP out, TCP and serial: reached, lost, found again; frames cut in two; nothing ever waits."""

import asyncio
import socket
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from gcs.links.endpoints import channels, streams
from gcs.links.settings import SerialPort, TcpIn, TcpOut, UdpOut
from gcs.model.errors import LinkError
from tests.support.link_bench import until
from tests.support.link_lines import Cable
from tests.support.machine import free_ports
from tests.support.wire_bench import a_socket, arrived, beat, bench, command, is_our_heartbeat, setpoint

ROOM_BYTES = 4096


def free_tcp_port() -> int:
    port: int = free_ports()
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", port))
    return port


def listening(port: int) -> socket.socket:
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    made.bind(("127.0.0.1", port))
    made.listen()
    made.setblocking(False)
    return made


async def accepted(listener: socket.socket) -> socket.socket:
    async with asyncio.timeout(120):
        connection, _ = await asyncio.get_running_loop().sock_accept(listener)
    return connection


async def connected(port: int, room_bytes: int | None = None) -> socket.socket:
    made = socket.socket()
    if room_bytes is not None:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, room_bytes)
    made.setblocking(False)
    async with asyncio.timeout(120):
        await asyncio.get_running_loop().sock_connect(made, ("127.0.0.1", port))
    return made


async def received(sock: socket.socket, size: int) -> bytes:
    """That many bytes."""
    data = b""
    async with asyncio.timeout(120):
        while len(data) < size:
            data += await asyncio.get_running_loop().sock_recv(sock, size - len(data))
    return data


def test_udp_out_sends_first_and_accepts_only_its_peer() -> None:
    async def main() -> None:
        with a_socket() as vehicle, a_socket() as other:
            place = UdpOut("127.0.0.1", vehicle.getsockname()[1])
            async with bench(1, listen=place) as made:
                made.broadcast()
                async with asyncio.timeout(120):
                    data, ground = await asyncio.get_running_loop().sock_recvfrom(vehicle, 2048)
                assert is_our_heartbeat(data)
                other.sendto(beat(1), ground)
                vehicle.sendto(beat(1), ground)
                await until(lambda: made.delivered)
                made.send(command(1))
                made.broadcast()
                assert await arrived(vehicle) == command(1)
                assert is_our_heartbeat(await arrived(vehicle))
                assert len(made.delivered) == 1

    asyncio.run(main())


def test_tcp_client_connects_whenever_its_server_appears() -> None:
    async def main() -> None:
        port = free_tcp_port()
        async with bench(1, listen=TcpOut("127.0.0.1", port)) as made:
            made.send(command(1))
            await asyncio.sleep(0.1)
            for turn in range(1, 3):
                with closing(listening(port)) as listener, closing(await accepted(listener)) as vehicle:
                    vehicle.send(beat(1))
                    await until(lambda: made.address(1) is not None)
                    assert len(made.delivered) == turn
                    made.send(command(1))
                    assert await received(vehicle, len(command(1))) == command(1)
                await until(lambda: made.address(1) is None)

    asyncio.run(main())


def test_frame_split_anywhere_is_reassembled() -> None:
    async def main() -> None:
        port = free_tcp_port()
        async with bench(1, 2, listen=TcpIn("127.0.0.1", port)) as made:
            with closing(await connected(port)) as vehicle:
                data = b"\x00\xfd" + beat(1) + beat(2) + b"\xfe\x09" + beat(1)
                for byte in data:
                    vehicle.send(bytes((byte,)))
                    made.receive()
                vehicle.send(bytes(300))  # what looks like a beginning is one until it cannot be any more
                await until(lambda: len(made.delivered) == 3)
                assert [frame.system_id for frame in made.delivered] == [1, 2, 1]
                assert made.counters.garbage_bytes >= 4

    asyncio.run(main())


def test_tcp_server_serves_several_and_reconnecting_vehicles() -> None:
    async def main() -> None:
        port = free_tcp_port()
        async with bench(1, 2, listen=TcpIn("127.0.0.1", port)) as made:
            with closing(await connected(port)) as staying:
                staying.send(beat(2))
                with closing(await connected(port)) as going:
                    going.send(beat(1))
                    await until(lambda: len(made.delivered) == 2)
                    made.send(command(1) + command(2))
                    assert await received(going, len(command(1))) == command(1)
                    assert await received(staying, len(command(2))) == command(2)
                await until(lambda: made.address(1) is None)
                with closing(await connected(port)) as back:
                    back.send(beat(1))
                    await until(lambda: len(made.delivered) == 3)
                    assert made.link.conflicts == {}
                    made.send(command(1))
                    assert await received(back, len(command(1))) == command(1)

    asyncio.run(main())


def test_a_tcp_port_in_use_is_named() -> None:
    async def main() -> None:
        port = free_tcp_port()
        with closing(listening(port)), pytest.raises(LinkError, match=f"TCP port {port} on 127.0.0.1"):
            async with bench(1, listen=TcpIn("127.0.0.1", port)):
                pass

    asyncio.run(main())


def test_slow_reader_loses_whole_frames_and_delays_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    def narrow(host: str, port: int) -> socket.socket:
        """What it accepts has little room: with the kernel's 4 MB the test takes 90,000 frames."""
        made = channels.listen(host, port)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM_BYTES)
        return made

    monkeypatch.setattr(streams, "listen", narrow)

    async def main() -> None:
        port = free_tcp_port()
        async with bench(1, listen=TcpIn("127.0.0.1", port)) as made:
            with closing(await connected(port, ROOM_BYTES)) as slow:
                slow.send(beat(1))
                await until(lambda: made.delivered)
                slowest_s = 0.0
                sent = 0
                while made.counters.no_room < 100:  # soon: the kernel ends what is not read for 1 s
                    began_s = time.thread_time()
                    made.send(command(1))
                    slowest_s = max(slowest_s, time.thread_time() - began_s)
                    sent += 1
                    assert sent < 1_000_000
                    assert made.counters.send_errors == 0
                before = made.counters.sent
                made.send(setpoint(1))
                assert made.counters.sent == before, "a setpoint waits behind others"
                assert slowest_s < 0.05
                whole = before
                data = await received(slow, whole * len(command(1)))
                assert data == command(1) * whole

    asyncio.run(main())


@contextmanager
def cable(folder: Path) -> Iterator[Cable]:
    made = Cable(folder / "ttyTEST")
    made.plug()
    try:
        yield made
    finally:
        made.pull()


async def read_from(line: Cable, size: int) -> bytes:
    data = b""
    async with asyncio.timeout(120):
        while len(data) < size:
            data += line.read()
            await asyncio.sleep(0.005)
    return data


def test_a_serial_port_carries_frames_both_ways(tmp_path: Path) -> None:
    async def main() -> None:
        with cable(tmp_path) as line:
            async with bench(1, 2, listen=SerialPort(str(line.path), 57600)) as made:
                made.broadcast()
                assert is_our_heartbeat(await read_from(line, len(beat(245))))
                line.write(b"\x13\x11\r\n" + beat(1)[:7])
                await asyncio.sleep(0.05)
                line.write(beat(1)[7:] + beat(2))
                await until(lambda: len(made.delivered) == 2)
                made.send(command(2))
                assert await read_from(line, len(command(2))) == command(2)
                assert made.counters.garbage_bytes == 4
                assert str(made.address(1)) == str(line.path)

    asyncio.run(main())


def test_reconnected_serial_port_is_found(tmp_path: Path) -> None:
    async def main() -> None:
        with cable(tmp_path) as line:
            async with bench(1, listen=SerialPort(str(line.path), 57600)) as made:
                line.write(beat(1))
                await until(lambda: made.delivered)
                line.pull()
                await until(lambda: made.address(1) is None)
                made.send(command(1))
                made.broadcast()
                line.plug()
                async with asyncio.timeout(120):
                    while len(made.delivered) < 2:
                        line.write(beat(1))
                        await asyncio.sleep(0.1)
                made.send(command(1))
                assert await read_from(line, len(command(1))) == command(1)

    asyncio.run(main())


def test_absent_serial_port_is_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        line = Cable(tmp_path / "ttyTEST")
        async with bench(1, listen=SerialPort(str(line.path), 57600)) as made:
            await asyncio.sleep(1.3)
            line.plug()
            try:
                async with asyncio.timeout(120):
                    while not made.delivered:
                        line.write(beat(1))
                        await asyncio.sleep(0.1)
            finally:
                line.pull()
        assert [record.msg for record in caplog.records].count("cannot_connect") == 1

    with caplog.at_level("INFO"):
        asyncio.run(main())
