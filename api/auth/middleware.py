"""Refuses requests before any route: without the right, too large or too slow, or from a foreign web page.

On the loopback interface the API may ask for no token. A page open in a browser on the same machine could
then post to it and, under a host name that the page controls (DNS rebinding), also read from it. Therefore a
request must name this service by an IP address or a known host name, and a request from a web page must come
from a page of this service.
"""

import asyncio
import json
import re
from collections.abc import Iterator, Sequence
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any, Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.auth.authorization import Authorization, Principal, Refusal, Request, is_emergency, needed
from gcs.api.errors import echo, error_response, invalid_response, refuse
from gcs.api.schemas import reports
from gcs.api.schemas.requests import BODY_MAX_BYTES
from gcs.model.errors import UNSEEN_IN_LINE, cut
from gcs.service import CALLER, Audit, Call

READING: Final = frozenset({"GET", "HEAD", "OPTIONS"})
DENIED: Final = frozenset({HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.TOO_MANY_REQUESTS})

RECORDED_MAX_BYTES: Final = 4096
"""Bytes of a body that are recorded; the rest is left out."""

CALLER_KEY: Final = "gcs.caller"
"""Key of the ASGI scope for the caller's name. The access middleware sets it, and `gcs.service.CALLER`."""


class Audited:
    """ASGI middleware around the whole app, outside every middleware that may deny a call."""

    def __init__(self, app: ASGIApp, audit: Audit) -> None:
        self._app = app
        self._audit = audit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        body = bytearray()

        async def record_body() -> Message:
            message = await receive()
            if message["type"] == "http.request":
                body.extend(message.get("body", b"")[: RECORDED_MAX_BYTES - len(body)])
            return message

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                await self._record(scope, bytes(body), message)
            await send(message)

        await self._app(scope, record_body, answer)

    async def _record(self, scope: Scope, body: bytes, start: Message) -> None:
        status, changes = start["status"], scope["method"] not in READING
        if not changes and status not in DENIED:
            return
        caller = scope.get(CALLER_KEY) or CALLER.get()
        text = (scope["query_string"] if _is_upload(scope) else body).decode(errors="replace")
        self._audit.call(Call(caller, scope["method"], scope["path"], text, status))
        if changes and status < HTTPStatus.BAD_REQUEST and not await self._audit.kept():
            MutableHeaders(scope=start)["X-Recorded"] = "no"


BODY_S: Final = 10.0
"""Seconds for a whole body to arrive: an unfinished request holds a connection that others need."""

UPLOAD: Final = ("POST", "/api/v1/shows")
"""The one request with a larger body: its route bounds size and time, and writes the body to a file."""

DRAIN_MAX_BYTES: Final = 1024 * 1024
"""Bytes of a body that are read at most; an oversized one is dropped, and the client receives the reason."""


