"""Sends reports on the real clock: to a UDP address, or to those that connect, as gpsd does."""

import json
import selectors
import socket
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from typing import Protocol

from gcs.sim.targets.formats import DEVICE, Encoder, line
from gcs.sim.targets.reports import Report

LATE_S = 1.0
"""What is later than this is not sent any more: the process stood still."""

WAIT_S = 0.1
CLIENTS_MAX = 16
ASKED_MAX = 4096


class Outlet(Protocol):
    """Where reports go."""

    def send(self, data: bytes) -> None: ...
    def wait(self, for_s: float) -> None: ...
    def close(self) -> None: ...


class UdpOutlet:
    """Sends datagrams; nothing needs to listen there."""

    def __init__(self, host: str, port: int) -> None:
        """Raises: OSError when the address cannot be reached."""
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind)
        self.close = self._socket.close
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            self._socket.connect(place)
        except OSError:
            self.close()
            raise

    def send(self, data: bytes) -> None:
        with suppress(OSError):  # ICMP: nothing listens there yet
            self._socket.send(data)

    def wait(self, for_s: float) -> None:
        time.sleep(for_s)


class GpsdServer:
    """Listens as gpsd does: names itself, when asked to watch its device, and then what that reports."""

    def __init__(self, host: str, port: int) -> None:
        """Raises: OSError when the port is taken."""
        self._listener = socket.create_server((host, port))
        self._listener.setblocking(False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._asked: dict[socket.socket, bytes] = {}
        self._watching: set[socket.socket] = set()

    def close(self) -> None:
        for client in [*self._asked, self._listener]:
            client.close()
        self._selector.close()

    def send(self, data: bytes) -> None:
        for client in list(self._watching):
            self._write(client, data)

    def wait(self, for_s: float) -> None:
        for key, _ in self._selector.select(for_s):
            if key.fileobj is self._listener:
                self._accept()
            else:
                self._read(key.fileobj)  # type: ignore[arg-type] # only sockets are registered

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        client.setblocking(False)
        if len(self._asked) >= CLIENTS_MAX:
            client.close()
            return
        self._asked[client] = b""
        self._selector.register(client, selectors.EVENT_READ)
        version = {"class": "VERSION", "release": "3.25", "rev": "fake", "proto_major": 3, "proto_minor": 15}
        self._write(client, line(version))

    def _read(self, client: socket.socket) -> None:
        try:
            data = client.recv(ASKED_MAX)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        *requests, self._asked[client] = (self._asked[client] + data).replace(b"\n", b";").split(b";")
        if not data or len(self._asked[client]) > ASKED_MAX:
            self._drop(client)
            return
        for request in requests:
            self._answer(client, request.strip())

    def _answer(self, client: socket.socket, request: bytes) -> None:
        word, _, values = request.partition(b"=")
        devices = {"class": "DEVICES", "devices": [{"class": "DEVICE", "path": DEVICE, "driver": "fake"}]}
        if word == b"?WATCH":
            try:
                watches = json.loads(values or b"{}").get("enable", True)
            except (ValueError, AttributeError):
                self._write(client, line({"class": "ERROR", "message": "Invalid WATCH."}))
                return
            (self._watching.add if watches else self._watching.discard)(client)
            watch = {"class": "WATCH", "enable": bool(watches), "json": True}
            self._write(client, line(devices) + line(watch))
        elif word == b"?DEVICES":
            self._write(client, line(devices))
        elif word:
            self._write(client, line({"class": "ERROR", "message": "Unrecognized request."}))

    def _write(self, client: socket.socket, data: bytes) -> None:
        """Send all of it; a client that does not read, or has left, is dropped."""
        try:
            whole = client.send(data) == len(data)
        except OSError:
            whole = False
        if not whole:
            self._drop(client)

    def _drop(self, client: socket.socket) -> None:
        if self._asked.pop(client, None) is not None:
            self._watching.discard(client)
            self._selector.unregister(client)
            client.close()


def send(
    reports: Iterable[Report],
    encode: Encoder,
    outlet: Outlet,
    stops: Sequence[int],
    note: Callable[[float, float], None] | None = None,
) -> None:
    """Send each report when it is due, until a request to stop arrives.

    `note` is given the time, CLOCK_MONOTONIC, and that since the motion began, with each report.
    """
    begin_s = time.monotonic()
    with closing(outlet):
        for report in reports:
            while (wait_s := begin_s + report.sent_s - time.monotonic()) > 0.0 and not stops:
                outlet.wait(min(wait_s, WAIT_S))
            if stops:
                return
            if wait_s > -LATE_S:
                outlet.send(encode(report))
            if note is not None:
                note(time.monotonic(), time.monotonic() - begin_s)
