"""Bounds what one input may cost, whoever sends: bytes and messages a second. Pure.

The bound is enforced where bytes are read, before anything parses them. What is over it is dropped oldest
first, counted, and named with its sender. docs/invariants.md lists all inputs with their bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple, TypeAlias

TURN_S: Final = 0.05
"""Time of a tick, over which the cost of an input is spread."""

SAVED_S: Final = 0.25
"""Share that an input may save up: networks deliver in bursts."""

OVER_S: Final = 2.0
"""An input counts as flooded until nothing was dropped for so long."""

SENDER_KEPT_S: Final = 1.0
"""Of several senders one is named until nothing of it was dropped for so long."""

Sender: TypeAlias = tuple[str, int] | str


class Arrived(NamedTuple):
    """One datagram, or what one read of a stream returned."""

    data: bytes
    sender: Sender


class Bound(NamedTuple):
    """What may be parsed of one input in a second."""

    bytes_per_s: float
    messages_per_s: float = inf


FORWARDED: Final = Bound(20_000, 1000)
"""MAVLink from one further station, which may command but not fly."""


def of_vehicles(count: int) -> Bound:
    """A link's: an autopilot with fast streams sends 20 kB/s in 400 messages, one with usual ones 2 kB/s."""
    return Bound(256_000.0 + 32_000.0 * count, 2000.0 + 500.0 * count)


def sound(sample_rate_hz: float, sample_bytes: int) -> Bound:
    """Sound that comes at twice the speed at which it is played has no use as a clock."""
    return Bound(2.0 * sample_bytes * sample_rate_hz)


@dataclass(slots=True, eq=False)
class Intake:
    """Admits what one input sends, up to its bound. Every `now_s` is of one clock.

    Attributes:
        name: of the input, for texts.
        bound: what may pass.
        dropped: messages that were dropped unread, or pieces of a stream.
        dropped_bytes: their bytes.
    """

    name: str
    bound: Bound
    dropped: int = 0
    dropped_bytes: int = 0
    _bytes: float = field(default=0.0, init=False)
    _messages: float = field(default=0.0, init=False)
    _time_s: float = field(default=-inf, init=False)
    _over_s: float = field(default=-inf, init=False)
    _sender: Sender = field(default="", init=False)
    _named: Sender = field(default="", init=False)
    _named_s: float = field(default=-inf, init=False)  # when something of the named one was dropped last

    def admit(self, arrived: Sequence[Arrived], now_s: float) -> list[Arrived]:
        """The newest messages that fit, in their order."""
        self._gain(now_s)
        fit = len(arrived)
        while fit and self._fits(len(arrived[fit - 1].data)):
            fit -= 1
        for data, sender in arrived[:fit]:
            self._drop(len(data), sender, now_s)
        return list(arrived[fit:])

    def tail(self, data: bytes, sender: Sender, now_s: float) -> bytes:
        """The newest bytes of a stream that fit."""
        self._gain(now_s)
        kept = data[max(0, len(data) - int(self._bytes)) :]
        self._bytes -= len(kept)
        if len(kept) < len(data):
            self._drop(len(data) - len(kept), sender, now_s)
        return kept

    def why_over(self, now_s: float) -> str:
        """What arrives beyond the bound and from where, in words; empty: nothing was dropped lately."""
        if now_s - self._over_s > OVER_S:
            return ""
        if now_s - self._named_s > SENDER_KEPT_S:
            self._named, self._named_s = self._sender, self._over_s
        sender = self._named
        place = sender if isinstance(sender, str) else f"{sender[0]}:{sender[1]}"
        limit = f"{self.bound.bytes_per_s / 1000:g} kB"
        if self.bound.messages_per_s < inf:
            limit += f" or {self.bound.messages_per_s:g} messages"
        return f"more than {limit} a second from {place}"

    def _gain(self, now_s: float) -> None:
        gained_s = min(now_s - self._time_s, SAVED_S)
        self._time_s = now_s
        self._bytes = min(self._bytes + gained_s * self.bound.bytes_per_s, SAVED_S * self.bound.bytes_per_s)
        if self.bound.messages_per_s < inf:
            most = SAVED_S * self.bound.messages_per_s
            self._messages = min(self._messages + gained_s * self.bound.messages_per_s, most)
        else:
            self._messages = inf

    def _fits(self, size: int) -> bool:
        if self._messages < 1.0 or self._bytes < size:
            return False
        self._messages -= 1.0
        self._bytes -= size
        return True

    def _drop(self, size: int, sender: Sender, now_s: float, count: int = 1) -> None:
        self.dropped += count
        self.dropped_bytes += size
        self._over_s, self._sender = now_s, sender
        if sender == self._named:
            self._named_s = now_s
