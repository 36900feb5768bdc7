"""Velocity setpoints sent over UDP: each is checked, and a tick's setpoints leave with a few system calls."""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.links.address_book import Address
from gcs.links.counters import Counters, Direction, Observer
from gcs.links.endpoints import Endpoint
from gcs.links.endpoints.udp import Udp
from gcs.links.kill_latch import KillLatch
from gcs.links.mmsg import Batch
from gcs.links.setpoint_watchdog import ExpectedSetpoints, SetpointWatchdog
from gcs.mavlink.codec import Records
from gcs.mavlink.setpoint_kernels import FRAME, are_setpoints, warm_up
from gcs.model.state import Array

_ROOM: Final = 256


class _Way(NamedTuple):
    """Setpoints that leave through one socket."""

    rows: list[int]
    targets: list[int]
    addresses: list[Address]


class SetpointGate:
    """Passes the setpoints that `Router.send` would pass one by one. Used on the loop's thread."""

    def __init__(
        self,
        *,
        setpoint_watchdog: SetpointWatchdog,
        latch: KillLatch,
        asked: ExpectedSetpoints | None,
        address_of: Callable[[int], Address | None],
        endpoints: Sequence[Endpoint],
        counters: Counters,
        clock: Callable[[], float],
        failed: Callable[[Address, OSError], None],
    ) -> None:
        """See `Router`; `failed` is called for every datagram that could not leave."""
        warm_up()
        self._setpoint_watchdog = setpoint_watchdog
        self._latch = latch
        self._asked = asked
        self._address_of = address_of
        self._endpoints = endpoints
        self._counters = counters
        self._clock = clock
        self._failed = failed
        self._out = Batch(_ROOM, FRAME.itemsize)

    def send(
        self, written: Batch, count: int, left: Callable[[int], None], observers: Sequence[Observer]
    ) -> list[int]:
        """Send those of the first `count` datagrams that are one velocity setpoint each.

        Args:
            written: datagrams that MAVSDK wrote.
            count: number of datagrams.
            left: called with the target of every setpoint that has left.
            observers: called with every frame that has left.

        Returns: the rows that are anything else, or that do not leave over UDP, in order.
        """
        is_setpoint = are_setpoints(written.data, written.length, count)
        others: list[int] = np.flatnonzero(~is_setpoint).tolist()
        rows = np.flatnonzero(is_setpoint)
        stated = frames_of(written, rows)["stated"]
        velocities = np.stack([stated["vx"], stated["vy"], stated["vz"]], axis=1)
        ways: dict[int, _Way] = {}
        now_s = self._clock()
        for at, (row, target) in enumerate(zip(rows.tolist(), stated["target_system"].tolist(), strict=True)):
            address = self._address_of(target)
            if address is None or not isinstance(self._endpoints[address.socket_index], Udp):
                others.append(row)
            elif self._latch.is_shut(target):
                self._counters.commands_dropped += 1
            elif not self._setpoint_watchdog.allows(target, now_s) or not self._is_newest(
                target, velocities[at]
            ):
                self._counters.setpoints_dropped += 1
            else:
                way = ways.setdefault(address.socket_index, _Way([], [], []))
                way.rows.append(row)
                way.targets.append(target)
                way.addresses.append(address)
        for index, way in ways.items():
            endpoint = self._endpoints[index]
            if isinstance(endpoint, Udp):
                for first in range(0, len(way.rows), _ROOM):
                    end = first + _ROOM
                    part = _Way(way.rows[first:end], way.targets[first:end], way.addresses[first:end])
                    self._send(endpoint, written, part, left, observers)
        return sorted(others)

    def _send(
        self,
        endpoint: Udp,
        written: Batch,
        way: _Way,
        left: Callable[[int], None],
        observers: Sequence[Observer],
    ) -> None:
        first, end = 0, len(way.rows)
        self._out.data[:end] = written.data[way.rows, : FRAME.itemsize]
        self._out.length[:end] = FRAME.itemsize
        self._out.address([(address.host, address.port) for address in way.addresses])
        while first < end:
            # Check again right before the call: the process may have been suspended since the last check.
            if not self._setpoint_watchdog.is_alive(self._clock()):
                self._counters.setpoints_dropped += end - first
                return
            try:
                count = endpoint.send_batch(self._out, first, end)
            except OSError as error:
                self._failed(way.addresses[first], error)
                first += 1
                continue
            now_s = self._clock()
            for at in range(first, first + count):
                left(way.targets[at])
                for observer in observers:
                    observer(now_s, Direction.SENT, self._out.data[at].tobytes(), way.targets[at])
            self._counters.sent += count
            first += count

    def _is_newest(self, target: int, velocity_m_s: Array) -> bool:
        return self._asked is None or self._asked.is_newest(target, velocity_m_s.tobytes())


def frames_of(written: Batch, rows: NDArray[np.intp]) -> Records:
    """Datagrams of that length, as (k,) of `FRAME`."""
    return written.data[rows, : FRAME.itemsize].copy().view(FRAME)[:, 0]
