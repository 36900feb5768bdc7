"""Frames waiting to be sent: some now, some a little later, as a real autopilot takes time to answer."""

from __future__ import annotations

import heapq
from collections import deque
from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sim.mavlink import Message

BURST = 5  # parameters per call: PX4 shares its link between the list and the streams


class Outbox:
    """Messages in the order in which they fall due."""

    def __init__(self) -> None:
        self._timed: list[tuple[float, int, Message]] = []
        self._order = count()  # keeps equal times in order; messages do not compare
        self._listed: deque[str] = deque()

    def post(self, message: Message, due_s: float) -> None:
        """Send it at due_s."""
        heapq.heappush(self._timed, (due_s, next(self._order), message))

    def list_parameters(self, names: Iterable[str]) -> None:
        """Send these parameters bit by bit; a new list replaces the old one."""
        self._listed = deque(names)

    def take(self, now_s: float) -> list[Message]:
        """What is due."""
        messages = []
        while self._timed and self._timed[0][0] <= now_s:
            messages.append(heapq.heappop(self._timed)[2])
        return messages

    def take_parameters(self) -> list[str]:
        """The next few parameters of a list that is under way."""
        return [self._listed.popleft() for _ in range(min(BURST, len(self._listed)))]
