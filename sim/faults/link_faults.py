"""Faults of a vehicle's link: seeded, sans-I/O, time injected. Packets are datagrams' contents."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    import numpy as np

Tag = TypeVar("Tag")

OVERTAKEN_S = 0.05  # delay of a reordered packet behind the others
LONGEST_GARBAGE = 280  # about a MAVLink frame


@dataclass(slots=True)
class Ills:
    """Faults of one direction; shares are of packets, from 0 to 1. The defaults are faultless."""

    silent: bool = False
    loss: float = 0.0
    corrupt: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0


class Way(Generic[Tag]):
    """One direction of a vehicle's link. A tag travels with each packet."""

    def __init__(self, random: np.random.Generator) -> None:
        """Faultless at first; all chance comes from `random`."""
        self.ills = Ills()
        self._random = random
        self._queue: list[tuple[float, int, bytes, Tag]] = []
        self._order = count()
        self._last_due_s = 0.0

    def put(self, packet: bytes, tag: Tag, now_s: float) -> None:
        """Send a packet; it may never arrive, or twice, or damaged."""
        ills, chance = self.ills, self._random.random
        if ills.silent or chance() < ills.loss:
            return
        if packet and chance() < ills.corrupt:
            packet = self._damaged(packet)
        for _ in range(2 if chance() < ills.duplicate else 1):
            due_s = now_s + ills.delay_s + ills.jitter_s * chance()
            if chance() < ills.reorder:
                due_s = max(due_s, self._last_due_s) + OVERTAKEN_S
            else:
                self._last_due_s = due_s = max(due_s, self._last_due_s)
            heapq.heappush(self._queue, (due_s, next(self._order), packet, tag))

    def take(self, now_s: float) -> list[tuple[bytes, Tag]]:
        """Packets that have arrived by now, in the order of arrival."""
        if self.ills.silent:
            self._queue.clear()
        arrived = []
        while self._queue and self._queue[0][0] <= now_s:
            _, _, packet, tag = heapq.heappop(self._queue)
            arrived.append((packet, tag))
        return arrived

    def _damaged(self, packet: bytes) -> bytes:
        """Change one to three bytes."""
        damaged = bytearray(packet)
        for place in self._random.integers(0, len(packet), self._random.integers(1, 4)):
            damaged[place] ^= int(self._random.integers(1, 256))
        return bytes(damaged)


class Jammer:
    """A source of garbage at a steady rate."""

    def __init__(self, random: np.random.Generator) -> None:
        """Quiet until rate_hz is set."""
        self.rate_hz = 0.0
        self._random = random
        self._reported_s: float | None = None
        self._owed = 0.0

    def take(self, now_s: float) -> list[bytes]:
        """Datagrams of random bytes and lengths: as many as are due by now."""
        passed_s = 0.0 if self._reported_s is None else now_s - self._reported_s
        self._reported_s = now_s
        self._owed += passed_s * self.rate_hz
        due = int(self._owed)
        self._owed -= due
        sizes = self._random.integers(1, LONGEST_GARBAGE, due)
        return [self._random.bytes(int(size)) for size in sizes]


class Channel(Generic[Tag]):
    """A vehicle's link: both directions and a jammer."""

    def __init__(self, random: np.random.Generator) -> None:
        """Faultless at first."""
        self.out: Way[None] = Way(random)
        self.into: Way[Tag] = Way(random)
        self.jammer = Jammer(random)

    @property
    def ways(self) -> dict[str, Ills]:
        """The faults by the name of the direction."""
        return {"out": self.out.ills, "in": self.into.ills}