class AccessMiddleware:
    """ASGI middleware around the whole app."""

    def __init__(self, app: ASGIApp, names: Sequence[str], authorization: Authorization) -> None:
        self._app = app
        self._authorization = authorization
        self._names = frozenset(name.lower() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        call, principal = _call(scope), self._authorization.principal(Headers(scope=scope))
        scope[CALLER_KEY] = principal.name
        foreign = self._foreign(call)
        refusal = Refusal(403, foreign) if foreign else self._authorization.refusal(principal, call)
        if refusal is not None:
            self._authorization.log_refusal(principal, call, refusal)
            await _deny(refusal, scope, receive, send)
            return
        token = CALLER.set(principal.name)
        try:
            await self._enter(scope, receive, send, principal)
        finally:
            CALLER.reset(token)

    async def _enter(self, scope: Scope, receive: Receive, send: Send, principal: Principal) -> None:
        if scope["type"] == "websocket":
            scope.setdefault("state", {})["is_authorized"] = lambda: self._authorization.is_authorized(
                principal
            )
            await self._app(scope, receive, send)
            return
        if _is_upload(scope):
            await (_refused_coding(Headers(scope=scope)) or self._app)(scope, receive, send)
            return
        try:
            async with asyncio.timeout(BODY_S):
                body = await _read(receive)
            refusal = _refused_body(Headers(scope=scope), body)
        except TimeoutError:
            body, refusal = b"", error_response(408, f"the body did not come within {BODY_S:g} s")
        except ClientDisconnect:  # the request is incomplete, and no client is left to answer
            return
        await (refusal or self._app)(scope, _replay(body or b"", receive), send)

    def _foreign(self, call: Request) -> str:
        """Why this request is not accepted by its host, origin or embedding page; empty when it is."""
        host = call.headers.get("host", "")
        if not self._is_ours(host):
            return f"host name {cut(host)!r} is not accepted; use the service's IP address"
        origin = call.headers.get("origin")
        if origin is not None and origin.lower().partition("://")[2] != host.lower():
            return f"a web page of {cut(origin)!r} may not command this service"
        if _is_embedded(call):
            return "a web page of another site may not use this service; open it in a window of its own"
        return ""

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in self._names or bool(ip_address(name))
        except ValueError:  # neither an address nor a valid name
            return False


class EmergencyLane:
    """ASGI middleware of the emergency listener: it passes emergency calls and `/healthz`, others get 404."""

    def __init__(self, app: ASGIApp, port: int) -> None:
        """`port` is where the other calls are answered."""
        self._app, self._port = app, port

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        call = _call(scope)
        if is_emergency(call.method, call.path) or call.path == "/healthz":
            await self._app(scope, receive, send)
        else:
            elsewhere = f"this port answers emergency calls alone; port {self._port} answers all others"
            refusal = Refusal(404, elsewhere)
            await _deny(refusal, scope, receive, send)


def _is_embedded(call: Request) -> bool:
    """Whether a page of another site embeds the resource (image, frame): a request without `Origin`.

    Such a request is refused before the rate limit counts it: it must not use up the calls of the operator's
    own page. A link from another site is allowed: an operator may open the console with it.
    """
    if call.headers.get("sec-fetch-site", "none") in {"none", "same-origin"}:
        return False
    is_link = (
        call.headers.get("sec-fetch-mode") == "navigate" and call.headers.get("sec-fetch-dest") == "document"
    )
    return not (is_link and call.method == "GET" and needed(call.method, call.path) is None)


def _is_upload(scope: Scope) -> bool:
    return (scope.get("method"), scope["path"]) == UPLOAD


def _call(scope: Scope) -> Request:
    address = scope.get("client")
    return Request(
        method=scope.get("method", "WEBSOCKET"),
        path=scope["path"],
        headers=Headers(scope=scope),
        address="" if address is None else str(address[0]),
    )


async def _deny(refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
    response = error_response(refusal.status, refusal.reason)
    if refusal.status == 401:
        response.headers["WWW-Authenticate"] = "Bearer"
    elif refusal.status == 429:
        response.headers["Retry-After"] = "1"
    await refuse(response, scope, receive, send)


async def _read(receive: Receive) -> bytes | None:
    """Read the whole body; None when it is too large. Raises: ClientDisconnect when the client has gone."""
    body, size, more = b"", 0, True
    while more and size <= DRAIN_MAX_BYTES:
        message = await receive()
        if message["type"] != "http.request":
            raise ClientDisconnect
        chunk = message.get("body", b"")
        size += len(chunk)
        body = body + chunk if size <= BODY_MAX_BYTES else b""
        more = message.get("more_body", False)
    return body if size <= BODY_MAX_BYTES else None


def _refused_body(headers: Headers, body: bytes | None) -> Response | None:
    """The refusal of a body that is too large (None), compressed or invalid JSON; None: accepted."""
    if body is None:
        return error_response(413, f"the body is larger than {BODY_MAX_BYTES} bytes")
    refusal = _refused_coding(headers)
    if refusal is not None:
        return refusal
    problem = find_problem(headers, body)
    return None if problem is None else invalid_response([problem])


def _refused_coding(headers: Headers) -> Response | None:
    """The refusal of a compressed body; None: accepted."""
    coding = headers.get("content-encoding", "identity").strip().lower()
    if coding in ("", "identity"):
        return None
    detail = f"Content-Encoding: {cut(coding)} is not accepted; send the body uncompressed"
    return error_response(415, detail)


def _replay(body: bytes, receive: Receive) -> Receive:
    """Return a receive channel that yields the body in one message, then continues with `receive`."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return waiting.pop() if waiting else await receive()

    return next_message


DEPTH_MAX: Final = 32
"""Most nested objects and lists; the deepest valid request has 3."""

DIGITS_MAX: Final = 300
"""Most digits of an integer; the largest float has 309."""

_MARKS: Final = re.compile(r'"(?:[^"\\]|\\.)*"?|[\[{]|[\]}]', re.DOTALL)


class _Twice(dict[str, Any]):
    """A JSON object with a repeated name."""

    def __init__(self, pairs: Sequence[tuple[str, Any]]) -> None:
        super().__init__(pairs)
        seen: set[str] = set()
        self.name = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]


class _Long(str):
    """The digits of an integer that is too long."""

    __slots__ = ()


def find_problem(headers: Headers, body: bytes) -> reports.FieldProblem | None:
    """Return the first problem of a body that is declared as JSON; None when it has none.

    A body that cannot be parsed as JSON also returns None: its route reports the error.
    """
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if not body.strip() or not (kind == "application/json" or kind.endswith("+json")):
        return None
    try:
        text = body.decode()
    except UnicodeDecodeError as error:
        allowed = f"JSON in UTF-8; byte {error.start} is not"
        return reports.FieldProblem(field="body", value=None, allowed=allowed)
    if text.count("[") + text.count("{") > DEPTH_MAX and _depth(text) > DEPTH_MAX:
        return reports.FieldProblem(field="body", value=None, allowed=f"JSON at most {DEPTH_MAX} levels deep")
    try:
        value = json.loads(
            text,
            object_pairs_hook=lambda pairs: _Twice(pairs) if len(dict(pairs)) < len(pairs) else dict(pairs),
            parse_int=lambda digits: int(digits) if len(digits) <= DIGITS_MAX else _Long(digits),
        )
    except json.JSONDecodeError:
        return None
    return next(_problems(value, ()), None)


def _depth(text: str) -> int:
    """Nesting depth of objects and lists; counting stops above `DEPTH_MAX`."""
    depth = deepest = 0
    for mark in _MARKS.finditer(text):
        depth += (mark[0] in "[{") - (mark[0] in "]}")
        deepest = max(deepest, depth)
        if deepest > DEPTH_MAX:
            break
    return deepest


def _problems(value: object, path: tuple[str, ...]) -> Iterator[reports.FieldProblem]:
    """Yield every problem inside a value, with the dotted name of its field."""
    if isinstance(value, _Twice):
        name = _field((*path, value.name))
        yield reports.FieldProblem(field=name, value=echo(value[value.name]), allowed="given once, not twice")
    if isinstance(value, _Long):
        allowed = f"a number of at most {DIGITS_MAX} digits"
        yield reports.FieldProblem(field=_field(path), value=echo(str(value)), allowed=allowed)
    if isinstance(value, str) and UNSEEN_IN_LINE.search(value):
        allowed = "text without control characters, on one line"
        yield reports.FieldProblem(field=_field(path), value=echo(value), allowed=allowed)
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _problems(part, (*path, name))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _problems(part, (*path, str(index)))


def _field(path: Sequence[str]) -> str:
    return cut(".".join(path)) or "body"
