"""Ports of the vehicles. System ids have 8 bits: more vehicles need several namespaces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

HOST = "127.0.0.1"
PX4_BIND, PX4_DESTINATION, PX4_SHARED_FROM = 14580, 14540, 9
PX4_NAMESPACE_PORTS = 10  # a namespace's destinations are this much below those of the namespace before
MAX_PORT = 65535


@dataclass(frozen=True, slots=True)
class Port:
    """One socket: the port it binds (0: any), its first destination, and the vehicles behind it."""

    bind: int
    destination: int
    rows: tuple[int, ...]


def own_ports(first: int, count: int, namespace_size: int, base: int | None) -> list[Port]:
    """A socket for each vehicle: vehicle i (from 0) sends to base + i, or as PX4 does.

    As PX4: it binds 14580 + i and sends to 14540 + its place in its namespace, from the tenth on all to
    14549; the ports of namespace k are 10 k lower.
    """
    indices = range(first, first + count)
    if base is not None:
        return [Port(0, base + i, (i - first,)) for i in indices]
    return [Port(PX4_BIND + i, _px4_destination(i, namespace_size), (i - first,)) for i in indices]


def shared_ports(first: int, count: int, namespace_size: int, base: int | None) -> list[Port]:
    """A socket for each namespace, as behind a radio or a router: namespace k sends to base + k.

    Without a base it binds 14580 + k and sends to 14540 + k.
    """
    groups = groupby(range(count), lambda row: (first + row) // namespace_size)
    return [
        Port(PX4_BIND + k, PX4_DESTINATION + k, tuple(rows))
        if base is None
        else Port(0, base + k, tuple(rows))
        for k, rows in groups
    ]


def _px4_destination(index: int, namespace_size: int) -> int:
    namespace, place = divmod(index, namespace_size)
    return PX4_DESTINATION - PX4_NAMESPACE_PORTS * namespace + min(place, PX4_SHARED_FROM)
