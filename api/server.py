"""The HTTP server, inside the caller's event loop.

It installs no signal handlers and configures no logging: the composition root does both. Cancel it to stop
it; it then closes every connection, viewers included, within `SHUTDOWN_S`.
"""

import asyncio
import logging
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http import HTTPStatus
from typing import Any, Final

import h11
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.datastructures import Headers
from websockets.http11 import Request
from websockets.http11 import Response as Handshake
from websockets.server import ServerProtocol

from gcs.api.auth.authorization import Bucket
from gcs.api.errors import error_response
from gcs.api.listener import BACKLOG, HOST, PORT, check_tls, listen
from gcs.api.middleware import AbsoluteTarget
from gcs.service.access import TlsSettings

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
        kind = str(record.msg)
        bucket = self._buckets.setdefault(kind, Bucket(LINES_PER_S, LINES_BURST))
        if not bucket.take(time.monotonic()):
            self._left_out[kind] = self._left_out.get(kind, 0) + 1
            return False
        if left_out := self._left_out.pop(kind, 0):
            record.left_out = left_out
        return True


SPARSE: Final = Sparse()


class Http(H11Protocol):
    """HTTP/1.1 with a limit of connections and errors in the common shape."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
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
        response = error_response(status, text.strip() or "no WebSocket is opened here")
        headers = Headers(
            [(name.decode("latin-1"), value.decode("latin-1")) for name, value in response.raw_headers]
        )
        headers["Connection"] = "close"
        return Handshake(response.status_code, HTTPStatus(status).phrase, headers, bytes(response.body))


class Viewer(WebSocketsSansIOProtocol):
    """A WebSocket without a queue of messages of its own, which signals when all written bytes have left.

    The next message sent is then the newest at that time, not one that waited.
    """

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **named)
        self.conn = _Handshakes(max_size=self.config.ws_max_size, logger=self.logger)

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


SHUTDOWN_S: Final = 2

SILENT_S: Final = 10.0
CROWDED_S: Final = 0.5
"""A connection without a request for `SILENT_S`, or with an unfinished one, is closed: it holds a place that
others need. With more than half of the places taken the limit is `CROWDED_S`, so that silent connections
cannot keep callers out.
"""


class _Server(uvicorn.Server):
    """Uvicorn without its signal handlers; it reports its port, and closes silent connections."""

    def __init__(self, config: uvicorn.Config, listening: asyncio.Future[int] | None) -> None:
        super().__init__(config)
        self._listening = listening
        self._silent: dict[object, tuple[object, float]] = {}  # last request, and silent since when

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        if sockets and self._listening is not None and not self._listening.done():
            self._listening.set_result(sockets[0].getsockname()[1])

    async def on_tick(self, counter: int) -> bool:
        """Close silent connections; called ten times a second."""
        now_s = asyncio.get_running_loop().time()
        connections = list(self.server_state.connections)
        patience_s = CROWDED_S if len(connections) > CONNECTIONS_MAX // 2 else SILENT_S
        before, self._silent = self._silent, {}
        for connection in connections:
            request: Any = getattr(connection, "cycle", connection)  # WebSockets have none, and may be silent
            if request is connection or not (request is None or request.response_complete):
                continue
            last_request, since_s = before.get(connection, (request, now_s))
            if last_request is not request:
                since_s = now_s
            if now_s - since_s > patience_s:
                connection.transport.abort()
            else:
                self._silent[connection] = (request, since_s)
        return await super().on_tick(counter)


async def serve(
    app: ASGIApp,
    host: str = HOST,
    port: int = PORT,
    *,
    listening: asyncio.Future[int] | None = None,
    tls: TlsSettings | None = None,
) -> None:
    """Serve HTTP and WebSockets until cancelled.

    Args:
        app: from `create_app`, or an `EmergencyLane` of it.
        host: name or address of the interface.
        port: TCP port; 0: any free port.
        listening: receives the port as soon as requests are answered.
        tls: certificate and key; then only https and wss are served. None: http and ws.

    Raises: LinkError when the address is not available, ConfigError when certificate or key cannot be used.
    """
    check_tls(tls)
    listener = await listen(host, port)
    try:
        await serve_on(listener, app, listening=listening, tls=tls)
    finally:
        listener.close()


async def serve_on(
    listener: socket.socket,
    app: ASGIApp,
    *,
    listening: asyncio.Future[int] | None = None,
    tls: TlsSettings | None = None,
) -> None:
    """As `serve`, on an open listener, which it closes; certificate and key must be valid."""
    logging.getLogger("uvicorn.error").addFilter(SPARSE)  # a second call changes nothing
    config = uvicorn.Config(
        AbsoluteTarget(app),
        log_config=None,
        access_log=False,
        lifespan="off",
        proxy_headers=False,
        server_header=False,
        http=Http,
        ws=Viewer,
        ws_max_size=4096,  # viewers send no messages
        ws_per_message_deflate=False,  # it would take much more time than encoding does
        timeout_graceful_shutdown=SHUTDOWN_S,
        backlog=BACKLOG,
        ssl_certfile=None if tls is None else tls.certificate_file,
        ssl_keyfile=None if tls is None else str(tls.key_file),
    )
    server = _Server(config, listening)
    running = asyncio.create_task(server.serve(sockets=[listener]), name="api/http")
    try:
        await asyncio.shield(running)
    finally:
        server.should_exit = True
        try:
            await running
        finally:
            for connection in list(server.server_state.connections):  # their peers may read nothing
                connection.transport.abort()
