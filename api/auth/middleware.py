"""Refuses requests before any route: without the right, too large or too slow, or from a foreign web page.

On the loopback interface the API may ask for no token. A page open in a browser on the same machine could
then post to it and, under a host name that the page controls (DNS rebinding), also read from it. Therefore a
request must name this service by an IP address or a known host name, and a request from a web page must come
from a page of this service.
"""

import asyncio
from collections.abc import Sequence
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from gcs.api.auth.audit import WHO_KEY
from gcs.api.auth.authorization import Authorization, Call, Principal, Refusal, is_emergency, needed
from gcs.api.auth.strict_json import find_problem
from gcs.api.errors import error_response, invalid_response
from gcs.model.errors import cut
from gcs.service import CALLER

BODY_MAX_BYTES: Final = 64 * 1024
"""Limit of a request body; the largest valid one, a start with thousands of names, is smaller."""

BODY_S: Final = 10.0
"""Seconds for a whole body to arrive: an unfinished request holds a connection that others need."""

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
        scope[WHO_KEY] = principal.name
        foreign = self._foreign(call)
        refusal = Refusal(403, foreign) if foreign else self._authorization.refusal(principal, call)
        if refusal is not None:
            self._authorization.turned_away(principal, call, refusal)
            await _turn_away(refusal, scope, receive, send)
            return
        who = CALLER.set(principal.name)
        try:
            await self._enter(scope, receive, send, principal)
        finally:
            CALLER.reset(who)

    async def _enter(self, scope: Scope, receive: Receive, send: Send, principal: Principal) -> None:
        if scope["type"] == "websocket":
            scope.setdefault("state", {})["is_authorized"] = lambda: self._authorization.is_authorized(
                principal
            )
            await self._app(scope, receive, send)
            return
        try:
            async with asyncio.timeout(BODY_S):
                body = await _read(receive)
        except TimeoutError:
            await error_response(408, f"the body did not come within {BODY_S:g} s")(scope, receive, send)
            return
        except ClientDisconnect:  # the request is incomplete, and no client is left to answer
            return
        if body is None:
            detail = f"the body is larger than {BODY_MAX_BYTES} bytes"
            await error_response(413, detail)(scope, receive, send)
            return
        headers = Headers(scope=scope)
        coding = headers.get("content-encoding", "identity").strip().lower()
        if coding not in ("", "identity"):
            detail = f"Content-Encoding: {cut(coding)} is not accepted; send the body uncompressed"
            await error_response(415, detail)(scope, receive, send)
            return
        problem = find_problem(headers, body)
        if problem is not None:
            await invalid_response([problem])(scope, receive, send)
            return
        await self._app(scope, _replay(body, receive), send)

    def _foreign(self, call: Call) -> str:
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

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        call = _call(scope)
        if is_emergency(call.method, call.path) or call.path == "/healthz":
            await self._app(scope, receive, send)
        else:
            refusal = Refusal(404, "this port answers emergency calls alone; everything else is at the other")
            await _turn_away(refusal, scope, receive, send)


def _is_embedded(call: Call) -> bool:
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


def _call(scope: Scope) -> Call:
    address = scope.get("client")
    return Call(
        method=scope.get("method", "WEBSOCKET"),
        path=scope["path"],
        headers=Headers(scope=scope),
        address="" if address is None else str(address[0]),
    )


async def _turn_away(refusal: Refusal, scope: Scope, receive: Receive, send: Send) -> None:
    response = error_response(refusal.status, refusal.reason)
    if refusal.status == 401:
        response.headers["WWW-Authenticate"] = "Bearer"
    elif refusal.status == 429:
        response.headers["Retry-After"] = "1"
    if scope["type"] == "websocket":
        await receive()  # ASGI: the connect message comes before any response
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)


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


def _replay(body: bytes, receive: Receive) -> Receive:
    """Return a receive channel that yields the body in one message, then continues with `receive`."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return waiting.pop() if waiting else await receive()

    return next_message
