"""Who speaks from where: addresses of the configured systems, duplicates and strangers. No I/O."""

from collections.abc import Iterable
from enum import Enum, auto
from typing import NamedTuple

SILENT_AFTER_S = 3.0
"""Not heard for this long a system counts as gone: it is sent nothing, and may come back from elsewhere."""

CONFLICT_KEPT_S = 5.0
"""A duplicate is reported until it has been silent this long."""


class Address(NamedTuple):
    """Where a system speaks from, and which of our sockets heard it."""

    host: str
    port: int
    socket_index: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}" if self.port else self.host  # a serial port has none


class Verdict(Enum):
    """What to do with a frame: the first three are taken, the others dropped."""

    KNOWN = auto()
    FIRST = auto()  # not heard before
    MOVED = auto()  # heard from another address after a silence
    DUPLICATE = auto()  # its system id is alive at another address
    NEW_DUPLICATE = auto()  # the same, for the first time
    STRANGER = auto()  # not configured


TAKEN = frozenset({Verdict.KNOWN, Verdict.FIRST, Verdict.MOVED})


class _Conflict(NamedTuple):
    text: str
    received_s: float


class AddressBook:
    """The address book. One thread writes (`hear`); reading an address is safe from any thread."""

    def __init__(self, system_ids: Iterable[int]) -> None:
        self._configured = frozenset(system_ids)
        self._addresses: dict[int, Address] = {}
        self._received_s: dict[int, float] = {}
        self._conflicts: dict[int, _Conflict] = {}
        self._everybody: tuple[Address, ...] = ()

    @property
    def everybody(self) -> tuple[Address, ...]:
        """Every known address once, though several systems may share it (a radio, a router)."""
        return self._everybody

    def address(self, system_id: int) -> Address | None:
        """Where frames for this system go; None before it was heard."""
        return self._addresses.get(system_id)

    def hear(self, system_id: int, address: Address, now_s: float) -> Verdict:
        """Note that a checked frame of `system_id` arrived from `address`, and judge it."""
        known = self._addresses.get(system_id)
        if known == address:
            self._received_s[system_id] = now_s
            return Verdict.KNOWN
        if system_id not in self._configured:
            return Verdict.STRANGER
        if known is not None and now_s - self._received_s[system_id] <= SILENT_AFTER_S:
            return self._object(system_id, known, address, now_s)
        self._addresses[system_id] = address
        self._received_s[system_id] = now_s
        self._conflicts.pop(system_id, None)
        self._everybody = tuple(dict.fromkeys(self._addresses.values()))
        return Verdict.FIRST if known is None else Verdict.MOVED

    def forget(self, address: Address) -> None:
        """Nobody is there any more: the connection ended. Its systems may come back from anywhere at once."""
        for system_id in [known for known, at in self._addresses.items() if at == address]:
            del self._addresses[system_id]
        self._everybody = tuple(dict.fromkeys(self._addresses.values()))

    def _object(self, system_id: int, known: Address, other: Address, now_s: float) -> Verdict:
        text = f"system id {system_id} at {known} and at {other}"
        before = self._conflicts.get(system_id)
        self._conflicts[system_id] = _Conflict(text, now_s)
        is_new = before is None or before.text != text or now_s - before.received_s > CONFLICT_KEPT_S
        return Verdict.NEW_DUPLICATE if is_new else Verdict.DUPLICATE

    def conflicts(self, now_s: float) -> dict[int, str]:
        """Systems heard lately from two addresses, both named in the text."""
        return {
            system_id: conflict.text
            for system_id, conflict in self._conflicts.items()
            if now_s - conflict.received_s <= CONFLICT_KEPT_S
        }
