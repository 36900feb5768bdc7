"""Sends what Remote ID needs over one link, within its budget: the oldest first, and some in each tick."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.links.remote_id import messages
from gcs.links.remote_id.messages import Operator, SwarmArea
from gcs.links.remote_id.settings import BasicId, RemoteIdSettings
from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox
from gcs.links.stream_requests import REQUESTING_COMPONENT
from gcs.mavlink.codec import HEADER_LENGTH, Records, layout
from gcs.mavlink.kernels import Whole
from gcs.model.state import Array, Mask

EVERY_S: Final = 0.9
"""Between two messages to one vehicle: at least one a second, in ticks."""

WHOLE_S: Final = 8.0
"""So often at least the area is sent where the link has no room for it each second."""

STATIC_S: Final = 5.0
SHARE: Final = 0.5
"""Of what features may send: more is not taken for the area."""

_SYSTEM_BYTES: Final = layout(messages.SYSTEM).dtype.itemsize + HEADER_LENGTH


@dataclass(eq=False)
class RemoteIdSender:
    """Rows as on the link.

    Attributes:
        sent: messages that left.
        crowded: the link has no room for the area each second.
    """

    settings: RemoteIdSettings
    basic_ids: Mapping[int, BasicId]  # by row
    outbox: Outbox
    budget: Budget
    sent: int = 0
    crowded: bool = False
    _sent_s: Array = field(init=False)  # (n,) either message
    _whole_s: Array = field(init=False)  # (n,) with the area
    _basic_s: Array = field(init=False)  # (n,) the identity
    _static_s: float = field(default=-np.inf, init=False)

    def __post_init__(self) -> None:
        count = len(self.outbox.system_ids)
        self._sent_s, self._whole_s = np.full(count, -np.inf), np.full(count, -np.inf)
        self._basic_s = np.full(count, -np.inf)

    @property
    def newest_s(self) -> Array:
        """(n,) when the operator's place was sent last, -inf: never."""
        return self._sent_s

    def send(
        self, area: SwarmArea, rows_of_area: Whole, operator: Operator, unix_s: float, may: Mask, now_s: float
    ) -> None:
        """Send what is due and has room.

        Args:
            area: of the swarm.
            rows_of_area: (n,) the row of each vehicle of this link in it.
            operator: where the operator is.
            unix_s: the time; NaN: this computer does not know it.
            may: (n,) vehicles that are connected; those that connect again get everything anew.
            now_s: the link's clock.
        """
        for column in (self._sent_s, self._whole_s, self._basic_s):
            column[~may] = -np.inf
        reached = int(np.count_nonzero(may))
        self.crowded = reached * _SYSTEM_BYTES / EVERY_S > SHARE * self.budget.bytes_per_s
        rows = np.flatnonzero(may & (now_s - self._sent_s >= EVERY_S))
        rows = rows[np.argsort(self._sent_s[rows], kind="stable")]
        short = self.crowded & (now_s - self._whole_s[rows] < WHOLE_S)
        whole, part = rows[~short], rows[short]
        ids = self.outbox.system_ids
        about = self.settings, operator, area, unix_s
        made = messages.system_messages(ids[whole], rows_of_area[whole], *about)
        left = self._send(messages.SYSTEM, made, whole, now_s)
        self._sent_s[left] = self._whole_s[left] = now_s
        made = messages.update_messages(ids[part], operator, unix_s)
        left = self._send(messages.SYSTEM_UPDATE, made, part, now_s)
        self._sent_s[left] = now_s
        self._send_identities(may, now_s)
        self._send_static(now_s)

    def _send(self, message_id: int, made: Records, rows: Whole, now_s: float) -> Whole:
        """Send as many as there is room for. Returns: the rows that they left for."""
        size = made.itemsize + HEADER_LENGTH
        room = int(self.budget.left_bytes(now_s) // size)
        rows, made = rows[: max(0, room)], made[: max(0, room)]
        if not len(rows):
            return rows
        frames = self.outbox.encode(message_id, made, rows, component_id=REQUESTING_COMPONENT)
        left = self.outbox.send(frames, rows, now_s)
        self.budget.spend(int(frames.length.sum()))
        self.sent += int(np.count_nonzero(left))
        return rows[left]

    def _send_identities(self, may: Mask, now_s: float) -> None:
        for row, identity in self.basic_ids.items():
            if may[row] and now_s - self._basic_s[row] >= STATIC_S:
                made = messages.basic_id_message(int(self.outbox.system_ids[row]), identity)
                self._basic_s[self._send(messages.BASIC_ID, made, np.array([row]), now_s)] = now_s

    def _send_static(self, now_s: float) -> None:
        """What is the same for all, once to each address."""
        if now_s - self._static_s < STATIC_S or self.budget.left_bytes(now_s) <= 0:
            return
        self._static_s = now_s
        texts = []
        if self.settings.operator_id:
            texts.append((messages.OPERATOR_ID, messages.operator_id_message(self.settings.operator_id)))
        if self.settings.self_id:
            texts.append((messages.SELF_ID, messages.self_id_message(self.settings.self_id)))
        copies = len(self.outbox.addresses.one_per_source())
        for message_id, made in texts:
            self.outbox.broadcast(message_id, made, now_s)
            self.budget.spend(copies * (made.itemsize + HEADER_LENGTH))
            self.sent += copies
