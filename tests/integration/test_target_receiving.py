"""The MAVLink source of a target on a real socket: it sends nothing, and a flood costs what it may cost."""

import asyncio
import random
import socket
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import pytest
from pymavlink.dialects.v20 import common

from tests.support.link_bench import until
from tests.support.machine import free_ports
from tests.support.target_fakes import Listening, followed, packed, position, source

SENDS = {"socket.sendto", "socket.sendmsg", "socket.connect"}
"""What the interpreter reports before a socket that is not connected can send."""

QUESTIONS = (
    common.MAVLink_heartbeat_message(2, 12, 0x81, 0, 4, 3),
    common.MAVLink_ping_message(1, 1, 0, 0),
    common.MAVLink_timesync_message(0, 12345),
    common.MAVLink_command_long_message(254, 190, 512, 0, 0, 0, 0, 0, 0, 0, 0),
    common.MAVLink_param_request_list_message(0, 0),
)

_sent: list[list[str]] = []


def _note(event: str, _: object) -> None:
    if event in SENDS:
        for noted in _sent:
            noted.append(event)


@contextmanager
def sends() -> Iterator[list[str]]:
    """What this process sends meanwhile, peers of the test included."""
    if not hasattr(_note, "hooked"):
        _note.hooked = True  # type: ignore[attr-defined] # hooks cannot be removed
        sys.addaudithook(_note)
    noted: list[str] = []
    _sent.append(noted)
    try:
        yield noted
    finally:
        _sent.remove(noted)


def peer(stack: ExitStack) -> socket.socket:
    sender = stack.enter_context(closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)))
    sender.setblocking(False)
    return sender


@pytest.mark.parametrize("track", ["", "4CA1B2"])
def test_no_datagram_is_ever_sent(track: str) -> None:
    """Not to a vehicle that reports, is silent, asks for an answer, or is another one."""
    port, listening, asked = free_ports(), None, 0
    with ExitStack() as stack, sends() as noted:
        senders = [peer(stack) for _ in range(3)]
        listening = Listening(source(port, track=track))

        async def story() -> None:
            nonlocal asked
            for step in range(40):
                for system_id, sender in enumerate(senders, start=6):
                    data = packed(*QUESTIONS, position(100 * step), followed(100 * step), system_id=system_id)
                    sender.sendto(data, ("127.0.0.1", port))
                    asked += 1
                await asyncio.sleep(0.05)
            await asyncio.sleep(3.0)  # silence, after which an autopilot would be asked for streams

        asyncio.run(listening.while_(story))
        for sender in senders:
            with pytest.raises(BlockingIOError):
                sender.recv(100)
    assert len(noted) == asked
    assert (len(listening.fixes) > 20) == (not track)
    assert listening.reasons


def test_flood_of_junk_is_bounded_and_named() -> None:
    """Of 10,000 datagrams a second what is over the bound is dropped; later the target is received again."""
    port, junk = free_ports(), random.Random(1).randbytes(200)
    listening = Listening(source(port))

    async def story() -> None:
        with ExitStack() as stack:
            sender, target = peer(stack), peer(stack)
            for _ in range(60):
                for _ in range(500):
                    sender.sendto(junk, ("127.0.0.1", port))
                await asyncio.sleep(0.05)
            why = listening.intake.why_over(asyncio.get_running_loop().time())
            assert why.startswith("more than 64 kB or 1000 messages a second from 127.0.0.1:")
            await received(listening, target, port)

    asyncio.run(listening.while_(story))
    assert listening.intake.dropped > 0
    assert f"what arrives at udp://127.0.0.1:{port} is not MAVLink, or damaged" in listening.reasons


async def received(listening: Listening, target: socket.socket, port: int) -> None:
    """A report that is sent from now on."""
    before = len(listening.fixes)

    def is_received() -> bool:
        target.sendto(packed(position()), ("127.0.0.1", port))
        return len(listening.fixes) > before

    await until(is_received)


def test_port_that_is_taken_is_named_and_opened_later() -> None:
    port = free_ports()
    listening = Listening(source(port))

    async def story() -> None:
        with ExitStack() as stack:
            peer(stack).bind(("127.0.0.1", port))
            await until(lambda: listening.reasons)
        with ExitStack() as stack:
            await received(listening, peer(stack), port)

    asyncio.run(listening.while_(story))
    assert listening.reasons[0].startswith(f"udp://127.0.0.1:{port} cannot be opened: [Errno 98] Address")
