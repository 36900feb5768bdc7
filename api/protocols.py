"""Uvicorn's protocols, with their own error responses in the common shape and a bounded log.

Errors that no application sees (an invalid HTTP request, one connection too many, an invalid WebSocket
handshake) are answered here in the same shape as every other error.
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
"""Most connections of one listener; one more is answered 503 and closed."""

FULL: Final = f"{CONNECTIONS_MAX} connections are open already: close some, or call again in a second"
NO_HTTP: Final = "this is no HTTP/1.1 request that can be read"

LINES_PER_S: Final = 1.0
LINES_BURST: Final = 10.0
"""Log lines of each kind (warnings and errors of the server) at once; more are only counted, or they would
fill the disk.
"""


class Sparse(logging.Filter):
    """Log filter that limits the rate of each kind of line; the next line says how many were left out."""

    def __init__(self) -> None:
        super().__init__()
        self._buckets: dict[str, Bucket] = {}  # by the unformatted message, of which there are only a few
        self._left_out: dict[str, int] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether this line is logged."""
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
    """Add the shared filter to the server's log; a second call changes nothing."""
    logging.getLogger("uvicorn.error").addFilter(SPARSE)


class Http(H11Protocol):
    """HTTP/1.1 with a limit of connections and errors in the common shape."""

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
        """Answer an invalid HTTP request, and close. `msg` is not used."""
        del msg
        response = error_response(HTTPStatus.BAD_REQUEST, NO_HTTP)
        headers = [*response.raw_headers, (b"connection", b"close")]
        if self.conn.our_state not in {h11.IDLE, h11.SEND_RESPONSE}:  # a response was already begun
            self.transport.close()
            return
        answer = h11.Response(status_code=response.status_code, headers=headers, reason=b"Bad Request")
        for event in (answer, h11.Data(data=bytes(response.body)), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()


class _Handshakes(ServerProtocol):
    """Refuses WebSocket handshakes in the common error shape."""

    def reject(self, status: int, text: str) -> Handshake:
        """Make the response to an invalid or failed handshake."""
        response = error_response(status, text.strip() or "no WebSocket is opened here")
        return _handshake(response)


class Viewer(WebSocketsSansIOProtocol):
    """A WebSocket without a queue of messages of its own, which signals when all written bytes have left.

    The next message sent is then the newest at that time, not one that waited.
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
        """Pause senders while any byte is unsent."""
        super().connection_made(transport)
        self.transport.set_write_buffer_limits(high=0)

    def handle_connect(self, event: Request) -> None:
        """Give the app `state.drained`, with which it waits until all bytes are sent."""
        super().handle_connect(event)
        if self.handshake_initiated and not self.handshake_complete:
            self.scope["state"]["drained"] = self.writable.wait

    async def send(self, message: Any) -> None:
        """Treat a denial response as a complete handshake; uvicorn would log an error for each one."""
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
