"""A host without a key at the bus: `python -m tests.support.bad_handshakes`, see `main`.

Connects from the address SOURCE, and prints how many connections it began.
"""

import errno
import os
import select
import socket
import ssl
import sys
import time
from collections import deque
from contextlib import suppress
from typing import Final

OPEN_MAX: Final = 400
"""Connections of one that holds them; the oldest is closed for a further one."""

KINDS: Final = ("junk", "hello", "idle")


def client_hello() -> bytes:
    """What a TLS client sends first."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    outgoing = ssl.MemoryBIO()
    try:
        context.wrap_bio(ssl.MemoryBIO(), outgoing).do_handshake()
    except ssl.SSLWantReadError:
        return outgoing.read()
    raise AssertionError("a handshake without a server")


class Stranger:
    """Begins connections, and sends each what its kind says."""

    def __init__(self, kind: str, source: str, address: tuple[str, int]) -> None:
        """`kind`: one of KINDS: a broken record, a whole ClientHello, nothing."""
        self.began = 0
        self._kind, self._source, self._address = kind, source, address
        self._open: deque[socket.socket] = deque()
        self._hello = client_hello()

    def begin(self) -> None:
        one = socket.socket()
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        one.bind((self._source, 0))
        one.setblocking(False)
        if one.connect_ex(self._address) not in {0, errno.EINPROGRESS}:
            one.close()
            return
        self.began += 1
        if self._kind != "idle" and select.select([], [one], [], 0.01)[1]:
            with suppress(OSError):
                one.send(self._hello if self._kind == "hello" else b"\x16\x03\x01\x40\x00" + os.urandom(4000))
        if self._kind == "junk":
            one.close()
            return
        self._open.append(one)
        if len(self._open) > OPEN_MAX:
            self._open.popleft().close()


def main(kind: str, source: str, host: str, port: str, per_s: str, seconds: str) -> None:
    stranger = Stranger(kind, source, (host, int(port)))
    begin_s = time.monotonic()
    print("begun", flush=True)  # noqa: T201 - its output
    while (since_s := time.monotonic() - begin_s) < float(seconds):
        if stranger.began < since_s * float(per_s):
            stranger.begin()
        else:
            time.sleep(0.001)
    print(stranger.began, flush=True)  # noqa: T201 - its output


if __name__ == "__main__":
    main(*sys.argv[1:])
