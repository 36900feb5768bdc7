"""Uvicorn's protocols, with every answer of their own in the one shape, and their log bounded.

What no application sees (a request that is no HTTP, one connection too many, a handshake that is none) is
answered here, as every other error is.
"""

import asyncio
import logging
import time
from http import HTTPStatus
from typing import Any, Final

import h11
import uvicorn
from starlette.responses import Response
from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState
from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.http11 import Response as Handshake
from websockets.server import ServerProtocol

from gcs.api.errors import error_response
from gcs.api.rate_limit import Bucket

CONNECTIONS_MAX: Final = 256
"""Of each listener; one more is answered 503 and closed."""

FULL: Final = f"{CONNECTIONS_MAX} connections are open already: close some, or call again in a second"
NO_HTTP: Final = "this is no HTTP/1.1 request that can be read"

LINES_PER_S: Final = 1.0
LINES_BURST: Final = 10.0
"""Warnings and errors of the server, of each kind; more of them than these are counted, or they would fill
the disk.
"""


class Sparse(logging.Filter):
    """Lets a few lines of each kind pass, and says with the next one how many were left out."""

    def __init__(self) -> None:
        super().__init__()
        self._buckets: dict[str, Bucket] = {}  # by the text before anything is filled in: a handful
        self._left_out: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether this line is written."""
        kind = str(record.msg)
        bucket = self._buckets.setdefault(kind, Bucket(LINES_PER_S, LINES_BURST))
        if not bucket.take(time.monotonic()):
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        if left_out := self._left_out.pop(kind, 0):
            record.left_out = left_out
        return True


SPARSE: Final = Sparse()


def bound_log() -> None:
    """Have the server log through the one filter; a second call changes nothing."""
    logging.getLogger("uvicorn.error").addFilter(SPARSE)


class Http(H11Protocol):
    """HTTP/1.1."""

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self._served: Any = self.app
        self.app = self._answer

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        if max(len(self.connections), len(self.tasks)) > CONNECTIONS_MAX:
            response = error_response(HTTPStatus.SERVICE_UNAVAILABLE, FULL)
            response.headers.update({"Connection": "close", "Retry-After": "1"})
            self.logger.warning("more than %d connections", CONNECTIONS_MAX)
            await response(scope, receive, send)
        else:
            await self._served(scope, receive, send)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, and close. `msg` is the log's."""
        del msg
        response = error_response(HTTPStatus.BAD_REQUEST, NO_HTTP)
        headers = [*response.raw_headers, (b"connection", b"close")]
        if self.conn.our_state not in {h11.IDLE, h11.SEND_RESPONSE}:  # half an answer has left already
            self.transport.close()
            return
        answer = h11.Response(status_code=response.status_code, headers=headers, reason=b"Bad Request")
        for event in (answer, h11.Data(data=bytes(response.body)), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()


class _Handshakes(ServerProtocol):
    """Refuses a handshake in the one shape."""

    def reject(self, status: int, text: str) -> Handshake:
        """The answer to a handshake that is none, or that failed."""
        response = error_response(status, text.strip() or "no WebSocket is opened here")
        return _handshake(response)


class Viewer(WebSocketsSansIOProtocol):
    """A WebSocket that keeps nothing but what is on its way, and says when all of it has left.

    What is sent next is then the newest at that time, not what waited.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        super().__init__(config, server_state, app_state, _loop)
        self.conn = _Handshakes(max_size=config.ws_max_size, logger=self.logger)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Pause whoever sends as long as anything is left."""
        super().connection_made(transport)
        self.transport.set_write_buffer_limits(high=0)

    def handle_connect(self, event: Request) -> None:
        """Let the app know how to wait for that."""
        super().handle_connect(event)
        if self.handshake_initiated and not self.handshake_complete:
            self.scope["state"]["drained"] = self.writable.wait

    async def send(self, message: Any) -> None:
        """Know that a denial is an answer: uvicorn would log an error for each, at a caller's pace."""
        await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True


def _handshake(response: Response) -> Handshake:
    headers = Headers(
        [(name.decode("latin-1"), value.decode("latin-1")) for name, value in response.raw_headers]
    )
    headers["Connection"] = "close"
    return Handshake(
        response.status_code, HTTPStatus(response.status_code).phrase, headers, bytes(response.body)
    )
