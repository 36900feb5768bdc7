"""What the fuzz run sends to each input: valid, nearly valid and random bytes, the same for the same seed."""

import random
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import development as dialect

from gcs.bus.bundles import bundles
from gcs.shows.timecode.midi import quarter_frames
from gcs.shows.timecode.smpte import Rate, label_at
from tests.support.rtcm import base_message, rtcm
from tests.support.timecode import rtp
from tests.support.tlog_files import frames
from tests.unit.links.test_link_fuzz import any_message, mutated

Make: TypeAlias = Callable[[random.Random], bytes]

RECORDINGS: Final = ("ardupilot/session.tlog.xz", "ardupilot/failsafes.tlog.xz", "ardupilot/kill.tlog.xz")
PER_RECORDING: Final = 2000
DATAGRAM_MAX: Final = 1400
ODD: Final = (float("nan"), float("inf"), -float("inf"), 3e38, -0.0, 1e-44)


def changed(chance: random.Random, data: bytes) -> bytes:
    """Some bytes other, missing or twice."""
    made = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8))):
        at = chance.randrange(len(made) + 1)
        match chance.randrange(3):
            case 0:
                made[at : at + 1] = chance.randbytes(1)
            case 1:
                del made[at : at + chance.randrange(20)]
            case _:
                made[at:at] = made[: chance.randrange(60)]
    return bytes(made[:DATAGRAM_MAX])


def odd_numbers(chance: random.Random) -> bytes:
    """A message of a vehicle of the fleet with numbers that no vehicle sends, and a valid checksum."""
    kind: Any = chance.choice(list(dialect.mavlink_map.values()))
    packer = dialect.MAVLink(
        None, srcSystem=chance.randrange(1, 5), srcComponent=chance.choice((1, 1, 100, 191))
    )
    content = b""
    for letter in kind.unpacker.format.strip("<>=!"):
        if letter in "fd":
            content += struct.pack(f"<{letter}", chance.choice(ODD))
    payload = (content + chance.choice((b"\x00", b"\xff", b"\x80")) * kind.unpacker.size)[
        : kind.unpacker.size
    ]
    return bytes(dialect.MAVLink_message(kind.id, kind.msgname)._pack(packer, kind.crc_extra, payload))


def wrong_length(chance: random.Random) -> bytes:
    """A message shorter or longer than its kind, with a valid checksum."""
    kind: Any = chance.choice(list(dialect.mavlink_map.values()))
    packer = dialect.MAVLink(None, srcSystem=chance.randrange(1, 5), srcComponent=1)
    payload = chance.randbytes(chance.choice((0, 1, kind.unpacker.size // 2, 255)))
    return bytes(dialect.MAVLink_message(kind.id, kind.msgname)._pack(packer, kind.crc_extra, payload))


def mavlink() -> dict[str, Make]:
    pool = [
        frame.raw
        for name in RECORDINGS
        for (_, frame), _ in zip(frames(name), range(PER_RECORDING), strict=False)
    ]

    def some(chance: random.Random) -> bytes:
        return b"".join(chance.choices(pool, k=chance.randrange(1, 12)))[:DATAGRAM_MAX]

    return {
        "recorded": some,
        "recorded-mutated": lambda chance: mutated(chance, pool)[:DATAGRAM_MAX],
        "any-message": any_message,
        "odd-numbers": odd_numbers,
        "wrong-length": wrong_length,
        "random": lambda chance: chance.randbytes(chance.randrange(1, DATAGRAM_MAX)),
        "markers": lambda chance: chance.choice((b"\xfd", b"\xfe", b"\xfd\xfe")) * chance.randrange(1, 700),
    }


def corrections() -> dict[str, Make]:
    pool = (base_message(), rtcm(1077, 200), rtcm(1005, 19), rtcm(1230, 8))
    return {
        "messages": lambda chance: rtcm(chance.randrange(4096), chance.randrange(2, 1000)),
        "mutated": lambda chance: changed(chance, b"".join(chance.choices(pool, k=4))),
        "preambles": lambda chance: b"\xd3" + bytes([chance.randrange(4)]) * chance.randrange(1, 1000),
        "random": lambda chance: chance.randbytes(chance.randrange(1, DATAGRAM_MAX)),
    }


def timecode() -> dict[str, Make]:
    def labels(chance: random.Random) -> bytes:
        rate = chance.choice(list(Rate))
        return b"".join(quarter_frames(label_at(chance.uniform(0.0, 86_000.0), rate), rate))

    return {
        "labels": labels,
        "mutated": lambda chance: changed(chance, labels(chance) * 4),
        "whole-frames": lambda chance: b"\xf0\x7f\x7f\x01\x01" + chance.randbytes(4) + b"\xf7",
        "rtp": lambda chance: changed(chance, rtp([labels(chance)])),
        "random": lambda chance: chance.randbytes(chance.randrange(1, DATAGRAM_MAX)),
    }


def bus(recorded: Mapping[str, Sequence[bytes]]) -> dict[str, Make]:
    """Bundles of a station. `recorded`: messages by topic as the station sends them."""
    topics = list(recorded)

    def of(content: Callable[[random.Random, str], bytes]) -> Make:
        def make(chance: random.Random) -> bytes:
            topic = chance.choice(topics)
            (bundle,) = bundles({topic: content(chance, topic)})
            return bundle

        return make

    valid: Make = of(lambda chance, topic: chance.choice(recorded[topic]))
    return {
        "mutated": of(lambda chance, topic: changed(chance, chance.choice(recorded[topic]))),
        "other-topic": of(lambda chance, _: chance.choice(recorded[chance.choice(topics)])),
        "random": of(lambda chance, _: chance.randbytes(chance.choice((0, 1, 7, 100, 5000)))),
        "json": of(lambda chance, _: b'{"a":' * chance.randrange(1, 5000)),
        "bundle-mutated": lambda chance: changed(chance, valid(chance)),
        "bundle-random": lambda chance: chance.randbytes(chance.choice((0, 1, 7, 100, 5000))),
    }
