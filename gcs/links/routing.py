"""Setpoints of the whole fleet, distributed to its links."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gcs.links.link import Link
from gcs.model.state import Setpoints, VehicleId


class SetpointRouting:
    """The rows of a batch for each link; computed again only when a batch lists other vehicles."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._link_of = {name: index for index, link in enumerate(links) for name in link.ids}
        self._ids: tuple[VehicleId, ...] = ()
        self._parts: list[tuple[tuple[VehicleId, ...], NDArray[np.intp]]] = self._cut((), len(links))

    def of(self, setpoints: Setpoints) -> list[Setpoints]:
        """One batch for each link, with its own vehicles only."""
        if setpoints.ids != self._ids:
            self._ids, self._parts = setpoints.ids, self._cut(setpoints.ids, len(self._parts))
        return [
            Setpoints(setpoints.time_s, ids, setpoints.velocity_m_s[rows], setpoints.yaw_rad[rows])
            for ids, rows in self._parts
        ]

    def _cut(
        self, ids: tuple[VehicleId, ...], count: int
    ) -> list[tuple[tuple[VehicleId, ...], NDArray[np.intp]]]:
        rows: list[list[int]] = [[] for _ in range(count)]
        for row, name in enumerate(ids):
            rows[self._link_of[name]].append(row)
        return [(tuple(ids[row] for row in part), np.array(part, dtype=np.intp)) for part in rows]
