"""Access control: rights, roles, and denied calls."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from ipaddress import ip_address
from pathlib import Path
from typing import Final, TypeAlias

from pydantic import model_validator

from gcs.model.settings import Positive, Settings


class Right(StrEnum):
    """A right that a call requires."""

    WATCH = "watch"
    OPERATE = "operate"
    EMERGENCY = "emergency"


class Role(StrEnum):
    """A role that a token grants."""

    WATCH = "watch"  # reads
    OPERATE = "operate"  # may do everything
    EMERGENCY = "emergency"  # reads, and may land the fleet: a button that cannot start anything


RIGHTS: Final[dict[Role, frozenset[Right]]] = {
    Role.WATCH: frozenset({Right.WATCH}),
    Role.EMERGENCY: frozenset({Right.WATCH, Right.EMERGENCY}),
    Role.OPERATE: frozenset(Right),
}

LOCAL: Final = "local"
"""Name of the caller while access control is off, which is possible on the loopback interface only."""

ANONYMOUS: Final = "anonymous"
"""Name of a caller without a token, where tokens are required."""


ACCESS_OFF: Final = (
    "off: every client of this service may do everything; it listens on the loopback interface"
)
"""What it means that no tokens are required."""


@dataclass(frozen=True, slots=True)
class Denied:
    """A call that was denied; `count` above 1 stands for as many calls that came too fast to log each."""

    unix_time_s: float
    caller: str  # the token's name, or ANONYMOUS
    address: str  # of the caller
    method: str  # WEBSOCKET for the stream
    path: str
    status: int
    reason: str
    count: int = 1


Audit: TypeAlias = Callable[[Denied], None]
"""Receives every denied call. Must return quickly: it runs on the event loop."""


class TlsSettings(Settings):
    """Certificate chain and key, PEM."""

    certificate_file: Path
    """Certificate chain, PEM."""
    key_file: Path
    """Its private key, PEM."""


class AccessSettings(Settings):
    """Access control of the API."""

    tokens_file: Path | None = None
    """File of `gcs token create`; null: no token is needed, and the API is on loopback only."""
    tls: TlsSettings | None = None
    """Certificate and key of the API; without it the API speaks plain HTTP."""
    calls_per_s: Positive = 100.0
    """Calls a second of each token; emergency calls are counted separately."""
    burst: Positive = 200.0
    """Calls of one token that may come at once."""

    @model_validator(mode="after")
    def _check(self) -> "AccessSettings":
        if self.burst < 1.0:
            raise ValueError(f"burst = {self.burst}: at least 1, or no call would ever pass")
        return self


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach what listens on `host`."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:  # a name, which may resolve to any address
        return False
