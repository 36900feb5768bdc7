"""What is refused before any route sees it: too much, and what a foreign web page sends.

The API listens on the loopback interface and asks for no password, so any page open in a browser on the
same machine could post to it, and by a name it controls (DNS rebinding) also read. Hence: a request must
name this service by an IP address or a known name, and one that comes from a page must come from a page of
this service.
"""

from collections.abc import Sequence
from ipaddress import ip_address
from typing import Final
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.problems import error_response

BODY_MAX_BYTES: Final = 64 * 1024
"""The largest proper request, a start with thousands of names, fits."""

DRAIN_MAX_BYTES: Final = 1024 * 1024
"""Read and thrown away, so that whoever sends too much still hears why, and is not just cut off."""


class Guard:
    """ASGI middleware around the whole app."""

    def __init__(self, app: ASGIApp, names: Sequence[str]) -> None:
        self._app = app
        self._names = frozenset(name.lower() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Headers(scope=scope))
        if scope["type"] == "websocket":
            if refusal:
                await receive()  # the connect message, without which a close is no ASGI
                await send({"type": "websocket.close", "code": 1008, "reason": refusal})
            else:
                await self._app(scope, receive, send)
            return
        if refusal:
            await error_response(403, refusal)(scope, receive, send)
            return
        try:
            body = await _read(receive)
        except ClientDisconnect:  # half a request is none, and nobody will read the answer
            return
        if body is None:
            detail = f"the body is larger than {BODY_MAX_BYTES} bytes"
            await error_response(413, detail)(scope, receive, send)
            return
        await self._app(scope, _replay(body, receive), send)

    def _refusal(self, headers: Headers) -> str:
        """Why this request is not ours to answer; empty when it is."""
        host = headers.get("host", "")
        if not self._is_ours(host):
            return f"this service is not called {host!r}: use its IP address"
        origin = headers.get("origin")
        if origin is not None and origin.lower().partition("://")[2] != host.lower():
            return f"a web page of {origin!r} may not command this service"
        return ""

    def _is_ours(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
            return name in self._names or bool(ip_address(name))
        except ValueError:  # neither an address nor a proper name
            return False


async def _read(receive: Receive) -> bytes | None:
    """The whole body, or None when it is too large. Raises: ClientDisconnect when it does not come."""
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
    """A channel which gives the body in one piece, then goes on as before."""
    waiting: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return waiting.pop() if waiting else await receive()

    return next_message
