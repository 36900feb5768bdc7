"""The whole way through the link, with the fake autopilot as its own process on the other side."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from gcs.links import Verb
from gcs.model.state import Landed, Mode
from tests.support.link_bench import AnyLink, Ticks, a_link, do, running, until
from tests.support.machine import free_ports
from tests.support.started import DEVNULL, Started


@contextmanager
def simulator(first_port: int, count: int, *parameters: str) -> Iterator[None]:
    options = ["--count", str(count), "--port-base", str(first_port), "--noise", "0"]
    options += ["--quirk", "late-ready=off"]
    options += ["--param", "COM_OF_LOSS_T=3"]  # they notice the tick's end, not a pause of the machine
    options += [word for each in parameters for word in ("--param", each)]
    process = Started("gcs.sim", *options, stdout=DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait(60)


@pytest.mark.keeps("native")
@pytest.mark.usefixtures("transport")
def test_two_vehicles_fly_and_fail_safe_when_the_tick_ends() -> None:
    async def main(link: AnyLink) -> None:
        async with running(link):
            await until(lambda: all(link.snapshot().ready))
            ground_m = link.snapshot().altitude_amsl_m
            await do(link, Verb.ARM, *link.ids)
            await do(link, Verb.TAKEOFF, *link.ids, height_m=3.0)
            await until(lambda: np.all(link.snapshot().altitude_amsl_m > ground_m + 2))
            assert set(link.snapshot().landed) <= {Landed.TAKEOFF, Landed.IN_AIR}
            ticks = Ticks(link, *link.ids)
            async with ticks.running():
                await until(lambda: all(link.setpoint_times_s(name) for name in link.ids))
                await ticks.offboard()
                await until(lambda: np.all(link.snapshot().velocity_ned_m_s[:, 0] > 0.5))
                assert (np.abs(link.snapshot().yaw_deg) < 10).all()
            await until(lambda: set(link.snapshot().mode) == {Mode.POSITION})
            await do(link, Verb.HOLD, *link.ids)
            await do(link, Verb.LAND, *link.ids)
            assert set(link.snapshot().mode) == {Mode.LAND}

    port = free_ports(2)
    with simulator(port, 2):
        asyncio.run(main(a_link(port, [1, 2], port_count=2)))


@pytest.mark.soak
def test_data_link_failsafe_acts_only_when_control_is_dead() -> None:
    """A vehicle that holds gets no setpoints: only our heartbeats tell it that somebody is there.

    Over MAVSDK's transport; that both end their heartbeats alike is shown in test_link_stall.py.
    """

    async def main(link: AnyLink) -> None:
        async with running(link):
            ticks = Ticks(link)
            async with ticks.running():
                await until(lambda: all(link.snapshot().ready))
                await do(link, Verb.ARM, "v1")
                await do(link, Verb.TAKEOFF, "v1", height_m=3.0)
                await until(lambda: link.snapshot().mode == (Mode.HOLD,))
                await asyncio.sleep(6.5)
                assert link.snapshot().mode == (Mode.HOLD,), "control lives, and says so"
            await until(lambda: link.snapshot().mode == (Mode.LAND,))

    port = free_ports()
    with simulator(port, 1, "NAV_DLL_ACT=3", "COM_DL_LOSS_T=5"):
        asyncio.run(main(a_link(port, [1], heartbeat_hold_s=1.0)))
