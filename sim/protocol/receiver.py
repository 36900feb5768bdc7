"""Received datagrams, passed to their vehicles: setpoints all at once, everything else one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.sim.protocol import frames, setpoints
from gcs.sim.protocol.mavlink import AUTOPILOT_COMPONENT, MAGIC, Codec

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.sim.protocol.autopilot import Autopilot
    from gcs.sim.protocol.mavlink import Message
    from gcs.sim.vehicle.state import State

EVERYONE = 0  # as target system or component
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

    def hear(self, batch: Sequence[tuple[int, bytes]]) -> list[bool]:
        """Process (circle, datagram)s that arrived together; setpoints first, then the rest in order.

        Invalid bytes, messages for other vehicles and unknown messages change nothing.

        Returns: for each whether it contains a valid frame, whatever its target.
        """
        if not batch:
            return []
        sound = [False] * len(batch)
        plain = [
            place
            for place, (_, datagram) in enumerate(batch)
            if len(datagram) % frames.SETPOINT_FRAME == 0 and datagram[:1] == b"\xfd"
        ]
        read = self._hear_setpoints(batch, plain, sound) if plain else set()
        for place, (circle, datagram) in enumerate(batch):
            if place not in read:
                sound[place] = self._hear_any(circle, datagram)
        return sound

    def _hear_setpoints(
        self, batch: Sequence[tuple[int, bytes]], places: Sequence[int], sound: list[bool]
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
        plain = good & (messages["target_system"] != EVERYONE)
        fit = np.ones(len(places), dtype=np.bool_)
        fit[owner[~plain]] = False
        circle = np.array([batch[place][0] for place in places])[owner]
        row = self._row_of[circle, messages["target_system"]].astype(np.intp)
        component = messages["target_component"]
        meant = fit[owner] & (row != NO_ROW) & ((component == EVERYONE) | (component == AUTOPILOT_COMPONENT))
        itself = (sender[:, 0] == self._state.system_id[row]) & (sender[:, 1] == AUTOPILOT_COMPONENT)
        meant &= ~itself
        for invalid in setpoints.obey(self._state, row[meant], messages[meant]):
            self._autopilots[invalid].say_invalid()
        read = {place for place, whole in zip(places, fit.tolist(), strict=True) if whole}
        for place in read:
            sound[place] = True
        return read

    def _hear_any(self, circle: int, datagram: bytes) -> bool:
        if MAGIC not in datagram:
            return False
        messages = self._codec.decode(datagram)
        for message in messages:
            rows = self._addressed(circle, message)
            if message.get_type() == SETPOINT_NAME:
                self._hear_setpoint(rows, message)
                continue
            for row in rows:
                self._autopilots[row].hear(message)
        return bool(messages)

    def _addressed(self, circle: int, message: Message) -> list[int]:
        """Rows that a message is for; messages without a target are for all."""
        system = getattr(message, "target_system", EVERYONE)
        if getattr(message, "target_component", EVERYONE) not in {EVERYONE, AUTOPILOT_COMPONENT}:
            return []
        if system == EVERYONE:
            return self._rows[circle]
        row = int(self._row_of[circle, system])
        return [] if row == NO_ROW else [row]

    def _hear_setpoint(self, rows: Sequence[int], message: Message) -> None:
        received = np.array(
            [row for row in rows if not self._autopilots[row].is_sender(message)], dtype=np.intp
        )
        if len(received):
            message = np.repeat(frames.record(message), len(received))
            for invalid in setpoints.obey(self._state, received, message):
                self._autopilots[invalid].say_invalid()
