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

from gcs.links.intake import CORRECTIONS, FORWARDED, MIDI, Bound
from gcs.shows.timecode.midi import quarter_frames
from gcs.shows.timecode.smpte import Rate, label_at
from tests.support.rtcm import rtcm

TIMES: Final = 10.0
DATAGRAM: Final = 1400


@dataclass(frozen=True, slots=True)
class Flood:
    """Datagrams, sent in turn."""

    datagrams: Sequence[bytes]
    per_s: float


def by_bytes(bound: Bound, *contents: bytes) -> Flood:
    """Ten times the bytes."""
    size = sum(map(len, contents)) / len(contents)
    return Flood(contents, TIMES * bound.bytes_per_s / size)


def by_messages(bound: Bound, *contents: bytes) -> Flood:
    """Ten times the messages."""
    return Flood(contents, TIMES * bound.messages_per_s)


def _packed(message: dialect.MAVLink_message, system_id: int) -> bytes:
    return bytes(message.pack(dialect.MAVLink(None, srcSystem=system_id, srcComponent=1)))


def of_vehicles() -> Flood:
    """Heartbeats of the fleet's own system ids from another address, 3,000 full datagrams a second."""
    heartbeat = dialect.MAVLink_heartbeat_message(2, 12, 0x91, 0x04000000, 4, 3)
    heartbeats = [_packed(heartbeat, 1 + row % 6) for row in range(66)]
    return Flood([b"".join(heartbeats)], 3000.0)


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
    "station-pings": lambda: by_bytes(FORWARDED, _pings()),
    "station-many": lambda: by_messages(FORWARDED, b"\xfd\xfe" * 8),
    "vehicles-doubled": of_vehicles,
}
"""By name; the first word is that of the input."""


def main(row: str, port: str, seconds: str, far: str = "") -> None:
    """Send a row to a port for some seconds, and print how many datagrams it was.

    With `far` it is the further ground station at that port, which answers to where frames come from. A flood
    comes from elsewhere: it takes no time from the service.
    """
    os.nice(19)
    flood, to = ROWS[row](), ("127.0.0.1", int(port))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        if far:
            sender.bind(to)
            to = sender.recvfrom(4096)[1]
        print("begun", flush=True)  # noqa: T201 - its output
        sent, begin_s = 0, time.monotonic()
        while (since_s := time.monotonic() - begin_s) < float(seconds):
            if sent >= since_s * flood.per_s:
                time.sleep(0.001)
                continue
            sender.sendto(flood.datagrams[sent % len(flood.datagrams)], to)
            sent += 1
    print(sent, flush=True)  # noqa: T201 - its output


if __name__ == "__main__":
    main(*sys.argv[1:])
