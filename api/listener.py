"""The sockets that the HTTP server listens on. Nothing here needs the server: control opens them."""

import asyncio
import errno
import socket
import ssl
from typing import Final

from gcs.model.errors import ConfigError, LinkError
from gcs.service.access import TlsSettings

HOST: Final = "127.0.0.1"
PORT: Final = 8000
PORT_MAX: Final = 65_535

SEND_BUFFER_BYTES: Final = 64 * 1024
"""Kernel send buffer of each connection: small, because data that a slow viewer has not read yet is old."""

BACKLOG: Final = 64
"""Connections that wait to be accepted; one turn of the event loop accepts all of them."""

STALLED_MS: Final = 20_000
"""A connection is closed when the other side has acknowledged no data for this long."""


def check_tls(tls: TlsSettings | None) -> None:
    """Raises: ConfigError when certificate or key cannot be used."""
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


async def listen(host: str, port: int) -> socket.socket:
    """Open a listener; port 0: any free one. Raises: LinkError when the address is not available."""
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
        text = f"cannot listen on {host} port {port}: {error}"
        if error.errno == errno.EADDRINUSE:
            text = f"port {port} is in use on {host}: stop what listens there, or choose another port"
        raise LinkError(text) from error
    return listener
