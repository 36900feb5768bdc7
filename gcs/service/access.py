"""Who may do what: rights, roles, and how a call that was denied is told."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from ipaddress import ip_address
from pathlib import Path
from typing import Final, TypeAlias

from pydantic import model_validator

from gcs.model.settings import Positive, Settings


class Right(StrEnum):
    """What a call needs."""

    WATCH = "watch"
    OPERATE = "operate"
    EMERGENCY = "emergency"


class Role(StrEnum):
    """What a token is for."""

    WATCH = "watch"  # reads
    OPERATE = "operate"  # may do everything
    EMERGENCY = "emergency"  # reads, and may bring the fleet down: a button that cannot start anything


RIGHTS: Final[dict[Role, frozenset[Right]]] = {
    Role.WATCH: frozenset({Right.WATCH}),
    Role.EMERGENCY: frozenset({Right.WATCH, Right.EMERGENCY}),
    Role.OPERATE: frozenset(Right),
}

LOCAL: Final = "local"
"""Who calls while access is off, which is possible on the loopback interface alone."""

ANONYMOUS: Final = "anonymous"
"""Who calls without a token, where tokens are asked for."""


@dataclass(frozen=True, slots=True)
class Denied:
    """A call that was turned away; with `count` above 1, one of so many that came too fast to be told."""

    unix_time_s: float
    who: str  # the token's name, or ANONYMOUS
    address: str  # of the caller
    method: str  # WEBSOCKET for the stream
    path: str
    status: int
    reason: str
    count: int = 1


Audit: TypeAlias = Callable[[Denied], None]
"""Is handed every denied call. Quick: it runs on the loop."""


class TlsSettings(Settings):
    """Certificate chain and key, PEM."""

    certificate_file: Path
    key_file: Path


class AccessSettings(Settings):
    """Who may call the API."""

    tokens_file: Path | None = None  # from `gcs token create`; None: access is off, on loopback alone
    tls: TlsSettings | None = None
    calls_per_s: Positive = 100.0  # of each token; emergency calls are counted apart
    burst: Positive = 200.0  # calls that may come at once

    @model_validator(mode="after")
    def _check(self) -> "AccessSettings":
        if self.burst < 1.0:
            raise ValueError(f"burst = {self.burst}: at least 1, or no call would ever pass")
        return self


def is_loopback(host: str) -> bool:
    """Whether nobody but this machine reaches what listens there."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:  # a name, which may lead anywhere
        return False
