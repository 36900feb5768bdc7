"""True states of the vehicles, received on the simulator link."""

import selectors
import socket
import threading
import time
from types import TracebackType
from typing import Self

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.cli.demo_report import SAMPLE_S, GroundTruth
from gcs.model.frames import ShowFrame
from gcs.model.state import Array

ABOVE_PAD_M = 0.5
"""A vehicle this far above its pad is airborne: SIH's ground is level, and the true state has no noise."""

GONE_S = 1.0
"""A vehicle that has sent nothing for this long is gone: its process was ended."""

LONGEST_DATAGRAM = 2048


class GroundTruthRecorder:
    """Receives HIL_STATE_QUATERNION of `count` vehicles on consecutive ports, on a thread of its own."""

    def __init__(self, first_port: int, count: int) -> None:
        """Raises: OSError when a port is taken."""
        self._samples: list[list[tuple[float, float, float, float, float]]] = [[] for _ in range(count)]
        self._selector = selectors.DefaultSelector()
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._receive, name="truth")
        for index in range(count):
            port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            port.bind(("127.0.0.1", first_port + index))
            port.setblocking(False)
            self._selector.register(port, selectors.EVENT_READ, (index, common.MAVLink(None)))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stopped.set()
        self._thread.join()
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]  # a socket, see above

    @property
    def received_from(self) -> list[bool]:
        """Whether each vehicle has sent its state at least once."""
        return [bool(samples) for samples in self._samples]

    def _receive(self) -> None:
        while not self._stopped.is_set():
            for key, _ in self._selector.select(0.1):
                index, decoder = key.data
                data = key.fileobj.recv(LONGEST_DATAGRAM)  # type: ignore[union-attr]  # a socket, see above
                now_s = time.monotonic()
                for message in decoder.parse_buffer(data) or ():
                    if message.get_type() == "HIL_STATE_QUATERNION":
                        place = (message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3)
                        self._samples[index].append((now_s, *place, message.time_usec * 1e-6))

    def truth(self, frame: ShowFrame) -> GroundTruth:
        """All that was received, at common times, in the show frame.

        Raises: ValueError naming the vehicles that sent nothing.
        """
        silent = [index for index, samples in enumerate(self._samples) if len(samples) < 2]
        if silent:
            raise ValueError(f"no true state was received from instances {silent}")
        trajectories = [np.array(samples) for samples in self._samples]
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

    def simulated_per_wall_s(self) -> float:
        """Simulated over wall time of the slowest vehicle; below 0.98 the machine was too slow."""
        shares = []
        for samples in self._samples:
            track: Array = np.array(samples)
            shares.append((track[-1, 4] - track[0, 4]) / (track[-1, 0] - track[0, 0]))
        return float(min(shares))
