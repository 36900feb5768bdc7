"""Corrections from a base over TCP and NTRIP, and over real UDP to fake vehicles that put them together."""

import asyncio
import os
import socket
import time
import tty
from base64 import b64encode
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import NamedTuple

import pytest

from gcs.flight.features.corrections import Corrections
from gcs.flight.state.feature import Instant
from gcs.links.features import RtkSettings
from gcs.links.intake import Intake
from gcs.links.native.link import NativeLink
from gcs.links.rtk import CORRECTIONS, keep_receiving
from gcs.links.settings import Listen
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import ShowPhase
from gcs.service.features import CorrectionsView
from tests.support.link_bench import Ticks, running, until
from tests.support.machine import free_ports
from tests.support.processes import last_truths, vehicles
from tests.support.rtcm import BASE, base_message, rtcm

LINKS, EACH, LASTS_S = 4, 25, 10.0
SECOND = [base_message(), rtcm(1074, 420), rtcm(1084, 180), rtcm(1094, 290), rtcm(1230, 85)]
"""What a base sends in one second: 1000 bytes."""


def a_link(number: int, port: int) -> NativeLink:
    first = number * EACH
    vehicles = {f"d{system_id}": system_id for system_id in range(first + 1, first + EACH + 1)}
    place = Listen("127.0.0.1", port + first, EACH)
    return NativeLink(f"link{number}", vehicles, place, ShowFrame(47.397742, 8.545594, 488.0))


async def base(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, sent: list[bytes], second: list[bytes]
) -> None:
    """Send the messages of `second` each second, from 0 s on."""
    for _ in range(round(LASTS_S)):
        writer.write(b"".join(second))
        sent += second
        await asyncio.sleep(1.0)
    writer.close()


class Supplied(NamedTuple):
    """What left while 100 vehicles got setpoints and corrections."""

    messages: int
    setpoints_hz: float  # of one vehicle
    ticks_share: float  # of the ticks' setpoints, of the link that sent the least
    view: CorrectionsView


async def supply(port: int, base_port: int, second: list[bytes]) -> Supplied:
    """Send setpoints to 100 vehicles, and the messages of `second` each second."""
    links = [a_link(number, port) for number in range(LINKS)]
    sent: list[bytes] = []
    settings = RtkSettings(source=f"tcp://127.0.0.1:{base_port}")
    corrections = Corrections(settings, links, time.monotonic())

    async with AsyncExitStack() as stack:
        ticks = [Ticks(link, *link.ids) for link in links]
        for link in links:
            await stack.enter_async_context(running(link))
        await until(lambda: all(link._connected(time.monotonic()).all() for link in links))
        for tick in ticks:
            await stack.enter_async_context(tick.running())
        server = await asyncio.start_server(lambda r, w: base(r, w, sent, second), "127.0.0.1", base_port)
        receiving = asyncio.create_task(corrections.receive())
        before = [link.counters.setpoints_sent for link in links]
        begun = [len(tick.times_s) for tick in ticks]
        began_s = time.monotonic()
        while time.monotonic() - began_s < LASTS_S + 1.0:
            corrections.send()
            await asyncio.sleep(0.05)
        flown = [link.counters.setpoints_sent - count for link, count in zip(links, before, strict=True)]
        asked = [EACH * (len(tick.times_s) - count) for tick, count in zip(ticks, begun, strict=True)]
        lasted_s, view = (
            time.monotonic() - began_s,
            corrections.view(Instant(time.monotonic(), ShowPhase.IDLE, None)),
        )
        receiving.cancel()
        server.close()
    assert view is not None
    share = min(one / other for one, other in zip(flown, asked, strict=True))
    return Supplied(len(sent), sum(flown) / (LINKS * EACH * lasted_s), share, view)


def whole_share(truth: Path, messages: int) -> float:
    """Share of the messages that the vehicles of a truth file put together again."""
    received = [int(str(each["corrections_received"])) for each in last_truths(truth)]
    return sum(received) / (messages * LINKS * EACH)


def test_hundred_vehicles_on_four_links_get_whole_messages(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    with vehicles(LINKS * EACH, port := free_ports(LINKS * EACH), tmp_path):
        supplied = asyncio.run(supply(port, free_ports(), SECOND))
        time.sleep(0.3)  # the file is written 20 times a second
    view = supplied.view
    assert (view.messages, view.dropped, view.problem) == (supplied.messages, 0, "")
    assert (view.base_latitude_deg, view.base_longitude_deg) == pytest.approx(BASE[:2], abs=1e-7)
    assert len(last_truths(truth)) == LINKS * EACH
    assert whole_share(truth, supplied.messages) >= 0.99
    assert supplied.ticks_share >= 0.99, "every tick still sends its setpoints"


def test_ntrip_caster_is_asked_with_the_password(tmp_path: Path) -> None:
    requests: list[str] = []
    answers = [
        b"HTTP/1.1 401 Unauthorized\r\n\r\n",
        b"ICY 200 OK\r\n",
        b"HTTP/1.0 200 OK\r\nServer: x\r\n\r\n",
    ]
    (tmp_path / "password").write_text("secret\n")

    async def caster(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        requests.append((await reader.readuntil(b"\r\n\r\n")).decode())
        writer.write(answers[min(len(requests), len(answers)) - 1] + base_message())
        await writer.drain()
        writer.close()

    async def story(port: int) -> tuple[list[bytes], list[str]]:
        file = tmp_path / "password"
        source = f"ntrip://127.0.0.1:{port}/NEAR"
        settings = RtkSettings(source=source, user="anna", password_file=file)
        intake = Intake("rtk", CORRECTIONS)
        found: list[bytes] = []
        failures: list[str] = []
        server = await asyncio.start_server(caster, "127.0.0.1", port)
        async with server:
            task = asyncio.create_task(
                keep_receiving(settings, lambda each, *_: found.append(each), failures.append, intake)
            )
            await until(lambda: len(found) == 2)
            task.cancel()
        return found, failures

    found, failures = asyncio.run(story(free_ports()))
    assert found == [base_message()] * 2
    assert "401" in failures[0]
    assert requests[0].startswith("GET /NEAR HTTP/1.0\r\n")
    assert f"Basic {b64encode(b'anna:secret').decode()}" in requests[0]


def test_serial_port_and_udp_port_are_sources_too() -> None:
    async def first(source: str, send: Callable[[bytes], object]) -> bytes:
        """The first message that arrives from the source, which gets it again and again."""
        found: list[bytes] = []
        failures: list[str] = []
        settings = RtkSettings(source=source)
        intake = Intake("rtk", CORRECTIONS)
        receiving = keep_receiving(settings, lambda each, *_: found.append(each), failures.append, intake)
        task = asyncio.create_task(receiving)
        while not found:
            send(rtcm(1077, 300))
            await asyncio.sleep(0.05)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        assert not failures
        return found[0]

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    source = f"serial://{os.ttyname(theirs)}:115200"
    assert asyncio.run(first(source, lambda data: os.write(ours, data))) == rtcm(1077, 300)
    for each in (ours, theirs):
        os.close(each)
    port = free_ports()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        at = ("127.0.0.1", port)
        arrived = asyncio.run(first(f"udp://127.0.0.1:{port}", lambda data: peer.sendto(data, at)))
    assert arrived == rtcm(1077, 300)
