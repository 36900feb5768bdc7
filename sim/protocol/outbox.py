"""Pending answers: some leave now, some later, as a real autopilot takes time to answer."""

from __future__ import annotations

import heapq
from collections import deque
from itertools import count
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gcs.sim.protocol.mavlink import Message

Item: TypeAlias = "Message | int"
"""A message, or the id of a report that is composed when it is sent."""

BURST = 5  # parameters per call: in PX4 the list and the streams share the link


class Outbox:
    """A fleet's answers in the order in which they fall due."""

    def __init__(self) -> None:
        self._timed: list[tuple[float, int, int, Item]] = []
        self._order = count()  # keeps equal times in order; messages do not compare
        self._listed: dict[int, deque[str]] = {}

    def post(self, row: int, item: Item, due_s: float) -> None:
        """Send it at due_s for vehicle `row`."""
        heapq.heappush(self._timed, (due_s, next(self._order), row, item))

    def list_parameters(self, row: int, names: Iterable[str]) -> None:
        """Send these parameters a few at a time; a new list replaces the old one."""
        self._listed[row] = deque(names)

    def forget(self, row: int) -> None:
        """Drop a vehicle's pending answers."""
        self._timed = [entry for entry in self._timed if entry[2] != row]
        heapq.heapify(self._timed)
        self._listed.pop(row, None)

    def take(self, now_s: float) -> list[tuple[int, Item]]:
        """The items that are due, with their rows."""
        items = []
        while self._timed and self._timed[0][0] <= now_s:
            _, _, row, item = heapq.heappop(self._timed)
            items.append((row, item))
        return items

    def take_parameters(self) -> list[tuple[int, str]]:
        """The next few parameters of every list in progress."""
        taken = [
            (row, names.popleft())
            for row, names in self._listed.items()
            for _ in range(min(BURST, len(names)))
        ]
        if taken:
            self._listed = {row: names for row, names in self._listed.items() if names}
        return taken
