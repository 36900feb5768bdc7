"""No setpoint leaves more than 0.2 s after the last tick, whatever MAVSDK repeats."""

import asyncio
import time

import numpy as np
import pytest
from pymavlink.dialects.v20.common import MAV_TYPE_GCS

from gcs.links import Verb
from gcs.links.native.link import NativeLink
from gcs.model.state import Mode, Setpoints
from tests.support.link_bench import VELOCITY_M_S, AnyLink, Ticks, a_link, do, ready, repeated, running, until
from tests.support.link_peer import Peer
from tests.support.machine import free_ports

pytestmark = pytest.mark.usefixtures("transport")

SETPOINT_TIMEOUT_S = 0.2


def assert_ceased(link: AnyLink, peer: Peer, last_tick_s: float, watched_s: float) -> None:
    """By the vehicle's record and by the wire's: setpoints went on for a while, then no more."""
    assert time.monotonic() - last_tick_s >= watched_s
    end_s = time.monotonic() + 30.0
    while len(arrivals_s(peer)) < link.counters.setpoints_sent and time.monotonic() < end_s:
        time.sleep(0.01)  # the vehicle's thread has not come to reading
    left_s, arrived_s = link.setpoint_times_s("v1"), arrivals_s(peer)
    assert last_tick_s - 0.02 < arrived_s[-1] <= last_tick_s + SETPOINT_TIMEOUT_S
    assert left_s[-1] >= arrived_s[-1] - 0.001, "the record flatters"
    assert len(arrived_s) == len(left_s) == link.counters.setpoints_sent


def arrivals_s(peer: Peer) -> list[float]:
    return [time_s for time_s, _ in peer.messages("SET_POSITION_TARGET_LOCAL_NED")]


async def block() -> None:
    """Pause, but let no other task on the loop run."""
    time.sleep(0.005)  # noqa: ASYNC251  a blocked loop is the subject


async def into_offboard(link: AnyLink, ticks: Ticks) -> None:
    await ready(link)
    await do(link, Verb.ARM, "v1")
    async with ticks.running():
        await until(lambda: link.setpoint_times_s("v1"))
        await ticks.offboard()
        await asyncio.sleep(0.3)
    assert link.snapshot().mode == (Mode.OFFBOARD,)


def test_setpoints_stop_when_the_loop_blocks_for_three_seconds() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            ticks = Ticks(link, "v1")
            await into_offboard(link, ticks)
            await ticks.last(block)
            dropped = link.counters.setpoints_dropped
            while time.monotonic() < ticks.last_s + 3.0:
                await block()
            assert_ceased(link, peer, ticks.last_s, watched_s=3.0)
            await repeated(link, 40, since=dropped)  # what MAVSDK has written meanwhile is not passed on late
            assert_ceased(link, peer, ticks.last_s, watched_s=3.0)
            stalled_s = ticks.last_s
            async with ticks.running():
                await until(lambda: link.setpoint_times_s("v1")[-1] > stalled_s + SETPOINT_TIMEOUT_S)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_setpoints_stop_when_the_tick_task_has_ended() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            ticks = Ticks(link, "v1")
            await into_offboard(link, ticks)
            await ticks.last()
            dropped = link.counters.setpoints_dropped
            await repeated(link, 10, since=dropped)
            await until(lambda: time.monotonic() >= ticks.last_s + 1.0)
            assert_ceased(link, peer, ticks.last_s, watched_s=1.0)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_setpoints_stop_when_a_computation_keeps_the_gil() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            ticks = Ticks(link, "v1")
            await into_offboard(link, ticks)
            await ticks.last(block)
            while time.monotonic() < ticks.last_s + 0.6:
                sum(range(1000))
            assert_ceased(link, peer, ticks.last_s, watched_s=0.6)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_unlisted_vehicle_gets_nothing_from_that_call_on() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            ticks = Ticks(link, "v1")
            await into_offboard(link, ticks)
            await ticks.last()
            ticks.listed = ()
            dropped = link.counters.setpoints_dropped
            ticks.tick()
            reported_s = time.monotonic()
            await repeated(link, 3, since=dropped)
            assert arrivals_s(peer)[-1] <= reported_s + 0.02  # one may have been on its way
            await do(link, Verb.HOLD, "v1")
            assert link.snapshot().mode == (Mode.HOLD,)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_stale_batch_is_not_sent() -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            old_s = time.monotonic() - 0.25
            link.send(Setpoints(old_s, ("v1",), np.zeros((1, 3)), np.zeros(1)))
            await until(lambda: link.counters.setpoints_dropped >= (1 if isinstance(link, NativeLink) else 3))
            assert link.setpoint_times_s("v1") == ()

    with Peer(port := free_ports(), 1):
        asyncio.run(main(a_link(port, [1])))


@pytest.mark.parametrize(("heading_deg", "north", "east", "yaw_deg"), [(0, 1.0, 0.5, 0), (90, -0.5, 1.0, 90)])
def test_setpoints_are_turned_from_the_show_frame(
    heading_deg: float, north: float, east: float, yaw_deg: float
) -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            async with Ticks(link, "v1").running():
                await until(lambda: peer.messages("SET_POSITION_TARGET_LOCAL_NED"))
            (_, message), *_ = peer.messages("SET_POSITION_TARGET_LOCAL_NED")
            assert (message.vx, message.vy, message.vz) == pytest.approx((north, east, VELOCITY_M_S[2]))
            assert message.yaw * 57.29578 == pytest.approx(yaw_deg, abs=1e-3)
            assert message.type_mask == 0x9C7

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1], heading_deg=heading_deg)))


def test_heartbeat_stops_and_resumes_with_control() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            ticks = Ticks(link, "v1")
            async with ticks.running():
                await until(lambda: len(peer.messages("HEARTBEAT")) >= 2)
            dead_s = ticks.last_s
            await asyncio.sleep(3.0)
            (*_, (last_s, beat)) = peer.messages("HEARTBEAT")
            assert last_s < dead_s + 1.02
            assert beat.type == MAV_TYPE_GCS
            async with ticks.running():
                await until(lambda: peer.messages("HEARTBEAT")[-1][0] > dead_s + 2.0)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1], heartbeat_hold_s=1.0)))


def test_heartbeat_stops_when_the_event_loop_is_blocked() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            ticks = Ticks(link, "v1")
            async with ticks.running():
                await until(lambda: len(peer.messages("HEARTBEAT")) >= 2)
            end_s = ticks.last_s + 3.5
            while time.monotonic() < end_s:
                await block()
            assert peer.messages("HEARTBEAT")[-1][0] < ticks.last_s + 1.02

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1], heartbeat_hold_s=1.0)))
