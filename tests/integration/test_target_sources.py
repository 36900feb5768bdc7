"""Sources of targets over real sockets, a pty and TLS: fixes arrive, or the reason in words."""

import asyncio
import os
import socket
import ssl
import struct
import tty
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from pydantic import TypeAdapter, ValidationError

from gcs.links.intake import Intake
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.gpsd import WATCH
from gcs.links.targets.receive import TARGETS, keep_receiving
from gcs.links.targets.settings import TargetSource
from gcs.model.target_fix import TargetFix
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.target_bytes import LATITUDE_DEG, cot, gga, rmc, tpv

TLS = Path(__file__).parents[1] / "data" / "tls"
CERTIFICATE, KEY = TLS / "certificate.pem", TLS / "key.pem"
GROUP = "239.255.71.3"
OWN = OwnTracks("gcs-0000beef", 3)

Reader: TypeAlias = asyncio.StreamReader
Writer: TypeAlias = asyncio.StreamWriter


@dataclass
class Received:
    """What one source has given."""

    fixes: list[TargetFix] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    intake: Intake = field(default_factory=lambda: Intake("target", TARGETS))
    task: "asyncio.Task[None] | None" = None

    def alive(self) -> bool:
        return self.task is not None and not self.task.done()


def source(**settings: object) -> TargetSource:
    made: TargetSource = TypeAdapter(TargetSource).validate_python(settings)
    return made


@asynccontextmanager
async def receiving(**settings: object) -> AsyncIterator[Received]:
    received = Received()
    received.task = asyncio.create_task(
        keep_receiving(
            source(**settings), OWN, received.fixes.append, received.reasons.append, received.intake
        )
    )
    try:
        yield received
        assert received.alive()
    finally:
        received.task.cancel()
        with suppress(asyncio.CancelledError):
            await received.task


async def until_sent(send: Callable[[int], object], done: Callable[[], bool]) -> None:
    """Send one after the other until something is so."""
    async with asyncio.timeout(120.0):
        at = 0
        while not done():
            send(at)
            at += 1
            await asyncio.sleep(0.02)


@asynccontextmanager
async def server(
    port: int, serve: Callable[[Reader, Writer], Awaitable[None]], **options: Any
) -> AsyncIterator[None]:
    async def served(reader: Reader, writer: Writer) -> None:
        try:
            await serve(reader, writer)
            writer.close()
            await writer.wait_closed()
        except (ConnectionError, asyncio.CancelledError):  # the other side, or the test, has ended
            writer.transport.abort()

    async with await asyncio.start_server(served, "127.0.0.1", port, **options):
        yield


def nmea(at: int) -> bytes:
    time = f"12{at // 60 % 60:02d}{at % 60:02d}"
    return rmc(time) + gga(time)


