"""The gate before Zenoh: what it passes on, and what waits or is closed."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial

import pytest

from gcs.bus.gate import AT_ONCE, HELLO_MAX, WAITING, Gate, host_of, is_hello
from gcs.bus.settings import Endpoint
from tests.support.bad_handshakes import client_hello
from tests.support.machine import free_ports

SOON_S = 30.0
HELLO = client_hello()
STATION, STRANGER, OTHER = "127.0.0.5", "127.0.0.9", "127.0.0.10"


def until(what: str, holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + SOON_S
    while not holds():
        assert time.monotonic() < end_s, what
        time.sleep(0.005)


@dataclass
class Inner:
    """What stands for Zenoh: it accepts, and does nothing by itself."""

    gate: Gate
    port: int
    accepted: list[socket.socket]

    def connect(self, source: str, data: bytes = b"") -> socket.socket:
        one = socket.create_connection(("127.0.0.1", self.port), SOON_S, (source, 0))
        one.sendall(data)
        return one

    def takes(self, count: int) -> None:
        """Wait until so many were passed on, and no more are."""
        until("passed on", lambda: len(self.accepted) >= count)
        time.sleep(0.2)
        assert len(self.accepted) == count


@contextmanager
def gate() -> Iterator[Inner]:
    port = free_ports(2)
    endpoints = {
        "north": Endpoint(host=STATION, port=port),
        "west": Endpoint(host="no.such.invalid", port=port),
    }
    with ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", port + 1)))
        made = Gate(Endpoint(host="127.0.0.1", port=port), endpoints)
        stack.callback(made.close)
        inner = Inner(made, port, [])

        def accept() -> None:
            while True:
                try:
                    inner.accepted.append(listener.accept()[0])
                except OSError:
                    return

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        stack.callback(listener.shutdown, socket.SHUT_RDWR)
        made.start(("127.0.0.1", port + 1))
        yield inner
        for one in inner.accepted:
            one.close()


def is_closed(one: socket.socket) -> bool:
    one.settimeout(0.01)
    try:
        return one.recv(1) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


def test_a_hello_is_told_from_other_bytes() -> None:
    assert is_hello(HELLO)
    assert is_hello(HELLO + b"more")
    for size in range(len(HELLO)):
        assert is_hello(HELLO[:size]) is None
    others = (
        b"\x16\x03\x01\x40\x00" + bytes(4),
        b"GET / HTTP",
        b"\x17" + HELLO[1:],
        HELLO[:5] + b"\x02" + HELLO[6:],
    )
    for junk in others:
        assert is_hello(junk) is False
    large = HELLO_MAX + 1
    assert is_hello(b"\x16\x03\x01" + large.to_bytes(2) + b"\x01" + (large - 4).to_bytes(3)) is False


def test_addresses_of_one_network_are_one_host() -> None:
    assert host_of("2001:db8::1") == host_of("2001:db8::2:1") != host_of("2001:db9::1")
    assert host_of("fe80::1%eth0") == host_of("fe80::2")
    assert host_of("192.0.2.1") == "192.0.2.1"


def test_bytes_pass_both_ways_and_so_do_ends() -> None:
    with gate() as inner, inner.connect(STATION, HELLO[:50]) as one:
        one.sendall(HELLO[50:])
        inner.takes(1)
        there = inner.accepted[0]
        there.settimeout(SOON_S)
        assert there.recv(len(HELLO), socket.MSG_WAITALL) == HELLO
        content = bytes(range(256)) * 20_000
        for begin, end in ((one, there), (there, one)):
            sender = threading.Thread(target=begin.sendall, args=(content,))
            sender.start()
            received = b""
            while len(received) < len(content):
                received += end.recv(1 << 16)
            sender.join()
            assert received == content
        one.close()
        assert there.recv(1) == b""


@pytest.mark.parametrize("side", ["inner", "outer"])
def test_an_end_of_one_side_ends_the_other(side: str) -> None:
    with gate() as inner, inner.connect(STATION, HELLO) as one:
        inner.takes(1)
        there = inner.accepted[0]
        ends, other = (there, one) if side == "inner" else (one, there)
        assert not is_closed(one)
        there.recv(len(HELLO))
        ends.close()
        until("closed", lambda: is_closed(other))


def test_few_handshakes_at_a_time_are_passed_on() -> None:
    """Two of a station, and two of all other hosts; when one fails the next follows."""
    with gate() as inner, ExitStack() as stack:
        for _ in range(4):
            stack.enter_context(inner.connect(STRANGER, HELLO))
        inner.takes(AT_ONCE)
        for _ in range(4):
            stack.enter_context(inner.connect(OTHER, HELLO))
        inner.takes(AT_ONCE)
        for _ in range(4):
            stack.enter_context(inner.connect(STATION, HELLO))
        inner.takes(2 * AT_ONCE)
        inner.accepted[0].close()
        inner.takes(2 * AT_ONCE + 1)
        assert len(inner.accepted) == 2 * AT_ONCE + 1, "the next one, and no more"


def test_a_further_connection_takes_the_place_of_the_oldest() -> None:
    with gate() as inner, ExitStack() as stack:
        idle = [stack.enter_context(inner.connect(STRANGER)) for _ in range(2 * WAITING)]
        until("the oldest are closed", lambda: all(is_closed(one) for one in idle[:WAITING]))
        assert not any(is_closed(one) for one in idle[WAITING:])
        stack.enter_context(inner.connect(STRANGER, HELLO))
        inner.takes(1)


def test_junk_is_closed_at_once_and_its_sender_named() -> None:
    with gate() as inner:
        for _ in range(30):
            with inner.connect(STRANGER, b"GET / HTTP/1.1\r\n\r\n") as one:
                until("closed", partial(is_closed, one))
        assert inner.accepted == []
        named = inner.gate.failures.why_over(time.monotonic())
        assert named == f"more than 10 failed handshakes a second from {STRANGER}"


def test_a_connection_without_a_hello_is_closed() -> None:
    with gate() as inner, inner.connect(STATION, HELLO[:20]) as one:
        until("closed", lambda: is_closed(one))
        assert inner.accepted == []
