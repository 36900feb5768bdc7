"""The two steps of a kill: first armed for named vehicles, then confirmed with the code that names them."""

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from gcs.model.errors import RefusedError
from gcs.model.state import VehicleId

VALID_S: Final = 20.0
"""Long enough to read who it is and to type the code; too short to be found again in a terminal's history."""

WAITING_MAX: Final = 100
"""More cannot be meant; the oldest is forgotten."""


@dataclass(frozen=True, slots=True)
class Armed:
    """A kill that waits for its confirmation."""

    code: str
    vehicles: tuple[VehicleId, ...]
    who: str
    until_s: float


def random_code() -> str:
    """Six hexadecimal digits: nobody guesses one within its time."""
    return secrets.token_hex(3)


class KillSwitch:
    """Remembers what was armed. Each code works once, in time, and for whoever armed it."""

    def __init__(self, make_code: Callable[[], str] = random_code) -> None:
        self._make_code = make_code
        self._waiting: dict[str, Armed] = {}

    def arm(self, vehicles: Sequence[VehicleId], who: str, now_s: float) -> Armed:
        """Make a code for these vehicles; nothing happens to them yet."""
        self._waiting = {code: one for code, one in self._waiting.items() if one.until_s > now_s}
        while len(self._waiting) >= WAITING_MAX:
            del self._waiting[next(iter(self._waiting))]
        armed = Armed(self._make_code(), tuple(vehicles), who, now_s + VALID_S)
        self._waiting[armed.code] = armed
        return armed

    def confirm(self, code: str, who: str, now_s: float) -> tuple[VehicleId, ...]:
        """Whom the code kills. Raises: RefusedError when it is none, was used, or came too late."""
        armed = self._waiting.get(code)
        if armed is None or armed.who != who:
            raise RefusedError(f"{code!r} confirms nothing: arm the kill first; a code works once")
        del self._waiting[code]
        if now_s > armed.until_s:
            raise RefusedError(f"{code!r} came too late: it was good for {VALID_S:g} s; arm the kill again")
        return armed.vehicles
