"""A source of bytes is opened again for ever, and says in words why nothing comes of it."""

import asyncio
import socket
import ssl
from collections.abc import AsyncGenerator, Callable

import async_solipsism
import pytest

from gcs.links.byte_sources import GARBAGE_BYTES, ByteSource, Chunks, keep_reading
from gcs.model.errors import LinkError

Pieces = AsyncGenerator[bytes, None]


def reasons(
    opened: Callable[[], Chunks], until_s: float, feed: Callable[[bytes], int] = lambda _: 1
) -> list[tuple[float, str]]:
    """When and why nothing came, up to a virtual time."""
    noted: list[tuple[float, str]] = []

    async def main() -> None:
        clock = asyncio.get_running_loop().time
        begin_s = clock()
        source = ByteSource("here", "NMEA", "target_interrupted", opened, lambda: feed)
        task = asyncio.create_task(
            keep_reading(source, lambda why: noted.append((round(clock() - begin_s, 3), why)))
        )
        await asyncio.sleep(until_s)
        assert not task.done()
        task.cancel()

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main())
    return noted


async def silent() -> Pieces:
    yield b"x"
    while True:
        await asyncio.sleep(5.0)
        yield b""


async def short() -> Pieces:
    yield b"HTTP/1.1"


async def garbage() -> Pieces:
    for _ in range(3):
        yield bytes(GARBAGE_BYTES // 2)
    await asyncio.sleep(100.0)


def test_a_port_without_a_byte_is_named_and_stays_open() -> None:
    assert reasons(silent, 21.0) == [(15.0, "nothing for 15 s"), (20.0, "nothing for 15 s")]


def test_what_ends_is_opened_again_after_two_seconds() -> None:
    ended = "the source has ended the connection"
    assert reasons(short, 5.0) == [(0.0, ended), (2.0, ended), (4.0, ended)]
    assert reasons(short, 1.0, lambda _: 0) == [(0.0, f"{ended}, and sent no NMEA: b'HTTP/1.1'")]


def test_bytes_that_make_no_sense_are_named() -> None:
    assert reasons(garbage, 1.0, lambda _: 0) == [(0.0, "more than 4096 bytes without a message of NMEA")]
    assert reasons(garbage, 1.0) == []


def refused_certificate() -> ssl.SSLError:
    error = ssl.SSLCertVerificationError("refused")
    error.verify_message = "self-signed certificate"
    return error


def refused_client() -> ssl.SSLError:
    error = ssl.SSLError(1, "alert")
    error.reason = "TLSV13_ALERT_CERTIFICATE_REQUIRED"
    return error


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ConnectionRefusedError(111, "Connect call failed"), "connection refused"),
        (TimeoutError(), "no answer for 15 s"),
        (refused_certificate(), "refused: certificate: self-signed certificate"),
        (refused_client(), "refused: tlsv13 alert certificate required"),
        (ssl.SSLError(1, "no reason"), "refused: no reason"),
        (socket.gaierror(-2, "Name or service not known"), "[Errno -2] Name or service not known"),
        (LinkError("nothing for 15 s"), "nothing for 15 s"),
        (EOFError(), "EOFError"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_an_error_is_given_in_words(error: Exception, says: str) -> None:
    async def failing() -> Pieces:
        yield b"x"
        raise error

    assert reasons(failing, 1.0) == [(0.0, says)]
