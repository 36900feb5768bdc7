import asyncio
import time
from itertools import pairwise

import numpy as np
import pytest

from gcs.links import Command, Verb
from gcs.links.batch_link import Link
from gcs.model.errors import CommandError, LinkError, UnknownError
from gcs.model.state import Landed, Mode, Setpoints
from tests.support.link_bench import PERIOD_S, AnyLink, Ticks, a_link, do, ready, repeated, running, until
from tests.support.link_peer import Peer
from tests.support.machine import STALL_S, Pauses, free_ports

pytestmark = pytest.mark.usefixtures("transport")


def test_a_vehicle_is_armed_flown_and_brought_down() -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            await do(link, Verb.ARM, "v1")
            assert link.snapshot().armed == (True,)
            await do(link, Verb.TAKEOFF, "v1", height_m=4.0)
            ticks = Ticks(link, "v1")
            async with ticks.running():
                await until(lambda: link.setpoint_times_s("v1"))
                await ticks.offboard()
                assert link.snapshot().mode == (Mode.OFFBOARD,)
                for verb, mode in (
                    (Verb.HOLD, Mode.HOLD),
                    (Verb.RETURN, Mode.RETURN),
                    (Verb.LAND, Mode.LAND),
                ):
                    await do(link, verb, "v1")
                    assert link.snapshot().mode == (mode,)
            await do(link, Verb.DISARM, "v1")
            assert link.snapshot().armed == (False,)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(a_link(port, [1])))
        (_, height), *_ = peer.messages("PARAM_SET")
        assert (height.param_id, height.param_value) == ("MIS_TAKEOFF_ALT", 4.0)


def age_s(link: Link, of: str) -> float:
    time_s: np.ndarray[tuple[int], np.dtype[np.float64]] = getattr(link.snapshot(), of)
    return time.monotonic() - float(time_s[0])


def test_snapshot_holds_the_reports_and_their_times() -> None:
    async def main(peer: Peer, link: Link, is_ready: AnyLink) -> None:
        before = link.snapshot()
        assert np.isneginf(before.position_time_s).all()
        assert np.isnan(before.latitude_deg).all()
        assert before.mode == (Mode.UNKNOWN,)
        async with running(is_ready):
            await ready(is_ready)
            await until(lambda: link.snapshot().landed[0] and np.isfinite(link.snapshot().position_time_s[0]))
            await until(lambda: age_s(link, "position_time_s") < 0.1)
            await until(lambda: age_s(link, "heartbeat_time_s") < 1.1)
            newest = link.snapshot()
            assert newest.position_time_s[0] <= time.monotonic()
            assert newest.heartbeat_time_s[0] <= time.monotonic()
            assert is_ready.addresses["v1"][:2] == ("127.0.0.1", peer.port)
            assert newest.latitude_deg == pytest.approx([47.4])
            assert newest.longitude_deg == pytest.approx([8.5])
            assert newest.altitude_amsl_m == pytest.approx([500.0])
            assert newest.velocity_ned_m_s == pytest.approx(np.array([[1.5, -0.2, 0.3]]))
            assert newest.yaw_deg == pytest.approx([90.0])
            assert newest.battery_remaining == pytest.approx([0.8])
            assert (newest.landed, newest.armed, newest.mode) == ((Landed.ON_GROUND,), (False,), (Mode.HOLD,))
        assert link.snapshot().ready == (False,)

    with Peer(port := free_ports(), 1) as peer:
        link = a_link(port, [1])
        asyncio.run(main(peer, link, link))


def test_refusal_carries_the_vehicles_own_text() -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            with pytest.raises(CommandError, match=r"v1: arm failed \(COMMAND_DENIED\).*the test says so"):
                await do(link, Verb.ARM, "v1")

    with Peer(port := free_ports(), 1, refuses=True):
        asyncio.run(main(a_link(port, [1])))


def test_invalid_commands_are_refused_before_sending() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        with pytest.raises(CommandError, match="not open"):
            await do(link, Verb.ARM, "v1")
        with pytest.raises(UnknownError, match="v9"):
            await do(link, Verb.ARM, "v9")
        async with running(link):
            await until(lambda: link.snapshot().ready[0])
            with pytest.raises(CommandError, match="never received"):
                await do(link, Verb.ARM, "v2")
            with pytest.raises(CommandError, match="arm it first"):
                await do(link, Verb.TAKEOFF, "v1", height_m=3.0)
            with pytest.raises(CommandError, match="height above 0"):
                await do(link, Verb.TAKEOFF, "v1", height_m=float("nan"))
            with pytest.raises(CommandError, match="no setpoints are flowing"):
                await do(link, Verb.OFFBOARD, "v1")
        commands = {message.command for _, message in peer.messages("COMMAND_LONG")}
        assert commands <= {511, 512, 520}  # MAVSDK's own questions

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1, 2])))


