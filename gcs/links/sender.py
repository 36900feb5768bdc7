"""Frames sent to vehicles: numbered, addressed, signed, and dropped after their time."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple

import numpy as np

from gcs.links.address_book import Addresses
from gcs.links.endpoints.ports import Ports
from gcs.links.link import Counters, FrameDirection, Observer
from gcs.links.senders import NOWHERE
from gcs.links.signing import SignatureFilter
from gcs.mavlink.codec import COMPONENT_ID, SYSTEM_ID, Frames, Records, encode, joined
from gcs.mavlink.kernels import Bytes, Whole
from gcs.mavlink.setpoints import setpoint_frames
from gcs.mavlink.setpoints import warm_up as setpoints_warm_up
from gcs.model.errors import InvalidError
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask, Setpoints

_SEND_MARGIN_S: Final = 0.02
"""Between the last reading of the clock and the datagram's leaving, other threads may hold the GIL."""

REMEMBERED: Final = 512
"""Times of setpoints that are kept for each vehicle."""


class SentSetpoints:
    """Times of the latest setpoints to n vehicles, rows as on the link.

    Attributes:
        newest_s: (n,) when the newest left, -inf before the first.
    """

    def __init__(self, count: int) -> None:
        self.newest_s: Array = np.full(count, -np.inf)
        self._times_s = np.zeros((REMEMBERED, count))
        self._count = np.zeros(count, np.int64)

    def note(self, rows: Whole, time_s: float) -> None:
        """Record a setpoint to each of `rows`, which are all different."""
        _note_sent(rows, time_s, self.newest_s, self._times_s, self._count)

    def times_s(self, row: int) -> tuple[float, ...]:
        """Times of one vehicle, oldest first."""
        count = int(self._count[row])
        places = np.arange(max(0, count - REMEMBERED), count) % REMEMBERED
        return tuple(self._times_s[places, row].tolist())


@kernel
def _note_sent(rows: Whole, time_s: float, newest_s: Array, times_s: Array, count: Whole) -> None:
    """As `SentSetpoints.note`; the last three (n,), (REMEMBERED, n) and (n,) are changed."""
    for row in rows:
        newest_s[row] = time_s
        times_s[count[row] % len(times_s), row] = time_s
        count[row] += 1


def before_it_leaves_s(setpoint_timeout_s: float) -> float:
    """Greatest age of a setpoint at its last check, so that it leaves within `setpoint_timeout_s`.

    Raises: InvalidError when no time is left.
    """
    if not setpoint_timeout_s > _SEND_MARGIN_S:
        raise InvalidError("setpoint_timeout_s", setpoint_timeout_s, f"above {_SEND_MARGIN_S} s")
    return setpoint_timeout_s - _SEND_MARGIN_S


class SetpointBatch(NamedTuple):
    """A tick's setpoints for the vehicles of a link that can receive them, the most urgent first."""

    rows: Whole  # (k,) none twice
    velocity_ned_m_s: Array  # (k, 3)
    yaw_rad: Array  # (k,) clockwise from north, within [-pi, pi)
    until_s: float  # none of these may leave later

    def part(self, rows: slice) -> "SetpointBatch":
        return SetpointBatch(self.rows[rows], self.velocity_ned_m_s[rows], self.yaw_rad[rows], self.until_s)


@kernel
def most_urgent_first(
    velocity_m_s: Array,
    yaw_rad: Array,
    at: Whole,
    rows: Whole,
    may_receive: Mask,
    heading_rad: float,
    sample_s: Array,
    answered_s: float,
) -> tuple[Whole, Array, Array, Array]:
    """Setpoints in NED for the vehicles that can receive them, oldest new sample first.

    Args:
        velocity_m_s: (m, 3) of a tick, show frame.
        yaw_rad: (m,) from the show's x axis.
        at: (k,) indices of this link's vehicles in them.
        rows: (k,) rows of these vehicles on the link.
        may_receive: (n,) by row; setpoints that are not finite are left out as well.
        heading_rad: of the show's x axis, clockwise from north.
        sample_s: (n,) arrival of each vehicle's newest position.
        answered_s: a position that arrived until then is not new.

    Returns: the fields of `SetpointBatch` but the last; (j,) arrival of each new sample, inf: no new one.
    """
    cosine, sine, count = np.cos(heading_rad), np.sin(heading_rad), 0
    fit, urgent_s = np.empty(len(at), np.int64), np.empty(len(at))
    for k in range(len(at)):
        i, row = at[k], rows[k]
        x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        if may_receive[row] and np.isfinite(x + y + z + yaw_rad[i]):
            fit[count] = k
            urgent_s[count] = sample_s[row] if sample_s[row] > answered_s else np.inf
            count += 1
    order = np.argsort(urgent_s[:count], kind="mergesort")  # stable
    ned_m_s, turned_rad = np.empty((count, 3)), np.empty(count)
    for place in range(count):
        i = at[fit[order[place]]]
        ned_m_s[place, 0] = cosine * velocity_m_s[i, 0] - sine * velocity_m_s[i, 1]
        ned_m_s[place, 1] = sine * velocity_m_s[i, 0] + cosine * velocity_m_s[i, 1]
        ned_m_s[place, 2] = velocity_m_s[i, 2]
        turned_rad[place] = (yaw_rad[i] + heading_rad + np.pi) % (2.0 * np.pi) - np.pi
    return rows[fit[order]], ned_m_s, turned_rad, urgent_s[order]


