"""A bus in memory, on a clock that is given: messages are late and lost as configured, with a seed."""

import asyncio
import heapq
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.bus.bundles import bundles
from gcs.bus.interface import CONNECTION_S, Accepts, BusCounters, Received, anything
from gcs.links.intake import Intake

UNDER_WAY_MAX: Final = 4096
"""Messages to one station that have not been collected; further ones are lost."""


@dataclass(slots=True)
class MemoryNetwork:
    """Connects the buses of one site."""

    now_s: Callable[[], float]
    delay_s: float = 0.0
    spread_s: float = 0.0  # each message is later or earlier by up to this
    loss: float = 0.0  # share of the messages
    connection_s: float = CONNECTION_S  # a station that is cut off stays present for this time
    seed: int = 0
    tells_arrival: bool = True  # False: messages have the time at which they were collected
    buses: dict[str, "MemoryBus"] = field(default_factory=dict)
    _groups: tuple[frozenset[str], ...] = ()
    _cut_s: float = -np.inf
    _cut_one_way_s: dict[tuple[str, str], float] = field(default_factory=dict)  # by sender, receiver
    _random: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    def bus(self, station: str) -> "MemoryBus":
        """Connect a station."""
        self.buses[station] = bus = MemoryBus(station, self)
        return bus

    def cut(self, *groups: Collection[str]) -> None:
        """From now on only stations of the same group receive each other; without groups all do again."""
        self._groups, self._cut_s = tuple(map(frozenset, groups)), self.now_s()
        self._cut_one_way_s.clear()

    def cut_one_way(self, sender: str, receiver: str) -> None:
        """From now on nothing of the sender reaches the receiver, which closes the connection of the two."""
        self._cut_one_way_s[sender, receiver] = self.now_s()

    def connects(self, one: str, other: str) -> bool:
        """Whether the two are connected."""
        together = not self._groups or any({one, other} <= group for group in self._groups)
        cut_s = min(self._cut_one_way_s.get(pair, np.inf) for pair in ((one, other), (other, one)))
        kept = self.now_s() - cut_s < self.connection_s
        return together and kept and self.buses[one].open and self.buses[other].open

    def present(self, station: str) -> frozenset[str]:
        """Stations that are present as far as that one knows."""
        kept = self.now_s() - self._cut_s < self.connection_s
        others = [name for name, bus in self.buses.items() if name != station and bus.open]
        return frozenset(name for name in others if kept or self.connects(station, name))

    def carry(self, sender: str, topic: str, payload: bytes) -> None:
        """Put a message on its way to every other station."""
        others = [
            bus
            for name, bus in self.buses.items()
            if name != sender and self.connects(sender, name) and (sender, name) not in self._cut_one_way_s
        ]
        late_s = self.delay_s + self.spread_s * self._random.uniform(-1.0, 1.0, len(others))
        kept = self._random.random(len(others)) >= self.loss
        now_s = self.now_s()
        for bus, wait_s, arrives in zip(others, late_s.tolist(), kept.tolist(), strict=True):
            if arrives:
                bus.arrive(now_s + max(wait_s, 0.0), sender, topic, payload)


class MemoryBus:
    """One station's end. Implements `Bus`."""

    def __init__(self, station: str, network: MemoryNetwork) -> None:
        self.station = station
        self.counters = BusCounters()
        self.accepts: Accepts = anything
        self.open = True  # False: its station has stopped
        self._network = network
        self._under_way: list[tuple[float, int, Received]] = []
        self._count = 0
        self._latest_s: dict[str, float] = {}  # arrival of each sender's last message

    async def run(self) -> None:
        self.open = True
        try:
            await asyncio.Event().wait()
        finally:
            self.open = False

    def publish(self, messages: Mapping[str, bytes]) -> None:
        made = list(bundles(messages))
        if not self.open:
            return
        self.counters.sent += len(messages)
        self.counters.sent_bytes += sum(map(len, made))
        for topic, payload in messages.items():
            self._network.carry(self.station, topic, payload)

    def arrive(self, at_s: float, sender: str, topic: str, payload: bytes) -> None:
        """Deliver a message at that time, or with the sender's last one, for they keep their order."""
        if len(self._under_way) >= UNDER_WAY_MAX:
            return
        at_s = self._latest_s[sender] = max(at_s, self._latest_s.get(sender, at_s))
        self._count += 1
        heapq.heappush(self._under_way, (at_s, self._count, Received(sender, topic, payload, at_s)))

    def newest(self) -> list[Received]:
        found: dict[tuple[str, str], Received] = {}
        now_s = self._network.now_s()
        while self._under_way and self._under_way[0][0] <= now_s:
            message = heapq.heappop(self._under_way)[2]
            if not self.accepts(message.topic, message.payload):
                self.counters.refused += 1
                continue
            self.counters.received += 1
            if not self._network.tells_arrival:
                message = message._replace(time_s=now_s)
            found[message.sender, message.topic] = message
        return list(found.values())

    @property
    def intakes(self) -> Sequence[Intake]:
        return ()

    @property
    def present(self) -> frozenset[str]:
        return self._network.present(self.station)


def network(
    stations: Sequence[str],
    now_s: Callable[[], float],
    *,
    delay_s: float = 0.0,
    spread_s: float = 0.0,
    loss: float = 0.0,
    connection_s: float = CONNECTION_S,
    seed: int = 0,
    tells_arrival: bool = True,
) -> MemoryNetwork:
    """A network with a bus for each of these stations; settings as of `MemoryNetwork`."""
    made = MemoryNetwork(now_s, delay_s, spread_s, loss, connection_s, seed, tells_arrival)
    for station in stations:
        made.bus(station)
    return made
