"""Frames sent to vehicles: numbered, addressed, and dropped after their time."""

from math import inf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.counters import Counters, Direction, Observer
from gcs.links.udp.addresses import Addresses
from gcs.links.udp.sockets import Ports
from gcs.mavlink.codec import COMPONENT_ID, SYSTEM_ID, Frames, Records, encode
from gcs.mavlink.kernels import Bytes, Whole

_NOWHERE: Final = -1


class Outbox:
    """Sends messages to rows of a link.

    Attributes:
        observers: receive every frame; replace the tuple, do not mutate it.
    """

    def __init__(
        self,
        packets: Ports,
        addresses: Addresses,
        counters: Counters,
        system_ids: Whole,
        station_id: int = SYSTEM_ID,
    ) -> None:
        """`station_id` is our own system id."""
        self.observers: tuple[Observer, ...] = ()
        self._packets = packets
        self._addresses = addresses
        self._counters = counters
        self._system_ids = system_ids
        self._station_id = station_id
        self._sequence: Bytes = np.zeros(len(system_ids), np.uint8)

    def encode(
        self, message_id: int, messages: Records, rows: Whole, *, component_id: int = COMPONENT_ID
    ) -> Frames:
        """Frames for `rows` (k,), all different, each vehicle's numbered in order; `component_id` is ours."""
        sequence = self._sequence[rows]
        self._sequence[rows] = sequence + np.uint8(1)
        return encode(message_id, messages, sequence, system_id=self._station_id, component_id=component_id)

    def send(
        self, frames: Frames, rows: Whole, now_s: float, *, until_s: float = inf, to_all: bool = False
    ) -> NDArray[np.bool_]:
        """Send frame i to the source of row i of `rows`. Never blocks, never raises.

        Args:
            frames: (k,) whole.
            rows: (k,) their targets.
            now_s: the link's clock.
            until_s: no frame leaves later.
            to_all: observers receive target 0: the frames are for all systems behind those addresses.

        Returns: (k,) whether each left.
        """
        destination = self._addresses.source[rows]
        left = self._packets.send(frames.data, frames.length, destination, until_s=until_s)
        self._counters.sent += int(left.sum())
        self._counters.unroutable += int((destination == _NOWHERE).sum())
        self._counters.send_errors = self._packets.send_errors
        if self.observers:
            for at in np.flatnonzero(left).tolist():
                raw = frames.data[at, : frames.length[at]].tobytes()
                target = 0 if to_all else int(self._system_ids[rows[at]])
                for observer in self.observers:
                    observer(now_s, Direction.SENT, raw, target)
        return left

    def tell(
        self,
        message_id: int,
        messages: Records,
        rows: Whole,
        now_s: float,
        *,
        component_id: int = COMPONENT_ID,
    ) -> NDArray[np.bool_]:
        """Encode and send."""
        return self.send(self.encode(message_id, messages, rows, component_id=component_id), rows, now_s)