def test_kill_overtakes_and_outlives_a_waiting_command() -> None:
    async def main(peer: Peer, link: AnyLink, machine: Pauses) -> None:
        async with running(link):
            await ready(link)
            peer.answers = False
            arming = asyncio.create_task(link.execute(Command("v1", Verb.ARM)))
            queued = asyncio.create_task(link.execute(Command("v1", Verb.ARM)))
            await until(lambda: [m for _, m in peer.messages("COMMAND_LONG") if m.command == 400])
            peer.armed = peer.answers = True
            peer.acknowledges = False
            killed_s = time.monotonic()
            await do(link, Verb.KILL, "v1")
            assert machine.awake_s(killed_s, time.monotonic()) < 0.4  # an order waits 0.5 s for its answer
            for task in (arming, queued):
                with pytest.raises(CommandError):
                    await task
            after = [m for at_s, m in peer.messages("COMMAND_LONG") if m.command == 400 and at_s > killed_s]
            assert {(m.param1, m.param2) for m in after} == {(0.0, 21196.0)}
            assert not peer.armed
            assert link.counters.commands_dropped > 0
            peer.acknowledges = True
            await do(link, Verb.ARM, "v1")

    with Peer(port := free_ports(), 1) as peer, Pauses() as machine:
        asyncio.run(main(peer, a_link(port, [1]), machine))


def test_silent_vehicle_delays_no_other() -> None:
    async def main(silent: Peer, link: AnyLink, machine: Pauses) -> None:
        async with running(link):
            await ready(link)
            ticks = Ticks(link, "v1", "v2")
            async with ticks.running():
                await until(lambda: link.setpoint_times_s("v1") and link.setpoint_times_s("v2"))
                silent.speaks = silent.answers = False
                silent_s = time.monotonic()
                lost = asyncio.create_task(link.execute(Command("v1", Verb.ARM)))
                await asyncio.sleep(0.05)
                for verb in (Verb.ARM, Verb.OFFBOARD, Verb.HOLD, Verb.DISARM):
                    await until(lambda: time.monotonic() - ticks.last_s < PERIOD_S)
                    began_s = time.monotonic()
                    await do(link, verb, "v2")
                    # v1's order waits 0.5 s for its answer, three times
                    assert machine.awake_s(began_s, time.monotonic()) < 0.45
                with pytest.raises(CommandError, match=r"arm failed \(TIMEOUT\)"):
                    await lost
                await until(lambda: time.monotonic() - link.snapshot().life_time_s[0] > 3.1)
                # silent for 3 s: not commanded, while the other one is
                await until(
                    lambda: link.setpoint_times_s("v2")[-1] > link.setpoint_times_s("v1")[-1] + 5 * PERIOD_S
                )
                ended_s = link.setpoint_times_s("v2")[-1]
                assert machine.awake_s(silent_s, link.setpoint_times_s("v1")[-1]) < 3.0 + 1.0
                # MAVSDK waits 0.5 s and more for an answer: no other link does
                ticks_s = [time_s for time_s in ticks.times_s if silent_s < time_s < ended_s]
                times_s = [time_s for time_s in link.setpoint_times_s("v2") if time_s > silent_s]
                assert len(times_s) > 0.9 * len(ticks_s)
                late_s = max(machine.awake_s(*gap) for gap in pairwise(ticks_s))
                assert max(machine.awake_s(*gap) for gap in pairwise(times_s)) < late_s + PERIOD_S + STALL_S

    port = free_ports(2)
    with Peer(port, 1) as silent, Peer(port + 1, 2), Pauses() as machine:
        asyncio.run(main(silent, a_link(port, [1, 2], port_count=2), machine))


def test_setpoint_that_is_not_finite_is_not_sent_nor_the_last() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            ticks = Ticks(link, "v1")
            async with ticks.running():
                await until(lambda: peer.messages("SET_POSITION_TARGET_LOCAL_NED"))
            dropped = link.counters.setpoints_dropped
            link.send(Setpoints(time.monotonic(), ("v1",), np.array([[1.0, np.nan, 0.0]]), np.zeros(1)))
            sent_s = time.monotonic()
            await repeated(link, 3, since=dropped)
            arrived_s, message = peer.messages("SET_POSITION_TARGET_LOCAL_NED")[-1]
            assert arrived_s <= sent_s + 0.02  # one may have been on its way
            assert np.isfinite(message.vy)

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_link_can_be_closed_during_a_command_and_opened_again() -> None:
    async def main(peer: Peer, link: AnyLink) -> None:
        async with running(link):
            await ready(link)
            peer.answers = False
            command = asyncio.create_task(link.execute(Command("v1", Verb.ARM)))
            await asyncio.sleep(0.05)
        with pytest.raises(CommandError):
            await command
        peer.answers = True
        async with running(link):
            await ready(link)
            await do(link, Verb.ARM, "v1")

    with Peer(port := free_ports(), 1) as peer:
        asyncio.run(main(peer, a_link(port, [1])))


def test_link_names_the_port_it_cannot_have() -> None:
    async def main(link: AnyLink, same: AnyLink, port: int) -> None:
        async with running(link):
            await asyncio.sleep(0)
            with pytest.raises(LinkError, match=str(port)):
                await same.run()

    port = free_ports()
    asyncio.run(main(a_link(port, [1]), a_link(port, [1]), port))
