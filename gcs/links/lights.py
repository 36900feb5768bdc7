"""Sends the colours of a link's vehicles, within its budget: changed ones first, the others now and then."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs.links.features import LightSettings
from gcs.links.send_budget import Budget
from gcs.links.sender import Outbox
from gcs.links.stream_requests import REQUESTING_COMPONENT
from gcs.mavlink.codec import HEADER_LENGTH
from gcs.mavlink.kernels import Whole
from gcs.mavlink.lights import light_messages
from gcs.model.state import Array, Mask

Colours = NDArray[np.uint8]

_MADE_UP = 0.5
"""A colour that left late, by up to this share of its period, does not delay the next one."""


def most_urgent(changed: Mask, age_s: Array, refresh_s: float) -> Whole:
    """Rows to send, most urgent first: changed colours before unchanged, then the oldest.

    Args:
        changed: (n,) whether the colour differs from the one sent last, and another one may leave.
        age_s: (n,) since one was sent, inf: never.
        refresh_s: age from which an unchanged colour is repeated: the last one may have been lost.
    """
    due = np.flatnonzero(changed | (age_s >= refresh_s))
    return due[np.lexsort((-age_s[due], ~changed[due]))]


@dataclass(eq=False)
class LightSender:
    """Colours of n vehicles, rows as on the link. Sends from a component that MAVSDK does not see answered.

    Attributes:
        sent: number of colours that left.
        dropped: number of colours that another one replaced before they left: of the rate, or of the budget.
    """

    settings: LightSettings
    outbox: Outbox
    budget: Budget
    sent: int = 0
    dropped: int = 0
    _desired: Colours = field(init=False)  # (n, 3) given last
    _colour: Colours = field(init=False)  # (n, 3) sent last
    _sent_s: Array = field(init=False)  # (n,)
    _due_s: Array = field(init=False)  # (n,) from when on a changed colour may leave

    def __post_init__(self) -> None:
        count = len(self.outbox.system_ids)
        self._colour, self._sent_s = np.zeros((count, 3), np.uint8), np.full(count, -np.inf)
        self._due_s = np.full(count, -np.inf)
        self._desired = self._colour

    def send(self, colour: Colours, may_receive: Mask, now_s: float) -> None:
        """Send what is due and has room.

        Args:
            colour: (n, 3) red, green, blue.
            may_receive: (n,) vehicles that are connected; those that connect again get their colour anew.
            now_s: the link's clock.
        """
        settings = self.settings
        self._sent_s[~may_receive] = -np.inf
        waited, replaced = ((before != self._desired).any(axis=1) for before in (self._colour, colour))
        self.dropped += int(np.count_nonzero(waited & replaced & may_receive))
        self._desired = colour.copy()
        changed = (colour != self._colour).any(axis=1) & (now_s >= self._due_s)
        age_s = np.where(may_receive, now_s - self._sent_s, -np.inf)
        rows = most_urgent(changed & may_receive, age_s, settings.refresh_s)
        room_bytes = self.budget.left_bytes(now_s)
        if not len(rows) or room_bytes <= 0:
            return
        message_id, messages = light_messages(
            settings.driver, self.outbox.system_ids[rows], colour[rows], time_s=now_s
        )
        count = min(len(rows), int(room_bytes // (messages.itemsize + HEADER_LENGTH)) or 1)
        rows, messages = rows[:count], messages[:count]
        frames = self.outbox.encode(message_id, messages, rows, component_id=REQUESTING_COMPONENT)
        left = self.outbox.send(frames, rows, now_s)
        self.budget.spend(int(frames.length.sum()))
        rows, period_s = rows[left], 1.0 / settings.rate_hz
        self._colour[rows], self._sent_s[rows] = colour[rows], now_s
        self._due_s[rows] = np.maximum(self._due_s[rows], now_s - _MADE_UP * period_s) + period_s
        self.sent += len(rows)
