"""Several MAVSDK instances behind one link.

Each knows at most 64 vehicles, since its chatter grows with the square, and is shown the bytes of its own
vehicles only.
"""

from collections.abc import Collection, Sequence
from functools import partial
from typing import Protocol

from gcs.links.mavlink_frames import Frame
from gcs.links.mavsdk_fleet import MavsdkFleet, MavsdkVehicle
from gcs.links.vehicle_ids import instances


class Send(Protocol):
    """How frames leave; see `Wire.send`."""

    def __call__(self, data: bytes, *, to_everybody: bool = True) -> None:
        """Send."""
        ...


class MavsdkShards:
    """The instances of one link. `open`, `discover` and `destroy` block; see `MavsdkFleet`."""

    def __init__(self, system_ids: Sequence[int], station_id: int, send: Send) -> None:
        """As many instances as need be, alike in size. Of them all the first alone speaks to everybody."""
        count = instances(len(system_ids))
        self._fleets = tuple(
            MavsdkFleet(partial(send, to_everybody=index == 0), station_id) for index in range(count)
        )
        self._ids = tuple(frozenset(system_ids[index::count]) for index in range(count))
        self._waiting: dict[MavsdkFleet, list[bytes]] = {fleet: [] for fleet in self._fleets}
        self._of = {
            system_id: fleet for fleet, ids in zip(self._fleets, self._ids, strict=True) for system_id in ids
        }

    def open(self) -> None:
        """Start them. Raises: LinkError."""
        for fleet in self._fleets:
            fleet.open()

    def receive(self, frame: Frame) -> None:
        """Keep a frame of a configured vehicle until `flush`."""
        self._waiting[self._of[frame.system_id]].append(frame.raw)

    def flush(self) -> None:
        """Hand over what is kept, at once: a call costs as much as reading ten frames. See `receive`.

        Only between `open` and `destroy`.
        """
        for fleet, frames in self._waiting.items():
            if frames:
                fleet.receive(b"".join(frames))
                frames.clear()

    def discover(self, wanted: Collection[int]) -> dict[int, MavsdkVehicle]:
        """Those of the wanted systems that have been met, with fresh plugins."""
        found: dict[int, MavsdkVehicle] = {}
        for fleet, ids in zip(self._fleets, self._ids, strict=True):
            missing = ids.intersection(wanted)
            if missing:
                found |= fleet.discover(missing)
        return found

    def destroy(self) -> None:
        """End them all; no plugin may be used afterwards."""
        for fleet in self._fleets:
            fleet.destroy()
