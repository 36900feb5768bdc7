"""Authorization: the right that a call needs, its caller, rate limits, and the audit of denied calls.

Emergency calls and map tiles have rate limits of their own, which other calls cannot use up.
"""

import asyncio
import logging
import secrets
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import Enum, auto
from math import inf
from typing import Final

from starlette.datastructures import Headers

from gcs.api.auth.tokens import Entry, Tokens
from gcs.api.console_files import is_public
from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import Offer
from gcs.model.state import VehicleId
from gcs.service import ShowAction, VehicleAction
from gcs.service.access import ACCESS_OFF, ANONYMOUS, LOCAL, RIGHTS, Audit, Denied, Right, Role


@dataclass(slots=True)
class Bucket:
    """A token bucket: `burst` calls at once, then `rate_per_s`. Callers pass the time, of any one clock."""

    rate_per_s: float
    burst: float
    _left: float = field(default=inf, init=False)
    _time_s: float = field(default=-inf, init=False)

    def take(self, now_s: float) -> bool:
        """Whether one more call is allowed now; a refused call takes no token."""
        gained = self.rate_per_s * (now_s - self._time_s)
        self._left, self._time_s = min(self.burst, self._left + gained), now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


log = logging.getLogger(__name__)

PUBLIC: Final = frozenset({"/healthz", "/readyz", "/docs", "/openapi.json"})
"""Paths without a token. They reveal only whether the service is healthy, and probes have no secrets. The
console's page is public as well: it asks for the token.
"""

PROBES: Final = frozenset({"/healthz", "/readyz"})
"""Paths without a rate limit: a flood of calls must not fail a probe and so restart the service while
vehicles fly. A response costs no more than a refusal.
"""

STREAM: Final = "/api/v1/stream"
"""Path prefix of the WebSockets that only read."""

READING: Final = frozenset({"GET", "HEAD", "OPTIONS", "WEBSOCKET"})

EMERGENCIES: Final = frozenset(
    {
        *(ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT),
        Offer.BRING_HOME,
        *(VehicleAction.HOLD, VehicleAction.RETURN, VehicleAction.LAND),
    }
)
"""Commands that can only reduce a flight."""

KILL: Final = frozenset({"/api/v1/kill", "/api/v1/kill/confirm"})
"""Paths of a kill, which are emergency calls as well."""

MAP: Final = "/api/v1/map/"
"""Path prefix of map tiles; a page requests dozens at a time."""

SUBPROTOCOL: Final = "gcs.v1"
BEARER: Final = "bearer."
"""Prefix of the token as a subprotocol. A browser cannot set headers of a WebSocket: it offers the
subprotocols `gcs.v1` and `bearer.TOKEN`.
"""

AUDIT_PER_S: Final = 10.0
AUDIT_BURST: Final = 100.0
"""Denied calls that are audited one by one; more are summed up each second, or they would fill the disk."""


def log_denied(denied: Denied) -> None:
    """Audit of a service without a record: log the denied call."""
    log.warning("access_denied", extra=asdict(denied))


def is_emergency(method: str, path: str) -> bool:
    start, _, action = path.rpartition("/")
    ours = start in {"/api/v1/show", "/api/v1/vehicles", "/api/v1/fleet"} or start.startswith(
        "/api/v1/vehicles/"
    )
    acknowledges = action == "acknowledge" and f"{start}/".startswith("/api/v1/alarms/")
    return method == "POST" and (path in KILL or acknowledges or (ours and action in EMERGENCIES))


def needed(method: str, path: str) -> Right | None:
    """The right that a call needs; None: no right. Calls not known to be harmless need `OPERATE`."""
    if path in PUBLIC or (is_public(path) and method in READING):
        return None
    if method in READING and (method != "WEBSOCKET" or path.startswith(STREAM)):
        return Right.WATCH
    return Right.EMERGENCY if is_emergency(method, path) else Right.OPERATE


class Lane(Enum):
    """Kinds of calls with separate rate limits: calls of one kind cannot use up the rate of another."""

    EMERGENCY = auto()
    MAP = auto()
    OTHERS = auto()


@dataclass(frozen=True, slots=True)
class Principal:
    """The caller and its rights."""

    name: str
    rights: frozenset[Right]
    entry: Entry | None = None


@dataclass(frozen=True, slots=True)
class Request:
    """A request before its body is read."""

    method: str  # WEBSOCKET for the stream
    path: str
    headers: Headers
    address: str


@dataclass(frozen=True, slots=True)
class Refusal:
    """HTTP status and reason of a denied call."""

    status: int
    reason: str


