"""True states of the vehicles, as their simulators send them.

PX4's SIH and the fake fleet send HIL_STATE_QUATERNION on the simulator link. ArduPilot's SITL sends the
FGNetFDM of FlightGear (version 24, big-endian) instead; its second serial port is a MAVLink port, on which
it also prints the text of its start.
"""

import math
import selectors
import socket
import struct
import time
from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.cli.demo.demo_report import SAMPLE_S, GroundTruth
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, Mask
from tests.support.background import Background

ABOVE_PAD_M = 0.5
"""A vehicle this far above its pad is airborne: SIH's ground is level, and the true state has no noise."""

GONE_S = 1.0
"""A vehicle that has sent nothing for this long is gone: its process was ended."""

LONGEST_DATAGRAM = 2048

STATION = 255
"""System id of the one that sets parameters of the simulation."""

FDM, FDM_VERSION = struct.Struct(">II3d"), 24
"""Its head: version, padding; longitude and latitude in radians, altitude in metres."""

FDM_PORT, FDM_PORTS_APART = 5503, 10
"""Instance i sends to this port + 10 i."""

CLOCKS = ("HIL_ACTUATOR_CONTROLS", "HIL_STATE_QUATERNION", "TIMESYNC")
"""Messages with the simulated time, the best first. PX4 v1.16 leaves that of HIL_STATE_QUATERNION empty."""

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
        self._clocks = [{name: list[tuple[float, float]]() for name in CLOCKS} for _ in range(count)]
        self._ports: list[socket.socket] = []  # of MAVLink
        self._simulators: dict[int, tuple[str, int]] = {}  # which address sends the MAVLink of instance i
        self._selector = selectors.DefaultSelector()
        super().__init__("truth")
        for index in range(count):
            self._listen(first_port + index, index, _decoder())
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
        if decoder is not None:
            self._ports.append(port)
        self._selector.register(port, selectors.EVENT_READ, (index, decoder))

    def _live(self) -> None:
        while not self._stopped.is_set():
            for key, _ in self._selector.select(0.1):
                index, decoder = key.data
                data, sender = key.fileobj.recvfrom(LONGEST_DATAGRAM)  # type: ignore[union-attr]  # a socket
                now_s = time.monotonic()
                if decoder is None:
                    self._take_fdm(index, data, now_s)
                else:
                    self._simulators[index] = sender
                    self._take_mavlink(index, decoder.parse_buffer(data) or (), now_s)

    def _take_fdm(self, index: int, data: bytes, now_s: float) -> None:
        places = self._places[index]
        if places and now_s - places[-1][0] < KEPT_EVERY_S:
            return
        if (place := fdm_place(data)) is not None:
            places.append((now_s, *place))

    def _take_mavlink(self, index: int, messages: Sequence[Any], now_s: float) -> None:
        for message in messages:
            name = message.get_type()
            if name == "HIL_STATE_QUATERNION":
                place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
                self._places[index].append((now_s, *place))
            if name == "TIMESYNC" and message.tc1 == 0:
                self._clocks[index][name].append((now_s, message.ts1 * 1e-9))
            elif name.startswith("HIL_") and name in CLOCKS:
                self._clocks[index][name].append((now_s, message.time_usec * 1e-6))

    def set_parameters(self, index: int, values: Mapping[str, float | int]) -> None:
        """Set parameters of instance `index` over its simulator link; whole numbers as PX4 encodes them.

        Raises: OSError when it has sent nothing yet.
        """
        if index not in self._simulators:
            raise OSError(f"instance {index} has sent nothing on its simulator link")
        encoder = common.MAVLink(None, srcSystem=STATION, srcComponent=common.MAV_COMP_ID_MISSIONPLANNER)
        for name, value in values.items():
            whole = isinstance(value, int)
            raw = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
            kind = common.MAV_PARAM_TYPE_INT32 if whole else common.MAV_PARAM_TYPE_REAL32
            message = common.MAVLink_param_set_message(index + 1, 1, name.encode(), raw, kind)
            self._ports[index].sendto(message.pack(encoder), self._simulators[index])

    @property
    def silent(self) -> list[int]:
        """Instances that have not sent their true state twice."""
        return [index for index, places in enumerate(self._places) if len(places) < 2]

    def truth(self, frame: ShowFrame) -> GroundTruth:
        """All that was received, at common times, in the show frame.

        Raises: ValueError naming the vehicles that sent nothing.
        """
        if self.silent:
            raise ValueError(f"no true state was received from instances {self.silent}")
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
            airborne.append((above_m > ABOVE_PAD_M) & _is_there(track[:, 0], time_s))
        flying = np.stack(airborne, axis=1)
        return GroundTruth(time_s, np.stack(position_m, axis=1), flying, ~flying[-1])

    def simulated_per_wall_s(self) -> float | None:
        """Simulated over wall time of the slowest vehicle; below 0.98 the machine was too slow.

        None: not known.
        """
        shares = [share for clocks in self._clocks if (share := _share(clocks.values())) is not None]
        return min(shares, default=None)


def _decoder() -> common.MAVLink:
    """Text between the frames is passed over: ArduPilot prints that of its start on every serial port."""
    decoder = common.MAVLink(None)
    decoder.robust_parsing = True
    return decoder


def _is_there(sent_s: Array, time_s: Array) -> Mask:
    """(k,) whether a vehicle that sent at these times is there at `time_s`: its process may have ended."""
    last = np.searchsorted(sent_s, time_s, side="right") - 1
    there: Mask = time_s - sent_s[np.maximum(last, 0)] < GONE_S
    return there


def _share(clocks: Iterable[Sequence[tuple[float, float]]]) -> float | None:
    """Simulated over wall time by the first clock that advances; a restart begins another time."""
    for clock in clocks:
        track: Array = np.array(clock).reshape(-1, 2)
        step_s = np.diff(track, axis=0)
        step_s = step_s[step_s[:, 1] >= 0.0]
        if step_s[:, 1].sum() > 0.0:
            wall_s, simulated_s = step_s.sum(axis=0)
            return float(simulated_s / wall_s)
    return None
