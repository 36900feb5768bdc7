"""Ten times what an input of docs/invariants.md may take: `python -m tests.support.input_floods`, see `main`.

Each row of `ROWS` is a function that makes what is sent, and how often a second.
"""

import os
import random
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import common as dialect

from gcs.links.intake import FORWARDED, Bound, of_vehicles
from gcs.links.rtk import CORRECTIONS
from gcs.links.targets.receive import TARGETS
from gcs.shows.timecode.midi import quarter_frames
from gcs.shows.timecode.receiver import MIDI
from gcs.shows.timecode.smpte import Rate, label_at
from tests.support.rtcm import rtcm
from tests.support.target_bytes import cot, gga, rmc

TIMES: Final = 10.0
DATAGRAM: Final = 1400


@dataclass(frozen=True, slots=True)
class Flood:
    """Datagrams, or pieces of a stream, sent in turn."""

    datagrams: Sequence[bytes]
    per_s: float
    least_per_s: float
    """What must leave in a second, so that it counts as a flood: a stream is held back by flow control."""


def by_bytes(bound: Bound, *contents: bytes) -> Flood:
    """Ten times the bytes."""
    per_s = TIMES * bound.bytes_per_s * len(contents) / sum(map(len, contents))
    return Flood(contents, per_s, 0.5 * per_s)


def by_messages(bound: Bound, *contents: bytes) -> Flood:
    """Ten times the messages."""
    return Flood(contents, TIMES * bound.messages_per_s, 0.5 * TIMES * bound.messages_per_s)


def by_stream(*contents: bytes) -> Flood:
    """Ten times the bytes of a link of 50 vehicles, over TCP: it is held back, but never below the bound."""
    per_s = TIMES * of_vehicles(50).bytes_per_s * len(contents) / sum(map(len, contents))
    return Flood(contents, per_s, per_s / TIMES)


def _packed(message: dialect.MAVLink_message, system_id: int) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)))


def _heartbeats() -> bytes:
    """Of the fleet's own system ids: a full datagram."""
    heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 0x91, 0x04000000, 4, 3)
    return b"".join(_packed(heartbeat, 1 + row % 6) for row in range(66))


def quarters() -> bytes:
    return b"".join(
        b"".join(quarter_frames(label_at(2.0 * at / 30, Rate.FPS_30), Rate.FPS_30)) for at in range(40)
    )


def _pings() -> bytes:
    return _packed(dialect.MAVLink_ping_message(0, 0, 1, 1), 255) * 20


ROWS: Final[dict[str, Callable[[], Flood]]] = {
    "rtk-preambles": lambda: by_bytes(CORRECTIONS, b"\xd3\x03" * (DATAGRAM // 2)),
    "rtk-messages": lambda: by_bytes(CORRECTIONS, rtcm(1077, 8) * 90),
    "rtk-many": lambda: by_messages(CORRECTIONS, b"\xd3\x00\x02\x00\x00\x00\x00\x00"),
    "rtk-random": lambda: by_bytes(CORRECTIONS, *(random.Random(at).randbytes(DATAGRAM) for at in range(50))),
    "timecode-labels": lambda: by_bytes(MIDI, quarters()[:DATAGRAM]),
    "timecode-many": lambda: by_messages(MIDI, b"\xf1\x00"),
    "timecode-random": lambda: by_bytes(MIDI, *(random.Random(at).randbytes(DATAGRAM) for at in range(50))),
    "target-sentences": lambda: by_bytes(TARGETS, (gga("120000") + rmc("120000"))[:DATAGRAM]),
    "target-many": lambda: by_messages(TARGETS, b"$GP*00\r\n"),
    "target-random": lambda: by_bytes(TARGETS, *(random.Random(at).randbytes(DATAGRAM) for at in range(50))),
    "track-events": lambda: by_bytes(TARGETS, *(cot(f"U{at}", f"C{at}") for at in range(200))),
    "track-elements": lambda: by_bytes(TARGETS, cot(detail="<a/>" * 300)),
    "station-pings": lambda: by_bytes(FORWARDED, _pings()),
    "station-many": lambda: by_messages(FORWARDED, b"\xfd\xfe" * 8),
    "vehicles-doubled": lambda: Flood([_heartbeats()], 3000.0, 1500.0),
    "connection-doubled": lambda: by_stream(_heartbeats()),
    "connection-magic": lambda: by_stream(b"\xfd\xfe" * (DATAGRAM // 2)),
    "connection-random": lambda: by_stream(*(random.Random(at).randbytes(DATAGRAM) for at in range(50))),
}
"""By name; the first word is that of the input. A connection is one over TCP to the link of the vehicles."""


def main(row: str, port: str, seconds: str, far: str = "") -> None:
    """Send a row to a port for some seconds, and print how many datagrams or pieces it was.

    With `far` it is the further ground station at that port, which answers to where frames come from. A flood
    comes from elsewhere: it takes no time from the service.
    """
    os.nice(19)
    flood, to = ROWS[row](), ("127.0.0.1", int(port))
    kind = socket.SOCK_STREAM if row.startswith("connection") else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as sender:
        if far:
            sender.bind(to)
            to = sender.recvfrom(4096)[1]
        sender.connect(to)
        print("begun", flush=True)  # noqa: T201 - its output
        sent, begin_s = 0, time.monotonic()
        while (since_s := time.monotonic() - begin_s) < float(seconds):
            if sent >= since_s * flood.per_s:
                time.sleep(0.001)
                continue
            sender.sendall(flood.datagrams[sent % len(flood.datagrams)])
            sent += 1
    print(sent, flush=True)  # noqa: T201 - its output


if __name__ == "__main__":
    main(*sys.argv[1:])
