"""Request targets in absolute form (`GET http://host:port/path HTTP/1.1`), as RFC 9112, 3.2.2 demands.

A client that believes it talks to a proxy sends them. Everything behind this sees a request in origin form
whose Host header is the target's authority, so hosts, origins and paths are judged in one way only.
"""

import re
from http import HTTPStatus
from typing import Final
from urllib.parse import unquote, urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from gcs.api.errors import error_response
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
        problem = _problem(scheme, authority, SECURE[scope.get("scheme", "http")])
        if problem:
            await _refuse(f"request target {cut(scope['path'])!r}: {problem}", scope, receive, send)
            return
        headers = [(b"host", authority), *(each for each in scope["headers"] if each[0] != b"host")]
        inner = {**scope, "path": unquote(path.decode("ascii")), "raw_path": path, "headers": headers}
        await self._app(inner, receive, send)


def _problem(scheme: str, authority: bytes, expected: str) -> str:
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


async def _refuse(detail: str, scope: Scope, receive: Receive, send: Send) -> None:
    response = error_response(HTTPStatus.BAD_REQUEST, detail)
    if scope["type"] == "websocket":
        await receive()  # ASGI: the connect message comes before any response
        await WebSocket(scope, receive, send).send_denial_response(response)
    else:
        await response(scope, receive, send)
