"""Addresses of the configured systems, with duplicates and unknown systems. No I/O."""

from collections.abc import Iterable
from enum import Enum, auto
from typing import NamedTuple

SILENT_AFTER_S = 3.0
"""A system without frames for this long counts as gone: nothing is sent to it, and its address may change."""

CONFLICT_KEPT_S = 5.0
"""A duplicate is reported until it has been silent this long."""


class Address(NamedTuple):
    """Source of a system's frames, and the socket of ours that received them."""

    host: str
    port: int
    socket_index: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}" if self.port else self.host  # a serial port has none


class Verdict(Enum):
    """What to do with a frame: the first three are accepted, the others dropped."""

    KNOWN = auto()
    FIRST = auto()  # first frame of this system
    MOVED = auto()  # received from another address after a silence
    DUPLICATE = auto()  # its system id is in use at another address
    NEW_DUPLICATE = auto()  # a duplicate, for the first time
    STRANGER = auto()  # its system id is not configured


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
        """Where frames for this system go; None before its first frame."""
        return self._addresses.get(system_id)

    def hear(self, system_id: int, address: Address, now_s: float) -> Verdict:
        """Record that a checked frame of `system_id` arrived from `address`, and return the verdict."""
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
        """Remove an address whose connection ended. Its systems may come back from any address at once."""
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
        """Systems with recent frames from two addresses, both named in the text."""
        return {
            system_id: conflict.text
            for system_id, conflict in self._conflicts.items()
            if now_s - conflict.received_s <= CONFLICT_KEPT_S
        }
