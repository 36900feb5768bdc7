"""Records every call that may change something, and every denied call, before its response is sent.

An accepted call is executed at once; its response is sent when the record holds the call. No call that was
answered is missing in the record, and no urgent command waits for a disk.
"""

from http import HTTPStatus
from typing import Final

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gcs.service import CALLER, Audit, Call

READING: Final = frozenset({"GET", "HEAD", "OPTIONS"})
DENIED: Final = frozenset({HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN, HTTPStatus.TOO_MANY_REQUESTS})

BODY_MAX_BYTES: Final = 4096
"""Bytes of a body that are recorded; the rest is left out."""

WHO_KEY: Final = "gcs.who"
"""Key of the ASGI scope for the caller's name. The access middleware sets it, and `gcs.service.CALLER`."""


class Audited:
    """ASGI middleware around the whole app, outside every middleware that may deny a call."""

    def __init__(self, app: ASGIApp, audit: Audit) -> None:
        self._app = app
        self._audit = audit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the call on; record it before its response is sent."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        body = bytearray()

        async def hear() -> Message:
            message = await receive()
            if message["type"] == "http.request":
                body.extend(message.get("body", b"")[: BODY_MAX_BYTES - len(body)])
            return message

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                await self._note(scope, bytes(body), message)
            await send(message)

        await self._app(scope, hear, answer)

    async def _note(self, scope: Scope, body: bytes, start: Message) -> None:
        status, changes = start["status"], scope["method"] not in READING
        if not changes and status not in DENIED:
            return
        who = scope.get(WHO_KEY) or CALLER.get()
        text = body.decode(errors="replace")
        self._audit.call(Call(who, scope["method"], scope["path"], text, status))
        if changes and status < HTTPStatus.BAD_REQUEST and not await self._audit.kept():
            MutableHeaders(scope=start)["X-Recorded"] = "no"
