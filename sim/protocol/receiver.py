"""Received datagrams, passed to their vehicles: setpoints all at once, everything else one by one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.sim.protocol import frames
from gcs.sim.protocol.autopilot import Autopilot
from gcs.sim.protocol.frames import AUTOPILOT_COMPONENT, MAGIC, Codec, Message
from gcs.sim.vehicle.dynamics import Array, Mask
from gcs.sim.vehicle.state import Rows, State

BROADCAST = 0  # as target system or component
NO_ROW = -1
ADDRESSES = 256
SETPOINT_NAME = frames.SETPOINT.msgname


class Receiver:
    """Passes messages to vehicles. A circle is the vehicles on one socket; their system ids differ."""

    def __init__(self, state: State, autopilots: Sequence[Autopilot]) -> None:
        """Row i of the state is autopilots[i]; at first every vehicle alone is circle number `row`."""
        self._state = state
        self._autopilots = autopilots
        self._codec = Codec()
        self._rows = [[row] for row in range(len(autopilots))]
        self._row_of = np.full((len(autopilots), ADDRESSES), NO_ROW, dtype=np.int32)
        self._row_of[np.arange(len(autopilots)), state.system_id] = np.arange(len(autopilots))

    def circle(self, rows: Sequence[int]) -> int:
        """Let these vehicles share a socket. Returns: the circle's number."""
        row_of = np.full((1, ADDRESSES), NO_ROW, dtype=np.int32)
        self._row_of = np.concatenate([self._row_of, row_of])
        self._rows.append([])
        self.regroup(len(self._rows) - 1, rows)
        return len(self._rows) - 1

    def regroup(self, circle: int, rows: Sequence[int]) -> None:
        """Let exactly these vehicles receive from the socket."""
        self._rows[circle] = list(rows)
        self._row_of[circle] = NO_ROW
        self._row_of[circle, self._state.system_id[self._rows[circle]]] = rows

    def receive(self, batch: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Process (circle, datagram)s that arrived together; setpoints first, then the rest in order.

        Invalid bytes, messages for other vehicles and unknown messages change nothing.

        Returns: for each whether it contains a valid frame, whatever its target.
        """
        if not batch:
            return []
        valid = [False] * len(batch)
        plain = [
            place
            for place, (_, datagram) in enumerate(batch)
            if len(datagram) % frames.SETPOINT_FRAME == 0 and datagram[:1] == b"\xfd"
        ]
        read = self._receive_setpoints(batch, plain, valid) if plain else set()
        for place, (circle, datagram) in enumerate(batch):
            if place not in read:
                valid[place] = self._receive_other(circle, datagram)
        return valid

    def _receive_setpoints(
        self, batch: Sequence[tuple[int, bytes]], places: Sequence[int], valid: list[bool]
    ) -> set[int]:
        """Process the datagrams that contain only setpoints with one target each. Returns: their places."""
        found = frames.setpoints(b"".join([batch[place][1] for place in places]))
        if found is None:
            places = [p for p in places if frames.setpoints(batch[p][1]) is not None]
            found = frames.setpoints(b"".join([batch[place][1] for place in places]))
            if found is None:
                return set()
        messages, sender, good = found
        counts = [len(batch[place][1]) // frames.SETPOINT_FRAME for place in places]
        owner = np.repeat(np.arange(len(places)), counts)
        plain = good & (messages["target_system"] != BROADCAST)
        fit = np.ones(len(places), dtype=np.bool_)
        fit[owner[~plain]] = False
        circle = np.array([batch[place][0] for place in places])[owner]
        row = self._row_of[circle, messages["target_system"]].astype(np.intp)
        component = messages["target_component"]
        meant = fit[owner] & (row != NO_ROW) & ((component == BROADCAST) | (component == AUTOPILOT_COMPONENT))
        itself = (sender[:, 0] == self._state.system_id[row]) & (sender[:, 1] == AUTOPILOT_COMPONENT)
        meant &= ~itself
        for invalid in store_setpoints(self._state, row[meant], messages[meant]):
            self._autopilots[invalid].report_invalid()
        read = {place for place, whole in zip(places, fit.tolist(), strict=True) if whole}
        for place in read:
            valid[place] = True
        return read

    def _receive_other(self, circle: int, datagram: bytes) -> bool:
        if MAGIC not in datagram:
            return False
        messages = self._codec.decode(datagram)
        for message in messages:
            rows = self._addressed(circle, message)
            if message.get_type() == SETPOINT_NAME:
                self._receive_setpoint(rows, message)
                continue
            for row in rows:
                self._autopilots[row].receive(message)
        return bool(messages)

    def _addressed(self, circle: int, message: Message) -> list[int]:
        system = getattr(message, "target_system", BROADCAST)
        if getattr(message, "target_component", BROADCAST) not in {BROADCAST, AUTOPILOT_COMPONENT}:
            return []
        if system == BROADCAST:
            return self._rows[circle]
        row = int(self._row_of[circle, system])
        return [] if row == NO_ROW else [row]

    def _receive_setpoint(self, rows: Sequence[int], message: Message) -> None:
        received = np.array(
            [row for row in rows if not self._autopilots[row].is_sender(message)], dtype=np.intp
        )
        if len(received):
            message = np.repeat(frames.record(message), len(received))
            for invalid in store_setpoints(self._state, received, message):
                self._autopilots[invalid].report_invalid()


LOCAL_NED, BODY_NED = 1, 8  # MAV_FRAME
IGNORE_YAW, IGNORE_YAW_RATE = 0x400, 0x800
AXES = 9  # of position, velocity and acceleration: the lowest bits of the mask, in the order of the payload
FIRST_AXIS_AT = 4


def store_setpoints(state: State, rows: Rows, messages: NDArray[np.void]) -> Rows:
    """Store SET_POSITION_TARGET_LOCAL_NED (m,), one for each of these rows (m,), as PX4 does.

    Of several for one vehicle the last counts. A frame other than local or body NED is refused without a
    report. A body frame is turned by the vehicle's yaw; PX4 does not support a position in it, so that is
    dropped. Infinity is treated as NaN.

    Returns: the rows whose setpoint commands nothing (item 10): they are unchanged.
    """
    frame = messages["coordinate_frame"]
    known = (frame == LOCAL_NED) | (frame == BODY_NED)
    if not known.all():
        rows, messages, frame = rows[known], messages[known], frame[known]
    messages_si = _given(messages)
    position_m, velocity_m_s, acceleration_m_s2 = messages_si
    mask = messages["type_mask"]
    yaw_rad: Array = np.where(mask & IGNORE_YAW, np.nan, _finite(messages["yaw"]))
    body = frame == BODY_NED
    if body.any():
        heading_rad = state.yaw_rad[rows[body]]
        position_m[body] = np.nan
        velocity_m_s[body] = _turned(velocity_m_s[body], heading_rad)
        acceleration_m_s2[body] = _turned(acceleration_m_s2[body], heading_rad)
        yaw_rad[body] += heading_rad
    given: Mask = ~np.isnan(messages_si)
    says: Mask = np.any(given, axis=(0, 2))
    pairs: Mask = np.equal(given[:, :, 0], given[:, :, 1])  # north and east come together
    flyable: Mask = np.all(pairs, axis=0) & np.all(np.any(given, axis=0), axis=1)
    received = rows if says.all() else rows[says]
    state.setpoint_s[received] = state.now_s
    state.setpoint_seen[received] = True
    state.setpoint_position_m[received] = position_m[says]
    state.setpoint_velocity_m_s[received] = velocity_m_s[says]
    state.setpoint_flyable[received] = flyable[says]
    state.setpoint_yaw_rad[received] = yaw_rad[says]
    rate_rad_s = np.where(mask & IGNORE_YAW_RATE, np.nan, _finite(messages["yaw_rate"]))
    state.setpoint_yaw_rate_rad_s[received] = rate_rad_s[says]
    return rows[~says]


def _given(messages: NDArray[np.void]) -> Array:
    """(3, m, 3): positions, velocities and accelerations, NaN where an axis is ignored or not a number."""
    raw = messages.view(np.uint8).reshape(len(messages), messages.itemsize)[
        :, FIRST_AXIS_AT : FIRST_AXIS_AT + 4 * AXES
    ]
    values = _finite(np.ascontiguousarray(raw).view("<f4"))
    ignored = messages["type_mask"][:, np.newaxis] >> np.arange(AXES, dtype=np.uint16) & 1
    values[ignored != 0] = np.nan
    return np.ascontiguousarray(values.reshape(-1, 3, 3).transpose(1, 0, 2))


def _finite(values: NDArray[np.float32]) -> Array:
    values_64 = values.astype(np.float64)
    values_64[~np.isfinite(values_64)] = np.nan
    return values_64


def _turned(vector: Array, yaw_rad: Array) -> Array:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    forward, right, down = vector.T
    return np.stack([cos * forward - sin * right, sin * forward + cos * right, down], axis=1)
