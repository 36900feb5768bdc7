"""The links of one service: each is kept open, and receives the setpoints of its own vehicles."""

import asyncio
import logging
from collections.abc import MutableMapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.links.batch_link import Link
from gcs.model.errors import LinkError
from gcs.model.state import Setpoints, VehicleId

log = logging.getLogger(__name__)

RETRY_S = 0.25  # well below the second after which vehicles in OFFBOARD begin their failsafe
SETTLED_S = 1.0
"""A link that ran this long had worked: its next failure is logged again."""


def leaves(group: BaseExceptionGroup[LinkError]) -> list[LinkError]:
    """The errors within a group, at any depth."""
    inner = [leaves(e) if isinstance(e, BaseExceptionGroup) else [e] for e in group.exceptions]
    return [error for errors in inner for error in errors]


async def keep_open(link: Link, failed_links: MutableMapping[str, str]) -> None:
    """Run a link without end; when it fails, log it once and try again.

    `failed_links` holds the reason, by the link's name, until the link has run for SETTLED_S.
    """
    loop = asyncio.get_running_loop()
    failed = ""
    while True:
        began_s = loop.time()
        settled = loop.call_later(SETTLED_S, failed_links.pop, link.name, None)
        try:
            await link.run()
        except* LinkError as group:  # single, or from a task of the link's own
            cause = "; ".join(str(error) for error in leaves(group))
            if cause != failed or loop.time() - began_s > SETTLED_S:  # it had worked meanwhile
                log.error("link_failed", extra={"link": link.name, "cause": cause})
            failed = failed_links[link.name] = cause
        finally:
            settled.cancel()
        await asyncio.sleep(RETRY_S)


URGENT_SHARE = 0.25
"""Of the setpoints that leave first, over all links: their samples have waited longest for an answer."""


class SetpointRouting:
    """The rows of a batch for each link; computed again only when a batch lists other vehicles."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._links = tuple(links)
        self._link_of = {name: index for index, link in enumerate(links) for name in link.ids}
        self._ids: tuple[VehicleId, ...] = ()
        self._parts: list[tuple[tuple[VehicleId, ...], NDArray[np.intp]]] = self._cut((), len(links))

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's setpoints over all links, those with the oldest samples first."""
        shares = self.of(setpoints)
        samples_s = [link.prepare(share) for link, share in zip(self._links, shares, strict=True)]
        if len(self._links) > 1:
            sample_s = np.concatenate(samples_s)
            if len(sample_s):
                last = int(URGENT_SHARE * (len(sample_s) - 1))
                urgent_s = float(np.partition(sample_s, last)[last])
                for link in self._links:
                    link.send_until(urgent_s)
        for link in self._links:
            link.send_until()

    def of(self, setpoints: Setpoints) -> list[Setpoints]:
        """One batch for each link, with its own vehicles only."""
        if setpoints.ids != self._ids:
            self._ids, self._parts = setpoints.ids, self._cut(setpoints.ids, len(self._parts))
        return [
            setpoints
            if ids == setpoints.ids
            else Setpoints(setpoints.time_s, ids, setpoints.velocity_m_s[rows], setpoints.yaw_rad[rows])
            for ids, rows in self._parts
        ]

    def _cut(
        self, ids: tuple[VehicleId, ...], count: int
    ) -> list[tuple[tuple[VehicleId, ...], NDArray[np.intp]]]:
        rows: list[list[int]] = [[] for _ in range(count)]
        for row, name in enumerate(ids):
            rows[self._link_of[name]].append(row)
        return [(tuple(ids[row] for row in part), np.array(part, dtype=np.intp)) for part in rows]
