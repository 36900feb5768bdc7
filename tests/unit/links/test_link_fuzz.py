"""A million mutated bytes into the wire: no exception escapes, memory stays bounded, garbage is counted."""

import asyncio
import random
import socket
import tracemalloc
from collections.abc import Sequence
from contextlib import closing, suppress
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as dialect

from gcs.links.endpoints.streams import LinkPorts
from gcs.links.settings import Forward, Listen, TcpIn
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.wire_bench import Bench, beat, bench

TOTAL_BYTES = 1_000_000
GROWTH_MAX_BYTES = 3 << 20


def any_message(source: random.Random) -> bytes:
    """A message of any kind from any system, with content of any kind, signed or not, old or new."""
    kind: Any = source.choice(list(dialect.mavlink_map.values()))
    packer = dialect.MAVLink(None, srcSystem=source.randrange(256), srcComponent=source.randrange(256))
    if source.random() < 0.2:
        packer.signing.secret_key, packer.signing.sign_outgoing = source.randbytes(32), True
    payload = source.randbytes(kind.unpacker.size)
    old = kind.id < 256 and source.random() < 0.2
    message = dialect.MAVLink_message(kind.id, kind.msgname)
    return bytes(message._pack(packer, kind.crc_extra, payload, force_mavlink1=old))


def mutated(source: random.Random, pool: Sequence[bytes]) -> bytes:
    """Some messages end to end, then bytes changed, put in, cut out; now and then noise alone."""
    data = bytearray(b"".join(source.choices(pool, k=source.randrange(1, 12))))
    for _ in range(source.choice((0, 1, 3, 30))):
        at = source.randrange(len(data))
        match source.randrange(4):
            case 0:
                data[at] = source.choice((0, 0xFD, 0xFE, 0xFF, source.randrange(256)))
            case 1:
                del data[at : at + source.randrange(40)]
            case 2:
                data[at:at] = source.randbytes(source.randrange(40))
            case _:
                data[at:at] = source.choice((b"\xfd", b"\xfe")) * source.randrange(300)
        if not data:
            break
    return bytes(data) or source.randbytes(100)


def state_size(made: Bench) -> int:
    addresses, ports, signatures = made.link._addresses, made.link._ports, made.link.outbox.signatures
    assert isinstance(ports, LinkPorts)
    refused = 0 if signatures is None else len(signatures._refused)
    return len(addresses._strangers) + refused + len(ports.failures) + len(addresses._conflicts)


def read_away(sender: socket.socket) -> None:
    """A connection whose far end does not read is given up after a second."""
    sender.setblocking(False)
    with suppress(BlockingIOError, ConnectionRefusedError):
        while sender.recv(1 << 16):
            pass
    sender.settimeout(60.0)


def a_million_bytes() -> list[bytes]:
    source = random.Random(20)
    pool = [any_message(source) for _ in range(1000)]
    parts: list[bytes] = []
    left = TOTAL_BYTES
    while left > 0:
        parts.append(mutated(source, pool)[:8000])
        left -= len(parts[-1])
    return parts


async def feed(made: Bench, sender: socket.socket, parts: Sequence[bytes]) -> None:
    for data in parts:
        sender.sendall(data)
        made.receive()
        made.delivered.clear()
        read_away(sender)
    await until(lambda: made.counters.garbage_bytes > 10_000)
    assert state_size(made) < 1000


async def still_works(made: Bench, sender: socket.socket) -> None:
    made.delivered.clear()
    sender.sendall(bytes(600))
    sender.sendall(beat(200))
    await until(lambda: any(frame.raw == beat(200) for frame in made.delivered))


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_a_million_mutated_bytes_do_no_harm(kind: str) -> None:
    async def main() -> None:
        port: int = free_ports()
        place = Listen("127.0.0.1", port) if kind == "udp" else TcpIn("127.0.0.1", port)
        forward = [Forward(url=f"udp://127.0.0.1:{free_ports()}", read_only=False)]
        async with bench(*range(1, 251), listen=place, forward=forward) as made:
            family = socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM
            with closing(socket.socket(socket.AF_INET, family)) as sender:
                sender.connect(("127.0.0.1", port))
                made.receive()
                parts = a_million_bytes()
                tracemalloc.start()
                try:
                    await feed(made, sender, parts)
                    grown_bytes, _ = tracemalloc.get_traced_memory()
                finally:
                    tracemalloc.stop()
                assert grown_bytes < GROWTH_MAX_BYTES
                await still_works(made, sender)

    asyncio.run(main())
