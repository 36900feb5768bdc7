"""Recorded frames of a vehicle, read as a link reads them."""

import lzma
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gcs.links.telemetry import FleetTelemetry
from gcs.mavlink import codec
from gcs.mavlink.framing import Frame

DATA = Path(__file__).parents[1] / "data"

_TIME_BYTES = 8


def frames(name: str) -> Iterator[tuple[float, Frame]]:
    """The frames of a compressed .tlog, each with its time in seconds since the first."""
    data = lzma.decompress((DATA / name).read_bytes())
    at, first_s = 0, None
    while at < len(data):
        time_s = int.from_bytes(data[at : at + _TIME_BYTES], "big") / 1e6
        first_s = time_s if first_s is None else first_s
        at += _TIME_BYTES
        version_2 = data[at] == 0xFD
        length = data[at + 1] + (12 if version_2 else 8)
        yield time_s - first_s, codec.split(data[at : at + length]).frames[0]
        at += length


def read(fleet: FleetTelemetry, time_s: float, frame: Frame) -> None:
    """Let the only vehicle of a fleet send a frame."""
    data = np.frombuffer(bytearray(frame.raw), np.uint8)
    found = codec.find(data, np.array([0]), np.array([len(data)])).frames
    fleet.take(data, found, np.zeros(1, np.int64), np.array([time_s]))
