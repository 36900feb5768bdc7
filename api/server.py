"""The HTTP server, inside the caller's event loop.

It installs no signal handlers and configures no logging: the composition root does both. Cancel it to stop
it; it then closes every connection, viewers included, within `SHUTDOWN_S`.
"""

import asyncio
import errno
import socket
import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import uvicorn
from starlette.types import ASGIApp

from gcs.api.absolute_target import AbsoluteTarget
from gcs.api.protocols import CONNECTIONS_MAX, Http, Viewer, bound_log
from gcs.model.errors import ConfigError, LinkError
from gcs.service.access import TlsSettings

HOST: Final = "127.0.0.1"
PORT: Final = 8000
PORT_MAX: Final = 65_535

SHUTDOWN_S: Final = 2

SEND_BUFFER_BYTES: Final = 64 * 1024
"""Kernel send buffer of each connection: small, because data that a slow viewer has not read yet is old."""

SILENT_S: Final = 10.0
CROWDED_S: Final = 0.5
"""A connection without a request for `SILENT_S`, or with an unfinished one, is closed: it holds a place that
others need. With more than half of the places taken the limit is `CROWDED_S`, so that silent connections
cannot keep callers out.
"""

BACKLOG: Final = 64
"""Connections that wait to be accepted; one turn of the event loop accepts all of them."""

STALLED_MS: Final = 20_000
"""A connection whose peer acknowledges no data for this long is closed."""


class _Server(uvicorn.Server):
    """Uvicorn without its signal handlers; it reports its port, and closes silent connections."""

    def __init__(self, config: uvicorn.Config, listening: asyncio.Future[int] | None) -> None:
        super().__init__(config)
        self._listening = listening
        self._silent: dict[object, tuple[object, float]] = {}  # last request, and silent since when

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Install no signal handlers; the composition root handles signals."""
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, then set `listening` to the port."""
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
            asked, since_s = before.get(connection, (request, now_s))
            if asked is not request:
                since_s = now_s
            if now_s - since_s > patience_s:
                connection.transport.abort()
            else:
                self._silent[connection] = (request, since_s)
        return await super().on_tick(counter)

    def cut(self) -> None:
        """Abort the connections that did not close in time because their peers read nothing."""
        for connection in list(self.server_state.connections):
            connection.transport.abort()


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
    _check_tls(tls)
    listener = await _listen(host, port)
    bound_log()
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
        ws_per_message_deflate=False,  # compression would take time from the control loop
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
            server.cut()
            listener.close()


def _check_tls(tls: TlsSettings | None) -> None:
    if tls is None:
        return
    for path in (tls.certificate_file, tls.key_file):
        if not path.is_file():
            raise ConfigError(f"access.tls: {path}: there is no such file")
    try:
        ssl.create_default_context(ssl.Purpose.CLIENT_AUTH).load_cert_chain(
            tls.certificate_file, tls.key_file
        )
    except OSError as error:  # includes SSLError
        files = f"{tls.certificate_file}, {tls.key_file}"
        raise ConfigError(f"access.tls: {files}: no PEM certificate and its key: {error}") from None


async def _listen(host: str, port: int) -> socket.socket:
    if not 0 <= port <= PORT_MAX:  # the resolver would silently reduce it modulo 65536
        raise LinkError(f"cannot listen on {host} port {port}: a port is from 0 to {PORT_MAX}")
    try:
        found = await asyncio.get_running_loop().getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
    except socket.gaierror as error:
        raise LinkError(f"cannot listen on {host} port {port}: {error}") from error
    family, kind, protocol, _, address = found[0]
    listener = socket.socket(family, kind, protocol)
    try:
        # Accepted connections inherit these from the listener.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
            listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, STALLED_MS)
        listener.bind(address)
        listener.listen(BACKLOG)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise LinkError(_cause(host, port, error)) from error
    return listener


def _cause(host: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} is in use on {host}: stop what listens there, or choose another port"
    return f"cannot listen on {host} port {port}: {error}"
