"""HTTP semantics of every listener: request targets, HEAD and OPTIONS, security headers."""

import re
from collections.abc import Awaitable, Callable, Sequence
from http import HTTPStatus
from typing import Final
from urllib.parse import unquote, urlsplit

from starlette.datastructures import MutableHeaders
from starlette.responses import Response
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.api.errors import SECURITY_HEADERS, error_response, refuse
from gcs.model.errors import cut

ABSOLUTE: Final = re.compile(rb"([A-Za-z][A-Za-z0-9+.-]*)://([^/]*)(/.*)?", re.DOTALL)

SECURE: Final = {"http": "http", "ws": "http", "https": "https", "wss": "https"}
"""Scheme of an absolute target by ASGI's scheme of the connection (`ws` for a WebSocket handshake)."""


class AbsoluteTarget:
    """ASGI middleware around everything that a listener serves."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Translate the target to origin form, refuse one that is malformed, pass on all others."""
        found = None
        if scope["type"] in ("http", "websocket"):
            found = ABSOLUTE.fullmatch(scope.get("raw_path") or b"")
        if found is None:
            await self._app(scope, receive, send)
            return
        scheme, authority, path = found[1].decode().lower(), found[2], found[3] or b"/"
        problem = _target_problem(scheme, authority, SECURE[scope.get("scheme", "http")])
        if problem:
            detail = f"request target {cut(scope['path'])!r}: {problem}"
            await refuse(error_response(HTTPStatus.BAD_REQUEST, detail), scope, receive, send)
            return
        headers = [(b"host", authority), *(each for each in scope["headers"] if each[0] != b"host")]
        inner = {**scope, "path": unquote(path.decode("ascii")), "raw_path": path, "headers": headers}
        await self._app(inner, receive, send)


def _target_problem(scheme: str, authority: bytes, expected: str) -> str:
    """The problem of an absolute target; empty when it is valid."""
    if SECURE.get(scheme) != expected:
        return f"the scheme is {scheme!r}; this listener answers {expected}:// alone"
    if b"@" in authority:
        return "it names a user; a target is http://HOST:PORT/PATH, and tokens go into Authorization"
    try:
        parts = urlsplit(f"//{authority.decode('ascii')}")
        named = bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:  # an invalid port, or an incomplete IPv6 address
        named = False
    return "" if named else "it names no host and port; a target is http://HOST:PORT/PATH"


METHODS: Final = ("DELETE", "GET", "HEAD", "OPTIONS", "PATCH", "POST", "PUT")
EVERYTHING: Final = "*"
"""Target of an OPTIONS request for the whole service (RFC 9110, 7.1)."""


def allowed(routes: Sequence[BaseRoute], scope: Scope) -> list[str]:
    """Methods of the request's path, as in the header `Allow`; empty when no route has that path."""
    if scope["path"] == EVERYTHING:
        return list(METHODS)
    found = {
        method
        for method in METHODS
        for route in routes
        if route.matches({**scope, "type": "http", "method": method})[0] is Match.FULL
    }
    if not found:
        return []
    return sorted(found | {"OPTIONS"} | ({"HEAD"} if "GET" in found else set()))


class Methods:
    """ASGI middleware directly around the routes: HEAD is GET without the body, OPTIONS names the methods."""

    def __init__(self, app: ASGIApp, routes: Callable[[], Sequence[BaseRoute]]) -> None:
        """`routes` returns the routes of the app, which may still grow."""
        self._app = app
        self._routes = routes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        method = scope.get("method")
        if method == "OPTIONS" and (names := allowed(self._routes(), scope)):
            await Response(status_code=204, headers={"Allow": ", ".join(names)})(scope, receive, send)
        elif method == "HEAD" and "GET" in allowed(self._routes(), scope):
            await self._app({**scope, "method": "GET"}, receive, _without_body(send))
        else:
            await self._app(scope, receive, send)


def _without_body(send: Send) -> Callable[[Message], Awaitable[None]]:
    async def head(message: Message) -> None:
        await send({**message, "body": b""} if message["type"] == "http.response.body" else message)

    return head


STARTS: Final = frozenset({"http.response.start", "websocket.http.response.start"})


class SecurityHeaders:
    """The outermost ASGI middleware: every response has the headers, refusals and bugs included."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def answer(message: Message) -> None:
            if message["type"] in STARTS:
                headers = MutableHeaders(scope=message)
                for name, value in SECURITY_HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self._app(scope, receive, answer)
