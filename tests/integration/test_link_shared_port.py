"""One UDP port for many vehicles, and more vehicles than one MAVSDK instance bears (64)."""

import asyncio
import time
from contextlib import ExitStack

import pytest

from gcs.links import Verb
from gcs.model.state import Mode
from tests.support.link_bench import AnyLink, Ticks, a_link, do, ready, running, until
from tests.support.link_peer import Peer
from tests.support.link_router import Router
from tests.support.machine import free_ports

pytestmark = pytest.mark.usefixtures("transport")


def test_twenty_vehicles_behind_one_radio_are_flown() -> None:
    async def main(router: Router, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            assert len({address[:2] for address in link.addresses.values()}) == 1
            await do(link, Verb.ARM, *link.ids)
            ticks = Ticks(link, *link.ids)
            async with ticks.running():
                await until(lambda: all(link.setpoint_times_s(each) for each in link.ids))
                await ticks.offboard()
                assert set(link.snapshot().mode) == {Mode.OFFBOARD}
                before, began_s = router.broadcasts, time.monotonic()
                await until(lambda: router.broadcasts >= before + 2)
                most = time.monotonic() - began_s + 3  # one may have waited, and two be in one datagram
                assert router.broadcasts - before <= most, "a heartbeat a second, not one for each vehicle"
            await do(link, Verb.LAND, *link.ids)

    ids = range(1, 21)
    with ExitStack() as stack:
        port = free_ports()
        router = stack.enter_context(Router(port))
        peers = [stack.enter_context(Peer(router.port, system_id)) for system_id in ids]
        asyncio.run(main(router, a_link(port, ids)))
        for peer in peers:
            targets = {m.target_system for _, m in peer.messages("SET_POSITION_TARGET_LOCAL_NED")}
            assert targets == {peer.system_id}


def test_seventy_vehicles_fly_and_are_forwarded_to_a_station() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            await do(link, Verb.ARM, *link.ids)
            assert all(link.snapshot().armed)
            # our heartbeats are those of a control loop that lives
            async with Ticks(link, *link.ids).running():
                await until(lambda: all(link.setpoint_times_s(each) for each in link.ids))
                await until(lambda: len(peer.messages("HEARTBEAT")) >= 3)

    ids = (*range(1, 70), 245)  # 245 is MAVSDK's own, unless a vehicle has it
    with ExitStack() as stack:
        port = free_ports()
        router = stack.enter_context(Router(port))
        peers = [stack.enter_context(Peer(router.port, system_id, position_s=0.2)) for system_id in ids]
        asyncio.run(main(peers[0], a_link(port, ids)))
        for each in peers:
            targets = {m.target_system for _, m in each.messages("SET_POSITION_TARGET_LOCAL_NED")}
            assert targets == {each.system_id}
        heartbeats = peers[0].messages("HEARTBEAT")
        assert len(heartbeats) <= heartbeats[-1][0] - heartbeats[0][0] + 2, "one instance speaks for all"
        assert {message.get_srcSystem() for _, message in heartbeats} == {254}


def test_two_links_may_carry_the_same_system_ids() -> None:
    async def main(one: AnyLink, other: AnyLink) -> None:
        async with running(one), running(other):
            await ready(one)
            await ready(other)
            await do(one, Verb.ARM, "v1")
            assert (one.snapshot().armed, other.snapshot().armed) == ((True,), (False,))

    port = free_ports(2)
    with Peer(port, 1) as first, Peer(port + 1, 1) as second:
        asyncio.run(main(a_link(port, [1]), a_link(port + 1, [1])))
        assert first.armed
        assert not second.armed
