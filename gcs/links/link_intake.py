"""Bounds what the senders to one link's ports may cost together, and keeps their shares apart.

The bound is `gcs.links.intake.of_vehicles`; `gcs.links.fair_shares` divides what may be read among senders.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from gcs.links.endpoints.ports import Datagrams
from gcs.links.fair_shares import fair_shares
from gcs.links.intake import Intake, of_vehicles
from gcs.links.link import Address
from gcs.mavlink.kernels import BEGIN, DATAGRAM, END, Whole
from gcs.model.state import Mask

_HEADERS_BYTES: Final = 28
"""Of IPv4 and UDP: an empty datagram costs something as well."""


ONE_BY_ONE_MAX: Final = 12
"""Status texts, and values of parameters, that Python reads of one vehicle in one read."""


def newest_of_each(rows: Whole) -> Mask:
    """(k,) which of a read's messages are read one by one: the newest of each row, in order of arrival."""
    order = np.argsort(rows, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(len(rows))
    newest: Mask = np.searchsorted(rows[order], rows, side="right") - place <= ONE_BY_ONE_MAX
    return newest


class LinkIntake(Intake):
    """Admits datagrams before they are searched for frames, and frames before Python judges them one by one.

    One read may use half of what is left, so that the next one, a moment later, finds something: a flood
    cannot take what the vehicles send meanwhile.
    """

    def __init__(self, name: str, vehicles_at: Whole, address_of: Callable[[int], Address]) -> None:
        """`vehicles_at` (n,) is the source of each vehicle, changed by the caller as vehicles connect."""
        super().__init__(f"link {name}", of_vehicles(len(vehicles_at)))
        self._vehicles_at = vehicles_at
        self._address_of = address_of

    def admit_datagrams(self, arrived: Datagrams, now_s: float) -> Datagrams:
        """The newest that fit, of each sender its share."""
        self._gain(now_s)
        cost = arrived.length + _HEADERS_BYTES
        if (total := int(cost.sum())) <= self._bytes / 2:
            self._bytes -= total
            return arrived
        fits = self._fitting(arrived.source, cost, self._bytes / 2, arrived.length, now_s)
        self._bytes -= int(cost[fits].sum())
        return arrived.of(fits)

    def admit_frames(self, frames: Whole, arrived: Datagrams, now_s: float) -> Whole:
        """The newest of the frames (k, FRAME_COLUMNS) that fit, of each sender its share."""
        self._gain(now_s)
        if (total := len(frames)) <= self._messages / 2:
            self._messages -= total
            return frames
        source, size = arrived.source[frames[:, DATAGRAM]], frames[:, END] - frames[:, BEGIN]
        fits = self._fitting(source, np.ones(total, np.int64), self._messages / 2, size, now_s)
        self._messages -= np.count_nonzero(fits)
        admitted: Whole = frames[fits]
        return admitted

    def _fitting(self, source: Whole, cost: Whole, budget: float, size: Whole, now_s: float) -> Mask:
        """As `fair_shares`; what does not fit is counted with its `size` in bytes, and its sender noted."""
        fits, heaviest = fair_shares(source, cost, self._vehicles_at, budget)
        lost_bytes, count = int(size[~fits].sum()), int(np.count_nonzero(~fits))
        self._drop(lost_bytes, str(self._address_of(int(heaviest))), now_s, count)
        return fits
