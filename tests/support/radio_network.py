"""A radio network that several stations are on.

`python -m tests.support.radio_network PORT FILE HOST STATION ...`: what vehicles send to PORT on loopback
goes to every STATION (HOST:PORT), and what any station sends goes to the vehicles. FILE keeps each datagram
of a station: when it came (CLOCK_MONOTONIC), and from which. It ends with SIGTERM.
"""

import selectors
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from pymavlink.dialects.v20 import common

from gcs.mavlink.codec import split, target_system

_RECORD: Final = struct.Struct("<dBH")  # time, station, length of the datagram that follows
_LARGEST: Final = 2048
_BUFFER: Final = 4 << 20


class Sent(NamedTuple):
    """One frame that a station sent."""

    time_s: float  # CLOCK_MONOTONIC
    station: int
    system_id: int  # of the vehicle that it is for
    message_id: int
    command: int  # of a COMMAND_LONG, otherwise 0


def sent(file: Path) -> Iterator[Sent]:
    """Setpoints and commands in a file, oldest first."""
    data, at, mavlink = file.read_bytes(), 0, common.MAVLink(None)
    kinds = {
        common.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        common.MAVLINK_MSG_ID_COMMAND_LONG,
    }
    while at < len(data):
        time_s, station, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size + length
        for frame in split(data[at - length : at]).frames:
            if frame.message_id not in kinds:
                continue
            is_command = frame.message_id == common.MAVLINK_MSG_ID_COMMAND_LONG
            command = mavlink.decode(bytearray(frame.raw)).command if is_command else 0
            yield Sent(time_s, station, target_system(frame), frame.message_id, command)


class Network:
    """Carries datagrams between the vehicles of one port and the stations."""

    def __init__(self, port: int, file: BinaryIO, host: str, stations: list[tuple[str, int]]) -> None:
        self._file, self._stations = file, stations
        self._inner, self._outer = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for each, address in ((self._inner, ("127.0.0.1", port)), (self._outer, (host, 0))):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            each.bind(address)
            each.setblocking(False)
        self._number = {address: number for number, (address, _) in enumerate(stations)}
        self._vehicles: tuple[str, int] | None = None

    def run(self, stops: list[int]) -> None:
        """Carry until a signal is in `stops`."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._inner, selectors.EVENT_READ)
            selector.register(self._outer, selectors.EVENT_READ)
            while not stops:
                selector.select(0.1)
                self._up()
                self._down()
                self._file.flush()

    def _up(self) -> None:
        for data, sender in _read(self._inner):
            self._vehicles = sender
            for station in self._stations:
                try:
                    self._outer.sendto(data, station)
                except OSError:  # nothing listens there (any more), or its buffer is full
                    continue

    def _down(self) -> None:
        for data, (host, _) in _read(self._outer):
            self._file.write(_RECORD.pack(time.monotonic(), self._number[host], len(data)) + data)
            if self._vehicles is not None:
                self._inner.sendto(data, self._vehicles)


def _read(one: socket.socket) -> Iterator[tuple[bytes, tuple[str, int]]]:
    while True:
        try:
            yield one.recvfrom(_LARGEST)
        except BlockingIOError:
            return
        except OSError:  # ICMP: a station that does not listen
            continue


def main(port: str, file: str, host: str, *stations: str) -> None:
    """Carry until SIGTERM."""
    stops: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _: stops.append(number))
    to = [(address, int(at)) for address, _, at in (each.partition(":") for each in stations)]
    with Path(file).open("wb") as written:
        Network(int(port), written, host, to).run(stops)


if __name__ == "__main__":
    main(*sys.argv[1:])
