"""Sends the colours of a link's vehicles, within its budget: changed ones first, the others now and then."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs.links.budget import Budget
from gcs.links.sender import Outbox
from gcs.links.settings import LightSettings
from gcs.links.stream_requests import REQUESTING_COMPONENT
from gcs.mavlink.codec import HEADER_LENGTH
from gcs.mavlink.kernels import Whole
from gcs.mavlink.lights import LightDriver, light_messages
from gcs.model.state import Array, Mask

Colours = NDArray[np.uint8]

_EARLY_S = 0.005
"""A tick that comes by so much too early counts as due: its times are not exact."""


def most_urgent(changed: Mask, age_s: Array, *, period_s: float, refresh_s: float) -> Whole:
    """Rows to send, most urgent first: changed colours before unchanged, then the oldest.

    Args:
        changed: (n,) whether the colour differs from the one sent last.
        age_s: (n,) since one was sent, inf: never.
        period_s: least time between two colours of one vehicle.
        refresh_s: age from which an unchanged colour is repeated: the last one may have been lost.
    """
    due = np.flatnonzero((changed & (age_s >= period_s - _EARLY_S)) | (age_s >= refresh_s))
    return due[np.lexsort((-age_s[due], ~changed[due]))]


@dataclass(eq=False)
class LightSender:
    """Colours of n vehicles, rows as on the link. Sends from a component that MAVSDK does not see answered.

    Attributes:
        sent: number of colours that left.
    """

    settings: LightSettings
    outbox: Outbox
    budget: Budget
    sent: int = 0
    _colour: Colours = field(init=False)  # (n, 3) sent last
    _sent_s: Array = field(init=False)  # (n,)

    def __post_init__(self) -> None:
        count = len(self.outbox.system_ids)
        self._colour, self._sent_s = np.zeros((count, 3), np.uint8), np.full(count, -np.inf)

    def send(self, colour: Colours, may_receive: Mask, now_s: float) -> None:
        """Send what is due and has room.

        Args:
            colour: (n, 3) red, green, blue.
            may_receive: (n,) vehicles that are connected; those that connect again get their colour anew.
            now_s: the link's clock.
        """
        settings = self.settings
        if settings.driver is LightDriver.NONE:
            return
        self._sent_s[~may_receive] = -np.inf
        changed = (colour != self._colour).any(axis=1)
        rows = most_urgent(
            changed & may_receive,
            np.where(may_receive, now_s - self._sent_s, -np.inf),
            period_s=1.0 / settings.rate_hz,
            refresh_s=settings.refresh_s,
        )
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
        self._colour[rows[left]], self._sent_s[rows[left]] = colour[rows[left]], now_s
        self.sent += int(np.count_nonzero(left))
