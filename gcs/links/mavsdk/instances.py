"""Several MAVSDK instances behind one link.

Each has at most 64 vehicles, since its traffic grows with the square, and receives the bytes of its own
vehicles only.
"""

import selectors
from collections.abc import Collection, Sequence
from typing import Final

from gcs.links.endpoints import mmsg
from gcs.links.mavsdk.binding import MavsdkBinding, MavsdkVehicle
from gcs.links.settings import instances

_DATAGRAM_BYTES: Final = 1400
"""MAVSDK reads 2048 bytes of one."""


class MavsdkInstances:
    """The instances of one link.

    `open`, `discover` and `close` block, see `MavsdkBinding`; all else belongs on the loop's thread,
    between `open` and `close`.
    """

    def __init__(self, system_ids: Sequence[int], station_id: int) -> None:
        """As many instances as needed, of similar size."""
        count = instances(len(system_ids))
        self._fleets = tuple(MavsdkBinding(station_id) for _ in range(count))
        self._ids = tuple(frozenset(system_ids[index::count]) for index in range(count))
        self._waiting: dict[MavsdkBinding, list[bytes]] = {fleet: [] for fleet in self._fleets}
        self._of = {
            system_id: fleet for fleet, ids in zip(self._fleets, self._ids, strict=True) for system_id in ids
        }
        self._written = selectors.DefaultSelector()

    def open(self) -> None:
        """Start them. Raises: LinkError."""
        for fleet in self._fleets:
            fleet.open()
            self._written.register(fleet.loopback.fd, selectors.EVENT_READ, fleet)

    def take(self, room: mmsg.Batch) -> int:
        """Fill `room` with what they have written, in each one's order. Returns: number. Never blocks."""
        count = 0
        for key, _ in self._written.select(0):
            count += key.data.loopback.take(room, count)
        return count

    def receive(self, system_id: int, raw: bytes) -> None:
        """Keep a frame of a configured vehicle until `flush`."""
        self._waiting[self._of[system_id]].append(raw)

    def flush(self) -> None:
        """Give the kept frames to MAVSDK, many to a datagram. Frames without room are lost."""
        for fleet, frames in self._waiting.items():
            if not frames:
                continue
            datagram = bytearray()
            for raw in frames:
                if len(datagram) + len(raw) > _DATAGRAM_BYTES:
                    fleet.loopback.give(bytes(datagram))
                    datagram.clear()
                datagram += raw
            fleet.loopback.give(bytes(datagram))
            frames.clear()

    def discover(self, desired: Collection[int]) -> dict[int, MavsdkVehicle]:
        found: dict[int, MavsdkVehicle] = {}
        for fleet, ids in zip(self._fleets, self._ids, strict=True):
            missing = ids.intersection(desired)
            if missing:
                found |= fleet.discover(missing)
        return found

    def close(self) -> None:
        """End all instances; their plugins may not be used afterwards."""
        self._written.close()
        for fleet in self._fleets:
            fleet.destroy()