class Authorization:
    """Decides about every call. Use it only on the event loop."""

    def __init__(
        self,
        tokens: Tokens | None = None,
        *,
        calls_per_s: float = inf,
        burst: float = inf,
        audit: Audit = log_denied,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Without `tokens` every caller has every right, which is safe on the loopback interface only."""
        self._tokens = tokens
        self.demands_tokens = tokens is not None
        self.text = "tokens" if self.demands_tokens else ACCESS_OFF
        self._calls_per_s = calls_per_s
        self._audit = audit
        self._clock_s = clock_s
        # one for each name and lane
        self._buckets: defaultdict[tuple[str, Lane], Bucket] = defaultdict(lambda: Bucket(calls_per_s, burst))
        self._audit_bucket = Bucket(AUDIT_PER_S, AUDIT_BURST)
        self._not_audited = 0
        self.denied = 0
        self.shed = 0

    def principal(self, headers: Headers) -> Principal:
        """The caller, from its token; anonymous without a valid one."""
        if self._tokens is None:
            return Principal(LOCAL, RIGHTS[Role.OPERATE])
        token = _token(headers)
        entry = self._tokens.find(token) if token else None
        if entry is None:
            return Principal(ANONYMOUS, frozenset())
        return Principal(entry.name, RIGHTS[entry.role], entry)

    def is_authorized(self, principal: Principal) -> bool:
        """Whether an admitted caller is still authorized: its token is not revoked."""
        return self._tokens is None or principal.entry is None or self._tokens.has(principal.entry)

    def refusal(self, principal: Principal, call: Request) -> Refusal | None:
        """Why this call is denied; None when it is allowed."""
        right = needed(call.method, call.path)
        in_lane = right is Right.EMERGENCY and right in principal.rights
        is_probe = call.path in PROBES and call.method in READING
        lane = Lane.EMERGENCY if in_lane else Lane.MAP if call.path.startswith(MAP) else Lane.OTHERS
        if not is_probe and not self._buckets[principal.name, lane].take(self._clock_s()):
            self.shed += 1
            return Refusal(429, f"too many calls: {self._calls_per_s:g} a second may come")
        if right is None or right in principal.rights:
            return None
        if principal.name == ANONYMOUS:
            return Refusal(401, "a token is needed: Authorization: Bearer TOKEN; gcs token create makes one")
        roles = " or ".join(role for role in Role if right in RIGHTS[role])
        return Refusal(403, f"{principal.name} may not: this needs a token of role {roles}")

    def log_refusal(self, principal: Principal, call: Request, refusal: Refusal) -> None:
        """Report a denied call to the audit, at a limited rate."""
        self.denied += 1
        called = principal.name, call.address, call.method, call.path[:200]
        reported = Denied(time.time(), *called, refusal.status, refusal.reason)
        if self._audit_bucket.take(self._clock_s()):
            self._audit(reported)
            return
        self._not_audited += 1
        if self._not_audited == 1:
            asyncio.get_running_loop().call_later(1.0, self._audit_rest, reported)

    def _audit_rest(self, first: Denied) -> None:
        count, self._not_audited = self._not_audited, 0
        self._audit(replace(first, count=count))


def _token(headers: Headers) -> str:
    """The token of the request; empty when it has none."""
    kind, _, token = headers.get("authorization", "").partition(" ")
    if kind.lower() == "bearer":
        return token.strip()
    offered = [each.strip() for each in headers.get("sec-websocket-protocol", "").split(",")]
    return next((each.removeprefix(BEARER) for each in offered if each.startswith(BEARER)), "")


VALID_S: Final = 20.0
"""Seconds that a code is valid: enough to read the vehicles and type the code, too short for a code from a
terminal's history.
"""

WAITING_MAX: Final = 100
"""Most armed kills of one caller at a time; one more drops its oldest, and none of another caller."""


@dataclass(frozen=True, slots=True)
class Armed:
    """A kill that waits for its confirmation."""

    code: str
    vehicles: tuple[VehicleId, ...]
    caller: str
    until_s: float


class KillSwitch:
    """Holds the armed kills. A code works once, within `VALID_S`, and for the caller that armed it."""

    def __init__(self, make_code: Callable[[], str] = lambda: secrets.token_hex(3)) -> None:
        """Six hexadecimal digits cannot be guessed within `VALID_S`."""
        self._make_code = make_code
        self._waiting: dict[str, Armed] = {}

    def arm(self, vehicles: Sequence[VehicleId], caller: str, now_s: float) -> Armed:
        """Make a code for these vehicles; nothing is sent to them yet."""
        self._waiting = {code: one for code, one in self._waiting.items() if one.until_s > now_s}
        own = [code for code, one in self._waiting.items() if one.caller == caller]
        for code in own[: len(own) - WAITING_MAX + 1]:
            del self._waiting[code]
        while (code := self._make_code()) in self._waiting:
            pass  # another caller's must not be replaced
        armed = Armed(code, tuple(vehicles), caller, now_s + VALID_S)
        self._waiting[armed.code] = armed
        return armed

    def confirm(self, code: str, caller: str, now_s: float) -> tuple[VehicleId, ...]:
        """Return a code's vehicles. Raises: RefusedError for an unknown, used, expired or foreign code."""
        armed = self._waiting.get(code)
        if armed is None or armed.caller != caller:
            raise RefusedError(f"{code!r} confirms nothing: arm the kill first; a code works once")
        del self._waiting[code]
        if now_s > armed.until_s:
            raise RefusedError(f"{code!r} came too late: it was good for {VALID_S:g} s; arm the kill again")
        return armed.vehicles
