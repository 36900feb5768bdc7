"""Tracks leave for TAK over real sockets and TLS, or it is said why not; nothing waits for a receiver."""

import asyncio
import socket
import ssl
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from pathlib import Path

import pytest

from gcs.links.intake import Intake
from gcs.links.tak.events import MEASURED, OwnTrack, event
from gcs.links.tak.sender import CotSender
from gcs.links.tak.settings import OwnTracks, TakReceiver
from gcs.links.targets.receive import TARGETS, intake_of, keep_receiving_tracks
from gcs.links.targets.settings import CotTracks
from gcs.model.target_fix import TargetFix
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.tak_listener import read
from tests.support.target_bytes import cot

TLS = Path(__file__).parents[1] / "data" / "tls"
CERTIFICATE, KEY = TLS / "certificate.pem", TLS / "key.pem"
GROUP = "239.255.71.4"
OWN = OwnTracks("gcs-0000beef", 3)
TRACKS = [
    OwnTrack(f"{OWN.uid}.d{at}", f"SHOW d{at}", MEASURED, 47.0, 8.0, 500.0, "hold", 0.0, 1.0)
    for at in range(1, 4)
]
EVENTS = [event(track, time.time()) for track in TRACKS]


@asynccontextmanager
async def sending(at: str, **settings: object) -> AsyncIterator[CotSender]:
    """A sender that is offered the events twenty times a second."""
    sender = CotSender(TakReceiver.model_validate({"at": at, **settings}))
    loop = asyncio.get_running_loop()

    async def offer() -> None:
        while True:
            sender.offer(EVENTS, loop.time())
            await asyncio.sleep(0.05)

    tasks = [asyncio.create_task(sender.keep_open()), asyncio.create_task(offer())]
    try:
        yield sender
        assert not any(task.done() for task in tasks)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def problem(sender: CotSender) -> str:
    return sender.problem(asyncio.get_running_loop().time())


@contextmanager
def receiver(host: str = "127.0.0.1") -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((host, 0))
        if host == GROUP:
            joined = socket.inet_aton(GROUP) + socket.inet_aton("127.0.0.1")
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, joined)
        opened.setblocking(False)
        yield opened


@pytest.mark.parametrize("host", ["127.0.0.1", GROUP])
def test_each_datagram_has_one_event(host: str) -> None:
    async def main(opened: socket.socket) -> None:
        at = f"udp://{host}:{opened.getsockname()[1]}"
        async with sending(at, interface="127.0.0.1" if host == GROUP else "") as sender:
            loop = asyncio.get_running_loop()
            arrived = [read(await loop.sock_recv(opened, 65535)) for _ in range(6)]
            assert [each.callsign for each in arrived] == ["SHOW d1", "SHOW d2", "SHOW d3"] * 2
            await until(lambda: problem(sender) == "")

    with receiver(host) as opened:
        asyncio.run(main(opened))


def context(*, client: bool = False) -> ssl.SSLContext:
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    made.load_cert_chain(CERTIFICATE, KEY)
    if client:
        made.verify_mode = ssl.CERT_REQUIRED
        made.load_verify_locations(CERTIFICATE)
    return made


@pytest.mark.parametrize("kind", ["tcp", "tls", "client"])
def test_server_receives_events_and_what_it_sends_is_dropped(kind: str, tmp_path: Path) -> None:
    pem = tmp_path / "client.pem"
    pem.write_text(CERTIFICATE.read_text() + KEY.read_text())
    connections: list[list[bytes]] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        arrived: list[bytes] = []
        connections.append(arrived)
        writer.write(cot() * 20_000)  # of others: 5 MB
        await writer.drain()
        arrived += [await reader.readuntil(b"</event>") for _ in range(6)]
        writer.close()

    async def main(port: int) -> None:
        settings: dict[str, object] = {}
        if kind != "tcp":
            settings = {"authority": CERTIFICATE, **({"certificate": pem} if kind == "client" else {})}
        async with sending(f"{'tcp' if kind == 'tcp' else 'tls'}://127.0.0.1:{port}", **settings) as sender:
            await until(lambda: problem(sender) == "connection refused")
            tls = None if kind == "tcp" else context(client=kind == "client")
            async with await asyncio.start_server(serve, "127.0.0.1", port, ssl=tls):
                await until(lambda: len(connections) >= 2 and len(connections[1]) >= 6)

    asyncio.run(main(free_ports()))
    for arrived in connections[:2]:
        assert [read(each).callsign for each in arrived] == ["SHOW d1", "SHOW d2", "SHOW d3"] * 2


def reason(at: str, **settings: object) -> str:
    """Why nothing leaves."""

    async def main() -> str:
        async with sending(at, **settings) as sender:
            await until(lambda: problem(sender) not in {"", "not connected yet"})
            assert sender.dropped > 0
            return problem(sender)

    return asyncio.run(main())


