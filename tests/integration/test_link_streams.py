"""Streams are asked for, and asked for again; a vehicle that was away is taken up again by itself."""

import asyncio
import time
from collections.abc import Mapping

from gcs.links import Verb
from gcs.links.mavsdk.link import MavsdkLink
from gcs.links.settings import Listen
from gcs.model.frames import ShowFrame
from tests.support.link_bench import do, ready, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports

RATES_HZ = {33: 5.0, 245: 5.0, 30: 0.0}
POSITION_S = 0.2
"""As the first of these; a pause of a busy machine is short beside it."""


def a_link(port: int, rates_hz: Mapping[int, float]) -> MavsdkLink:
    frame = ShowFrame(47.4, 8.5, 500.0, 0.0)
    return MavsdkLink("bench", {"v1": 1}, Listen("127.0.0.1", port), frame, rates_hz=rates_hz)


def asked(peer: Peer) -> list[tuple[int, float]]:
    return [
        (int(message.param1), message.param2)
        for _, message in peer.messages("COMMAND_LONG")
        if message.command == 511 and message.get_srcComponent() == 191  # MAVSDK asks for one too
    ]


DESIRED = [(33, 200_000.0), (245, 200_000.0), (30, -1.0)]


def test_streams_are_set_once_when_they_arrive_as_requested() -> None:
    async def main(peer: Peer, link: MavsdkLink) -> None:
        async with running(link):
            await ready(link)
            await until(lambda: len(asked(peer)) == 3)
            assert asked(peer) == DESIRED
            await asyncio.sleep(5.0)
            assert asked(peer) == DESIRED

    with Peer(port := free_ports(), 1, position_s=POSITION_S) as peer:
        asyncio.run(main(peer, a_link(port, RATES_HZ)))


def test_only_a_stream_at_a_wrong_rate_is_requested_again() -> None:
    async def main(peer: Peer, link: MavsdkLink) -> None:
        async with running(link):
            await until(lambda: len(asked(peer)) >= 4)
            assert asked(peer)[3:] == [(33, 200_000.0)] * (len(asked(peer)) - 3)

    with Peer(port := free_ports(), 1, position_s=0.02) as peer:  # whatever it is told
        asyncio.run(main(peer, a_link(port, RATES_HZ)))


def test_streams_are_set_again_after_a_restart_commands_go_on() -> None:
    async def main(peer: Peer, link: MavsdkLink) -> None:
        async with running(link):
            await ready(link)
            peer.boot_s -= 100.0
            await asyncio.sleep(1.0)
            assert len(asked(peer)) == 3
            peer.boot_s = time.monotonic()
            await until(lambda: len(asked(peer)) == 6)
            assert asked(peer) == DESIRED * 2
            await do(link, Verb.ARM, "v1")

    with Peer(port := free_ports(), 1, position_s=POSITION_S) as peer:
        asyncio.run(main(peer, a_link(port, RATES_HZ)))


def test_silent_vehicle_received_from_another_address_returns() -> None:
    async def main(port: int, link: MavsdkLink) -> None:
        async with running(link):
            with Peer(port, 1, position_s=POSITION_S):
                await ready(link)
                await do(link, Verb.ARM, "v1")
            with Peer(port, 1, position_s=POSITION_S) as back:
                await until(lambda: link.addresses["v1"].port == back.port)
                await until(lambda: link.snapshot().armed == (False,))
                await until(lambda: asked(back) == DESIRED)
                await do(link, Verb.ARM, "v1")
                assert back.armed

    asyncio.run(main(port := free_ports(), a_link(port, RATES_HZ)))