def warm_up() -> None:
    """Compile or load the kernels; setpoints are read-only arrays, which numba compiles as another type."""
    setpoints_warm_up()
    nothing = Setpoints(0.0, (), np.zeros((0, 3)), np.zeros(0))
    none, times_s = np.zeros(0, np.int64), np.zeros(0)
    can = np.zeros(0, np.bool_)
    SentSetpoints(1).note(none, 0.0)
    most_urgent_first(nothing.velocity_m_s, nothing.yaw_rad, none, none, can, 0.0, times_s, 0.0)


@dataclass(eq=False)
class Outbox:
    """Sends messages to rows of a link.

    Attributes:
        observers: receive every frame; replace the tuple, do not mutate it.
    """

    ports: Ports
    addresses: Addresses
    counters: Counters
    system_ids: Whole
    station_id: int = SYSTEM_ID
    signatures: SignatureFilter | None = None

    def __post_init__(self) -> None:
        self.observers: tuple[Observer, ...] = ()
        self._sequence: Bytes = np.zeros(len(self.system_ids), np.uint8)

    def encode(
        self, message_id: int, messages: Records, rows: Whole, *, component_id: int = COMPONENT_ID
    ) -> Frames:
        """Frames for `rows` (k,), all different, each vehicle's numbered in order; `component_id` is ours."""
        ours = {"system_id": self.station_id, "component_id": component_id}
        return encode(message_id, messages, self._next(rows), **ours)

    def encode_setpoints(
        self, rows: Whole, velocity_ned_m_s: Array, yaw_rad: Array, *, time_s: float
    ) -> Frames:
        """As `encode`, of the setpoints (k, 3) and yaws (k,) at `time_s`."""
        desired = self.system_ids[rows], velocity_ned_m_s, yaw_rad
        return setpoint_frames(*desired, self._next(rows), time_s=time_s, system_id=self.station_id)

    def _next(self, rows: Whole) -> Bytes:
        sequence = self._sequence[rows]
        self._sequence[rows] = sequence + np.uint8(1)
        return sequence

    def send(self, frames: Frames, rows: Whole, now_s: float, *, until_s: float = inf) -> Mask:
        """Send frame i to the source of row i of `rows`. Never blocks, never raises.

        Args:
            frames: (k,) whole.
            rows: (k,) their targets.
            now_s: the link's clock.
            until_s: no frame leaves later.

        Returns: (k,) whether each left.
        """
        return self._send(frames, self.addresses.source[rows], rows, now_s, until_s)

    def send_raw(self, raws: Sequence[bytes], rows: Whole, now_s: float) -> Mask:
        return self.send(joined(raws), rows, now_s)

    def broadcast(self, message_id: int, messages: Records, now_s: float) -> None:
        """Send messages (m,) to all systems: once to each known address, and to far ends still silent."""
        rows, many = self.addresses.one_per_source(), len(messages)
        sources = self.addresses.source[rows]
        silent = np.setdiff1d(np.array([*self.ports.standing()], np.int64), sources)
        sequence = np.zeros((many, len(rows) + len(silent)), np.uint8)  # silent ones are not numbered
        sequence[:, : len(rows)] = self._sequence[rows] + np.arange(many, dtype=np.uint8)[:, np.newaxis]
        self._sequence[rows] += np.uint8(many)
        destination = np.tile(np.concatenate([sources, silent]), many)
        repeated = messages.repeat(sequence.shape[1])
        frames = encode(message_id, repeated, sequence.ravel(), system_id=self.station_id)
        self._send(frames, destination, None, now_s, inf)

    def _send(
        self, frames: Frames, destination: Whole, rows: Whole | None, now_s: float, until_s: float
    ) -> Mask:
        """`rows` (k,) are the targets; None: all systems."""
        to = destination
        if self.signatures is not None:
            frames = self.signatures.signed(frames)
            to = np.where(frames.length == 0, NOWHERE, destination)
        left = self.ports.send(frames.data, frames.length, to, until_s=until_s)
        count = int(np.count_nonzero(left))
        self.counters.sent += count
        if count < len(left):
            self.counters.unroutable += int(np.count_nonzero(destination == NOWHERE))
        self.counters.send_errors, self.counters.no_room = self.ports.send_errors, self.ports.no_room
        if self.observers:
            targets = np.zeros(len(left), np.int64) if rows is None else self.system_ids[rows]
            for at in np.flatnonzero(left).tolist():
                raw = frames.data[at, : frames.length[at]].tobytes()
                for observer in self.observers:
                    observer(now_s, FrameDirection.SENT, raw, int(targets[at]))
        return left
