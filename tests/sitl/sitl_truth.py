"""True states of the vehicles, as their simulators send them.

PX4's SIH and the fake fleet send HIL_STATE_QUATERNION on the simulator link. ArduPilot's SITL sends the
FGNetFDM of FlightGear (version 24, big-endian) instead, and its time in the TIMESYNC of its second
serial port.
"""

import math
import selectors
import socket
import struct
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.cli.demo_report import SAMPLE_S, GroundTruth
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from tests.support.background import Background

ABOVE_PAD_M = 0.5
"""A vehicle this far above its pad is airborne: SIH's ground is level, and the true state has no noise."""

GONE_S = 1.0
"""A vehicle that has sent nothing for this long is gone: its process was ended."""

LONGEST_DATAGRAM = 2048

FDM, FDM_VERSION = struct.Struct(">II3d"), 24
"""Its head: version, padding; longitude and latitude in radians, altitude in metres."""

FDM_PORT, FDM_PORTS_APART = 5503, 10
"""Instance i sends to this port + 10 i."""

KEPT_EVERY_S = 0.02
"""ArduPilot sends one packet for each step of its physics, a thousand a second."""


def fdm_place(data: bytes) -> tuple[float, float, float] | None:
    """Latitude, longitude in degrees, and altitude AMSL in metres, of an FGNetFDM; None: it is none."""
    if len(data) < FDM.size:
        return None
    version, _, longitude_rad, latitude_rad, altitude_m = FDM.unpack_from(data)
    if version != FDM_VERSION:
        return None
    return math.degrees(latitude_rad), math.degrees(longitude_rad), altitude_m


class GroundTruthRecorder(Background):
    """Receives the true states of `count` vehicles, on a thread of its own."""

    def __init__(self, first_port: int, count: int, *, fdm_port: int | None = None) -> None:
        """MAVLink of vehicle i comes to `first_port` + i, FGNetFDM to `fdm_port` + 10 i; None: there is none.

        Raises: OSError when a port is taken.
        """
        self._places: list[list[tuple[float, float, float, float]]] = [[] for _ in range(count)]
        self._clocks: list[list[tuple[float, float]]] = [[] for _ in range(count)]
        self._selector = selectors.DefaultSelector()
        super().__init__("truth")
        for index in range(count):
            self._listen(first_port + index, index, common.MAVLink(None))
            if fdm_port is not None:
                self._listen(fdm_port + FDM_PORTS_APART * index, index, None)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]  # a socket, see above

    def _listen(self, number: int, index: int, decoder: common.MAVLink | None) -> None:
        port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        port.bind(("127.0.0.1", number))
        port.setblocking(False)
        self._selector.register(port, selectors.EVENT_READ, (index, decoder))

    def _live(self) -> None:
        while not self._stopped.is_set():
            for key, _ in self._selector.select(0.1):
                index, decoder = key.data
                data = key.fileobj.recv(LONGEST_DATAGRAM)  # type: ignore[union-attr]  # a socket, see above
                now_s = time.monotonic()
                if decoder is None:
                    self._take_fdm(index, data, now_s)
                else:
                    self._take_mavlink(index, decoder.parse_buffer(data) or (), now_s)

    def _take_fdm(self, index: int, data: bytes, now_s: float) -> None:
        places = self._places[index]
        if places and now_s - places[-1][0] < KEPT_EVERY_S:
            return
        if (place := fdm_place(data)) is not None:
            places.append((now_s, *place))

    def _take_mavlink(self, index: int, messages: Sequence[Any], now_s: float) -> None:
        for message in messages:
            if message.get_type() == "HIL_STATE_QUATERNION":
                place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
                self._places[index].append((now_s, *place))
                self._clocks[index].append((now_s, message.time_usec * 1e-6))
            elif message.get_type() == "TIMESYNC" and message.tc1 == 0:
                self._clocks[index].append((now_s, message.ts1 * 1e-9))

    def truth(self, frame: ShowFrame) -> GroundTruth:
        """All that was received, at common times, in the show frame.

        Raises: ValueError naming the vehicles that sent nothing.
        """
        silent = [index for index, places in enumerate(self._places) if len(places) < 2]
        if silent:
            raise ValueError(f"no true state was received from instances {silent}")
        trajectories = [np.array(places) for places in self._places]
        time_s = np.arange(
            max(track[0, 0] for track in trajectories), max(track[-1, 0] for track in trajectories), SAMPLE_S
        )
        position_m, airborne = [], []
        for track in trajectories:
            own_m = frame.position_m(track[:, 1], track[:, 2], track[:, 3])
            position_m.append(
                np.stack([np.interp(time_s, track[:, 0], own_m[:, k]) for k in range(3)], axis=1)
            )
            above_m = own_m[0, 2] - position_m[-1][:, 2]
            airborne.append((above_m > ABOVE_PAD_M) & (time_s < track[-1, 0] + GONE_S))
        flying = np.stack(airborne, axis=1)
        return GroundTruth(time_s, np.stack(position_m, axis=1), flying, ~flying[-1])

    def simulated_per_wall_s(self) -> float | None:
        """Simulated over wall time of the slowest vehicle; below 0.98 the machine was too slow.

        None: not known.
        """
        shares = []
        for clock in self._clocks:
            track: Array = np.array(clock)
            if len(track) > 1:
                shares.append(float((track[-1, 1] - track[0, 1]) / (track[-1, 0] - track[0, 0])))
        return min(shares, default=None)
