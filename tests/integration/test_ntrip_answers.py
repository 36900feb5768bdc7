"""What casters, and what stands in a caster's place, answer: messages, or the reason in words."""

import asyncio
from contextlib import suppress

import pytest

from gcs.links.features import RtkSettings
from gcs.links.intake import Intake
from gcs.links.rtk import CORRECTIONS, keep_receiving
from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.rtcm import rtcm

MESSAGES = [rtcm(1074, size) for size in (60, 170, 174, 175, 300, 500, 19)]
DATA = b"".join(MESSAGES)
CHUNKED = b"".join(
    b"%X;x=y\r\n%b\r\n" % (len(part), part) for part in (DATA[at : at + 97] for at in range(0, len(DATA), 97))
)
OK = b"HTTP/1.1 200 OK\r\n"


def answered(reply: bytes) -> tuple[list[bytes], str]:
    """The messages that such an answer brings, and why the connection ended."""
    found: list[bytes] = []
    failures: list[str] = []
    answered_all = asyncio.Event()

    async def caster(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        with suppress(ConnectionError):  # a long answer is not read to its end
            for at in range(0, min(len(reply), 8900), 89):
                writer.write(reply[at : at + 89])
                await writer.drain()
                await asyncio.sleep(0.001)
            writer.write(reply[8900:])
            writer.close()
            await writer.wait_closed()
        writer.transport.abort()
        answered_all.set()

    async def main(port: int) -> None:
        settings = RtkSettings(source=f"ntrip://127.0.0.1:{port}/NEAR")
        intake = Intake("rtk", CORRECTIONS)
        async with await asyncio.start_server(caster, "127.0.0.1", port):
            task = asyncio.create_task(
                keep_receiving(settings, lambda each, *_: found.append(each), failures.append, intake)
            )
            await until(lambda: bool(failures))
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
            await answered_all.wait()

    asyncio.run(main(free_ports()))
    return found, failures[0]


@pytest.mark.parametrize(
    "reply",
    [
        b"ICY 200 OK\r\n" + DATA,
        b"ICY 200 OK\r\n\r\n" + DATA,
        b"ICY 200 OK\r\nServer: x\r\n\r\n" + DATA,
        b"HTTP/1.0 200 OK\r\nContent-Type: gnss/data\r\n\r\n" + DATA,
        OK + b"Ntrip-Version: Ntrip/2.0\r\nContent-Type: gnss/data\r\n\r\n" + DATA,
        OK + b"Transfer-Encoding: chunked\r\nContent-Type: gnss/data\r\n\r\n" + CHUNKED,
        OK + b"Transfer-Encoding: chunked\r\n\r\n" + CHUNKED + b"0\r\n\r\n",
        b"HTTP/1.1 200\r\n\r\n" + DATA,
    ],
    ids=["icy", "icy-blank", "icy-headers", "http-1.0", "http-1.1", "chunked", "last-chunk", "no-reason"],
)
def test_messages_of_every_kind_of_answer_arrive(reply: bytes) -> None:
    found, why = answered(reply)
    assert found == MESSAGES
    assert why == "the source has ended the connection"


@pytest.mark.parametrize(
    ("reply", "says"),
    [
        (b"SOURCETABLE 200 OK\r\nServer: x\r\n\r\nENDSOURCETABLE\r\n", "no mount point /NEAR"),
        (OK + b"Content-Type: gnss/sourcetable\r\n\r\nSTR;A;;RTCM 3.2\r\n", "no mount point /NEAR"),
        (b"HTTP/1.0 401 Unauthorized\r\n\r\n", "answers 'HTTP/1.0 401 Unauthorized' for /NEAR"),
        (OK + b"Content-Type: text/html\r\n\r\n<html>login</html>", "the network needs a login"),
        (OK + b"\r\n<html>\x1b[2Jlogin</html>", r"sent no RTCM 3: b'<html>\x1b[2Jlogin</html>'"),
        (b"HTTP/1.1 302 Found\r\nLocation: http://portal/\x1b\r\n\r\n", r"sends to 'http://portal/\x1b'"),
        (b"ERROR - Bad Password\r\n", "answers 'ERROR - Bad Password'"),
        (OK + b"Transfer-Encoding: gzip\r\n\r\n", "transfer coding 'gzip'"),
        (OK + b"Transfer-Encoding: chunked\r\n\r\nwrong\r\n", "size 'wrong'"),
        (OK + b"Transfer-Encoding: chunked\r\n\r\n" + b"1" * 5000, "a line that is too long"),
        (OK + b"a: b\r\n" * 500, "no end"),
        (b"HTTP/1.1 200 OK" + b"x" * 100_000, "a line that is too long"),
        (b"HTTP/1.1", "ends after 'HTTP/1.1'"),
    ],
)
def test_an_answer_without_corrections_says_why(reply: bytes, says: str) -> None:
    found, why = answered(reply)
    assert found == []
    assert says in why
    assert why.isprintable()