def test_what_cannot_be_reached_is_named(tmp_path: Path) -> None:
    port = free_ports()
    assert reason(f"udp://127.0.0.1:{port}") == "connection refused"
    assert reason(f"tcp://127.0.0.1:{port}") == "connection refused"
    for scheme in ("udp", "tcp"):
        assert "Errno" in reason(f"{scheme}://nowhere.invalid:{port}"), "as the resolver says"
        assert "idna" in reason(f"{scheme}://{'a' * 70}.invalid:{port}")
    assert "Cannot assign" in reason(f"udp://{GROUP}:{port}", interface="192.0.2.1")
    missing = reason(f"tls://127.0.0.1:{port}", authority=tmp_path / "none.pem")
    assert "none.pem cannot be read: No such file or directory" in missing


def test_certificate_of_another_server_is_refused() -> None:
    def shake_hands(listener: socket.socket) -> None:
        with suppress(OSError), listener.accept()[0] as connection:
            context().wrap_socket(connection, server_side=True)

    async def main(listener: socket.socket) -> None:
        shaken = asyncio.create_task(asyncio.to_thread(shake_hands, listener))
        async with sending(f"tls://127.0.0.1:{listener.getsockname()[1]}") as sender:
            await until(lambda: problem(sender) == "refused: certificate: self-signed certificate")
            assert sender.sent == 0
        await shaken

    with socket.create_server(("127.0.0.1", 0)) as listener:
        asyncio.run(main(listener))


@pytest.mark.parametrize("tls", [False, True])
def test_server_that_does_not_read_delays_nothing(tls: bool) -> None:
    """What it does not take is dropped: little waits, and sending never blocks."""
    stalled = asyncio.Event()

    async def serve(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await stalled.wait()
        writer.transport.abort()

    async def main(port: int) -> None:
        secure = context() if tls else None
        async with await asyncio.start_server(serve, "127.0.0.1", port, limit=1024, ssl=secure):
            settings = {"authority": CERTIFICATE} if tls else {}
            async with sending(f"{'tls' if tls else 'tcp'}://127.0.0.1:{port}", **settings) as sender:
                await until(lambda: sender.sent > 0)
                loop = asyncio.get_running_loop()
                many = EVENTS * 17
                before = sender.dropped
                while sender.dropped - before < 100_000:
                    sender.offer(many, loop.time())
                    await asyncio.sleep(0)
                assert problem(sender) == "the server does not read what is sent"
                assert sender.sent * len(EVENTS[0]) < 16e6, "the kernels' buffers"
                stalled.set()

    asyncio.run(main(free_ports()))


def tracks_of(at: str, own: OwnTracks, done: Callable[[list[TargetFix]], bool]) -> list[TargetFix]:
    """What a source of traffic takes of a group that the show itself sends to."""
    settings = CotTracks(kind="cot", at=at, interface="127.0.0.1")
    fixes: list[TargetFix] = []

    async def main() -> None:
        intake = intake_of("traffic", settings, own)
        receiving = keep_receiving_tracks(settings, frozenset(), own, fixes.append, lambda _: None, intake)
        task = asyncio.create_task(receiving)
        stranger = CotSender(TakReceiver(at=at, interface="127.0.0.1"))
        others = asyncio.create_task(stranger.keep_open())
        async with sending(at, interface="127.0.0.1") as sender:
            await until(lambda: sender.sent > 30)
            while not done(fixes):
                stranger.offer([cot("X1", "BOAT")], 0.0)
                await asyncio.sleep(0.05)
        task.cancel()
        others.cancel()
        await asyncio.gather(task, others, return_exceptions=True)

    asyncio.run(main())
    return fixes


def test_own_tracks_in_a_group_are_no_traffic() -> None:
    at = f"udp://{GROUP}:{free_ports()}"
    assert {fix.track for fix in tracks_of(at, OWN, lambda fixes: len(fixes) >= 3)} == {"X1"}
    everything = tracks_of(at, OwnTracks(), lambda fixes: len({fix.track for fix in fixes}) >= 4)
    assert f"{OWN.uid}.d1" in {fix.track for fix in everything}


def test_echo_of_a_large_fleet_displaces_no_other_track() -> None:
    settings = CotTracks(kind="cot", at="tcp://192.0.2.9:8087")
    own = OwnTracks(OWN.uid, 1001)
    alone, echoed = Intake("traffic cot", TARGETS), intake_of("traffic", settings, own)
    second = b"".join(EVENTS[0] for _ in range(1001)) + cot() * 100
    for intake in (alone, echoed):
        for turn in range(100):
            intake.tail(second[: len(second) // 20], "x", 0.05 * turn)
    assert alone.dropped_bytes > 0
    assert echoed.dropped_bytes == 0
