"""The two steps of a kill: arming for named vehicles returns a code, and the code confirms the kill."""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.model.errors import RefusedError
from gcs.model.state import VehicleId

VALID_S: Final = 20.0
"""Seconds that a code is valid: enough to read the vehicles and type the code, too short for a code from a
terminal's history.
"""

WAITING_MAX: Final = 100
"""Most armed kills at a time; one more drops the oldest."""


@dataclass(frozen=True, slots=True)
class Armed:
    """A kill that waits for its confirmation."""

    code: str
    vehicles: tuple[VehicleId, ...]
    who: str
    until_s: float


def random_code() -> str:
    """Return six hexadecimal digits, which cannot be guessed within `VALID_S`."""
    return secrets.token_hex(3)


class KillSwitch:
    """Holds the armed kills. A code works once, within `VALID_S`, and for the caller that armed it."""

    def __init__(self, make_code: Callable[[], str] = random_code) -> None:
        self._make_code = make_code
        self._waiting: dict[str, Armed] = {}

    def arm(self, vehicles: Sequence[VehicleId], who: str, now_s: float) -> Armed:
        """Make a code for these vehicles; nothing is sent to them yet."""
        self._waiting = {code: one for code, one in self._waiting.items() if one.until_s > now_s}
        while len(self._waiting) >= WAITING_MAX:
            del self._waiting[next(iter(self._waiting))]
        armed = Armed(self._make_code(), tuple(vehicles), who, now_s + VALID_S)
        self._waiting[armed.code] = armed
        return armed

    def confirm(self, code: str, who: str, now_s: float) -> tuple[VehicleId, ...]:
        """Return a code's vehicles. Raises: RefusedError when it is unknown, used, expired or not `who`'s."""
        armed = self._waiting.get(code)
        if armed is None or armed.who != who:
            raise RefusedError(f"{code!r} confirms nothing: arm the kill first; a code works once")
        del self._waiting[code]
        if now_s > armed.until_s:
            raise RefusedError(f"{code!r} came too late: it was good for {VALID_S:g} s; arm the kill again")
        return armed.vehicles
