"""Received datagrams, passed to their vehicles: setpoints all at once, everything else one by one."""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.sim.protocol import frames
from gcs.sim.protocol.base import BaseAutopilot
from gcs.sim.protocol.frames import AUTOPILOT_COMPONENT, MAGIC, Codec, Message
from gcs.sim.vehicle.state import Rows, State

BROADCAST = 0  # as target system or component
NO_ROW = -1
ADDRESSES = 256
SETPOINT_NAME = frames.SETPOINT.msgname


Store: TypeAlias = Callable[[Rows, NDArray[np.void], NDArray[np.uint8]], None]
"""Takes setpoints: rows (m,), messages (m,), system ids of the senders (m,)."""


class Receiver:
    """Passes messages to vehicles. A circle is the vehicles on one socket; their system ids differ."""

    def __init__(
        self, state: State, autopilots: Sequence[BaseAutopilot], store: Store, *, any_component: bool
    ) -> None:
        """Row i of the state is autopilots[i]; at first every vehicle alone is circle number `row`.

        With `any_component` vehicles also take messages for other components of theirs.
        """
        self._state = state
        self._store = store
        self._any_component = any_component
        self._autopilots = autopilots
        self._codec = Codec()
        self._rows = [[row] for row in range(len(autopilots))]
        self._row_of = np.full((len(autopilots), ADDRESSES), NO_ROW, dtype=np.intp)
        self._row_of[np.arange(len(autopilots)), state.system_id] = np.arange(len(autopilots))

    def circle(self, rows: Sequence[int]) -> int:
        """Let these vehicles share a socket. Returns: the circle's number."""
        row_of = np.full((1, ADDRESSES), NO_ROW, dtype=np.intp)
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
        setpoints = frames.setpoints(b"".join([batch[place][1] for place in places]))
        if setpoints is None:
            places = [p for p in places if frames.setpoints(batch[p][1]) is not None]
            setpoints = frames.setpoints(b"".join([batch[place][1] for place in places]))
            if setpoints is None:
                return set()
        messages, sender, good = setpoints
        system, component = messages["target_system"], messages["target_component"]
        circle = np.array([batch[place][0] for place in places])
        meant = fit = good & (system != BROADCAST)
        if len(messages) > len(places):  # some datagrams have several
            counts = [len(batch[place][1]) // frames.SETPOINT_FRAME for place in places]
            owner = np.repeat(np.arange(len(places)), counts)
            fit = np.ones(len(places), dtype=np.bool_)
            fit[owner[~meant]] = False
            circle, meant = circle[owner], fit[owner]
        row = self._row_of[circle, system]
        meant = meant & (row != NO_ROW)
        if not self._any_component:
            meant &= (component == BROADCAST) | (component == AUTOPILOT_COMPONENT)
        itself = (sender[:, 0] == self._state.system_id[row]) & (sender[:, 1] == AUTOPILOT_COMPONENT)
        meant &= ~itself
        if np.count_nonzero(meant) < len(meant):
            row, messages, sender = row[meant], messages[meant], sender[meant]
        self._store(row, messages, sender[:, 0])
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
        component = getattr(message, "target_component", BROADCAST)
        if not self._any_component and component not in {BROADCAST, AUTOPILOT_COMPONENT}:
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
            senders = np.full(len(received), message.get_srcSystem(), dtype=np.uint8)
            self._store(received, np.repeat(frames.record(message), len(received)), senders)
