"""What a hostile sender sends to vehicles' ports: `python -m tests.support.floods PORT KIND PER_S SECONDS`.

It floods a port of this host from an address of its own, as vehicles 1 to 6, and prints that address once it
has begun. `FLOODS` makes the datagrams of each kind, for whoever sends them otherwise.
"""

import os
import random
import socket
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import common as dialect

LONGEST_BYTES: Final = 1447
DATAGRAMS: Final = 20
"""Of a kind, sent again and again."""

_KEY: Final = bytes(range(100, 132))

Message = Callable[[int], Any]


def heartbeat(_: int) -> Any:
    return dialect.MAVLink_heartbeat_message(2, 12, 0x91, 4 << 16, 4, 3)


def text(at: int) -> Any:
    return dialect.MAVLink_statustext_message(0, b"A%d" % at)


def chunk(at: int) -> Any:
    return dialect.MAVLink_statustext_message(0, b"A" * 50, id=1 + at % 60_000, chunk_seq=at % 255)


def position(at: int) -> Any:
    return dialect.MAVLink_global_position_int_message(at, 474000000, 85000000, 9, 9, 0, 0, 0, 0)


def parameter(_: int) -> Any:
    return dialect.MAVLink_param_value_message(b"COM_OF_LOSS_T", 1.0, 9, 900, 1)


def answer(_: int) -> Any:
    return dialect.MAVLink_command_ack_message(400, 0)


def frames(
    message: Message, system_ids: Sequence[int], *, signs: bool = False, old: bool = False
) -> list[bytes]:
    """Datagrams full of frames in the names of these systems, in turn."""
    packers = [dialect.MAVLink(None, srcSystem=system_id, srcComponent=1) for system_id in system_ids]
    for packer in packers if signs else ():
        packer.signing.secret_key, packer.signing.sign_outgoing = _KEY, True
        packer.signing.timestamp = 10**12
    datagrams, datagram, at = list[bytes](), b"", 0
    while len(datagrams) < DATAGRAMS:
        frame = bytes(message(at).pack(packers[at % len(packers)], force_mavlink1=old))
        if len(datagram) + len(frame) > LONGEST_BYTES:
            datagrams.append(datagram)
            datagram = b""
        datagram += frame
        at += 1
    return datagrams


def cut(datagrams: Sequence[bytes], size: int = 37) -> list[bytes]:
    """The same bytes in small pieces, none of which is whole."""
    stream = b"".join(datagrams)
    return [stream[at : at + size] for at in range(0, len(stream), size)]


def noise(most: int) -> list[bytes]:
    source = random.Random(1)
    return [source.randbytes(source.randint(1, most)) for _ in range(DATAGRAMS)]


STRANGERS: Final = range(200, 240)

FLOODS: Final[dict[str, Callable[[Sequence[int]], list[bytes]]]] = {
    "heartbeats": lambda ids: frames(heartbeat, ids, old=True),
    "positions": lambda ids: frames(position, ids),
    "texts": lambda ids: frames(text, ids),
    "chunks": lambda ids: frames(chunk, ids),
    "parameters": lambda ids: frames(parameter, ids),
    "answers": lambda ids: frames(answer, ids),
    "wrongly-signed": lambda ids: frames(heartbeat, ids, signs=True),
    "strangers": lambda _: frames(heartbeat, STRANGERS),
    "beginnings": lambda _: [bytes((magic,)) * LONGEST_BYTES for magic in (0xFE, 0xFD)],
    "beginnings-of-known": lambda _: [b"\xfe\xff" * 700, b"\xfd\xff\x00" * 480],
    "cut": lambda ids: cut(frames(heartbeat, ids)),
    "noise": lambda _: noise(LONGEST_BYTES),
    "tiny": lambda _: noise(1),
}


def flood(send: Callable[[bytes], object], datagrams: Sequence[bytes], per_s: float, seconds: float) -> int:
    """Send so many datagrams a second for a time. Returns: their number."""
    began_s, sent = time.monotonic(), 0
    while (now_s := time.monotonic() - began_s) < seconds:
        for datagram in due(datagrams, sent, int(now_s * per_s)):
            try:
                send(datagram)
            except OSError:  # no room, or nothing listens
                continue
            finally:
                sent += 1
        time.sleep(0.001)
    return sent


def due(datagrams: Sequence[bytes], sent: int, count: int) -> Iterator[bytes]:
    return (datagrams[at % len(datagrams)] for at in range(sent, count))


def main(port: str, kind: str, per_s: str, seconds: str) -> None:
    os.nice(10)  # a flood comes from elsewhere: it takes no time from the service
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.connect(("127.0.0.1", int(port)))
        host, own_port = sender.getsockname()
        sys.stdout.write(f"{host}:{own_port}\n")
        sys.stdout.flush()
        flood(sender.send, FLOODS[kind](range(1, 7)), float(per_s), float(seconds))


if __name__ == "__main__":
    main(*sys.argv[1:])