@contextmanager
def sender(port: int, host: str = "127.0.0.1") -> Iterator[Callable[[bytes], object]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        yield lambda data: peer.sendto(data, (host, port))


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_nmea_arrives_over_udp_and_a_serial_port(pty: tuple[int, str]) -> None:
    ours, device = pty

    async def main(at: str, send: Callable[[bytes], object]) -> None:
        async with receiving(kind="nmea", at=at) as received:
            await until_sent(lambda step: send(nmea(step)), lambda: len(received.fixes) >= 3)
            assert received.fixes[-1].latitude_deg == pytest.approx(LATITUDE_DEG)
            assert received.reasons == [""] * bool(received.reasons)
            await until_sent(
                lambda step: send(gga(f"13{step // 60:02d}{step % 60:02d}", "0")),
                lambda: any(received.reasons),
            )
            assert received.reasons[-1] == "no fix: GGA quality 0 (no fix)"
            await until_sent(lambda step: send(nmea(step)), lambda: received.reasons[-1] == "")

    port = free_ports()
    with sender(port) as send:
        asyncio.run(main(f"udp://127.0.0.1:{port}", send))
    asyncio.run(main(f"serial://{device}:115200", lambda data: os.write(ours, data)))


def test_nmea_of_a_server_is_connected_to_again() -> None:
    connections = 0

    async def serve(_: Reader, writer: Writer) -> None:
        nonlocal connections
        connections += 1
        for step in range(3):
            writer.write(nmea(step))
        await writer.drain()

    async def main(port: int) -> Received:
        async with receiving(kind="nmea", at=f"tcp://127.0.0.1:{port}") as received:
            await until(lambda: bool(received.reasons))
            assert received.reasons == ["connection refused"]
            async with server(port, serve):
                await until(lambda: connections >= 2 and len(received.fixes) >= 6)
            return received

    received = asyncio.run(main(free_ports()))
    assert received.reasons[:3] == ["connection refused", "", "the source has ended the connection"]


def test_gpsd_is_asked_and_its_reports_arrive() -> None:
    asked: list[bytes] = []

    async def gpsd(reader: Reader, writer: Writer) -> None:
        writer.write(
            b'{"class":"VERSION","release":"3.22","rev":"3.22","proto_major":3,"proto_minor":14}\r\n'
        )
        asked.append(await reader.readline())
        writer.write(
            b'{"class":"DEVICES","devices":[{"class":"DEVICE","path":"/dev/ttyUSB0","native":0}]}\r\n'
            b'{"class":"WATCH","enable":true,"json":true,"nmea":false,"raw":0}\r\n'
        )
        writer.write(tpv(mode=1, lat=None, lon=None))
        await writer.drain()
        await asyncio.sleep(0.2)
        for at in range(5):
            line = tpv(time=f"2026-11-29T12:00:{at:02d}.000Z")
            writer.write(line[:50])
            await writer.drain()
            await asyncio.sleep(0.06)
            writer.write(line[50:] + b'{"class":"SKY","device":"/dev/ttyUSB0","satellites":[{"PRN":1}]}\r\n')
            await writer.drain()

    async def main(port: int) -> Received:
        async with server(port, gpsd), receiving(kind="gpsd", at=f"tcp://127.0.0.1:{port}") as received:
            await until(lambda: len(received.fixes) >= 5)
            return received

    received = asyncio.run(main(free_ports()))
    assert asked[0] == WATCH
    assert received.reasons[:2] == ["no fix: mode 1 of /dev/ttyUSB0", ""]
    assert [fix.source_s % 60 for fix in received.fixes[:5]] == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_cursor_on_target_arrives_over_udp_and_multicast() -> None:
    async def main(host: str, port: int) -> None:
        settings = {"at": f"udp://{host}:{port}", "interface": "127.0.0.1", "geoid_m": 47.0}
        with sender(port, host) as send:
            async with receiving(kind="cot", track="BOAT", **settings) as received:
                await until_sent(lambda _: send(cot("X2", "OTHER")), lambda: bool(received.reasons))
                await until_sent(lambda _: send(cot()), lambda: len(received.fixes) >= 3)
                assert received.reasons == ["unknown track BOAT, seen: OTHER", ""]
                assert received.fixes[0].altitude_amsl_m == 488.0

    asyncio.run(main("127.0.0.1", free_ports()))
    asyncio.run(main(GROUP, free_ports()))


def test_two_programs_of_one_computer_share_a_group() -> None:
    async def main(port: int) -> None:
        settings = {"kind": "cot", "at": f"udp://{GROUP}:{port}", "track": "BOAT", "interface": "127.0.0.1"}
        with sender(port, GROUP) as send:
            async with receiving(**settings) as one, receiving(**settings) as other:
                await until_sent(lambda _: send(cot()), lambda: bool(one.fixes and other.fixes))
                assert one.fixes[0].latitude_deg == other.fixes[0].latitude_deg

    asyncio.run(main(free_ports()))


async def events(_: Reader, writer: Writer) -> None:
    """Of two tracks, cut anywhere."""
    data = b"".join(cot(f"X{at % 2}", f"C{at % 2}") for at in range(20))
    for at in range(0, len(data), 333):
        writer.write(data[at : at + 333])
        await writer.drain()
    await asyncio.sleep(60.0)


def secured(*, client: bool) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(CERTIFICATE, KEY)
    if client:
        context.verify_mode = ssl.CERT_REQUIRED
        context.load_verify_locations(CERTIFICATE)
    return context


def of_server(scheme: str, context: ssl.SSLContext | None, **settings: object) -> Received:
    """What one connection to a server of events brings."""

    async def main(port: int) -> Received:
        settings_of = {"kind": "cot", "at": f"{scheme}://127.0.0.1:{port}", "track": "C1", **settings}
        async with server(port, events, ssl=context), receiving(**settings_of) as received:
            await until(lambda: bool(received.reasons or len(received.fixes) == 10))
            return received

    return asyncio.run(main(free_ports()))


def test_cursor_on_target_of_a_server_arrives_over_tcp_and_tls(tmp_path: Path) -> None:
    pem = tmp_path / "client.pem"
    pem.write_text(CERTIFICATE.read_text() + KEY.read_text())
    for received in (
        of_server("tcp", None),
        of_server("tls", secured(client=False), authority=CERTIFICATE),
        of_server("tls", secured(client=True), authority=CERTIFICATE, certificate=pem),
    ):
        assert len(received.fixes) == 10
        assert not any(received.reasons)


def refusal(*, client: bool, **settings: object) -> str:
    """Why a handshake with a server fails, or does not begin."""

    def shake_hands(listener: socket.socket) -> None:
        with suppress(OSError), listener.accept()[0] as connection:
            secured(client=client).wrap_socket(connection, server_side=True)

    async def main(listener: socket.socket) -> str:
        at = f"tls://127.0.0.1:{listener.getsockname()[1]}"
        async with receiving(kind="cot", at=at, track="BOAT", **settings) as received:
            shaken = asyncio.create_task(asyncio.to_thread(shake_hands, listener))
            await until(lambda: bool(received.reasons))
            listener.shutdown(socket.SHUT_RDWR)
            await shaken
            return received.reasons[0]

    with socket.create_server(("127.0.0.1", 0)) as listener:
        return asyncio.run(main(listener))


def test_certificates_that_do_not_suit_are_named(tmp_path: Path) -> None:
    (tmp_path / "junk.pem").write_text("junk")
    assert refusal(client=False) == "refused: certificate: self-signed certificate"
    assert "certificate required" in refusal(client=True, authority=CERTIFICATE)
    missing = refusal(client=False, authority=tmp_path / "none.pem")
    assert "none.pem cannot be read: No such file or directory" in missing
    assert "junk.pem cannot be read" in refusal(client=False, certificate=tmp_path / "junk.pem")


def test_what_cannot_be_opened_is_named() -> None:
    async def reason(**settings: object) -> str:
        async with receiving(**settings) as received:
            await until(lambda: bool(received.reasons))
            return str(received.reasons[0])

    assert "could not open port" in asyncio.run(reason(kind="nmea", at="serial:///dev/none:4800"))
    assert asyncio.run(reason(kind="gpsd", at=f"tcp://{'a' * 70}.invalid:2947"))
    assert "Cannot assign" in asyncio.run(reason(kind="nmea", at="udp://192.0.2.1:5000"))
    group = {"kind": "cot", "at": f"udp://{GROUP}:6969", "track": "BOAT", "interface": "192.0.2.1"}
    assert asyncio.run(reason(**group)) == f"group {GROUP} cannot be joined at 192.0.2.1: No such device"
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as occupied:
        occupied.bind(("127.0.0.1", 0))
        at = f"udp://127.0.0.1:{occupied.getsockname()[1]}"
        assert "in use" in asyncio.run(reason(kind="nmea", at=at))


def test_ten_thousand_junk_datagrams_a_second_end_nothing() -> None:
    """What passes the bound is judged, what does not is dropped unread, and fixes arrive after them."""

    async def main(port: int, send: Callable[[bytes], object]) -> None:
        junk = [os.urandom(64), b"<event " * 9, cot("X2", "OTHER"), struct.pack("<I", 7) * 30]

        def flood() -> None:
            for at in range(10_000):
                send(junk[at % 4])

        async with receiving(kind="cot", at=f"udp://127.0.0.1:{port}", track="BOAT") as received:
            await until_sent(lambda _: send(cot()), lambda: bool(received.fixes))
            await asyncio.to_thread(flood)
            count = len(received.fixes)
            await until_sent(lambda _: send(cot()), lambda: len(received.fixes) > count)
            assert received.reasons[-1:] in ([], [""])

    port = free_ports()
    with sender(port) as send:
        asyncio.run(main(port, send))


def test_source_ends_although_something_arrives_just_then() -> None:
    async def main(port: int, send: Callable[[bytes], object]) -> None:
        for turns in range(12):
            before = asyncio.all_tasks()
            async with receiving(kind="cot", at=f"udp://127.0.0.1:{port}", track="BOAT") as received:
                await until_sent(lambda _: send(cot()), lambda: bool(received.fixes))
                send(cot())
                for _ in range(turns % 4):
                    await asyncio.sleep(0)
            assert asyncio.all_tasks() == before, "the source is not received any more"

    port = free_ports()
    with sender(port) as send:
        asyncio.run(asyncio.wait_for(main(port, send), 60.0))


@pytest.mark.parametrize(
    "settings",
    [
        {"kind": "nmea", "at": "udp://127.0.0.1:70000"},
        {"kind": "nmea", "at": "udp://127.0.0.1:0"},
        {"kind": "nmea", "at": "serial:///dev/ttyUSB0:300"},
        {"kind": "nmea", "at": "tls://127.0.0.1:4"},
        {"kind": "gpsd", "at": "tcp://127.0.0.1:99999"},
        {"kind": "cot", "at": "udp://239.2.3.1:65536", "track": "BOAT"},
        {"kind": "cot", "at": "udp://239.2.3.1:6969", "track": "BOAT", "interface": "eth0"},
        {"kind": "cot", "at": "udp://239.2.3.1:6969", "track": "BOAT", "geoid_m": 400},
        {"kind": "mavlink", "at": "udp://127.0.0.1:0", "system_id": 1},
    ],
    ids=lambda settings: str(settings["at"]),
)
def test_settings_that_cannot_be_received_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        source(**settings)


def test_a_source_of_the_api_receives_nothing_here() -> None:
    received: list[object] = []
    take = received.append
    asyncio.run(keep_receiving(source(kind="rest"), OwnTracks(), take, take, Intake("target", TARGETS)))
    assert received == []
