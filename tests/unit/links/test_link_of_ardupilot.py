"""A link and an ArduCopter that a test writes: what must not leave, and what must."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

import async_solipsism
import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.links.autopilots import AUTOPILOTS
from gcs.links.link import Command, Verb
from gcs.links.native.link import NativeLink
from gcs.model.errors import CommandError
from gcs.model.frames import ShowFrame
from gcs.model.state import Setpoints
from tests.support.memory_ports import MemoryPorts

TICK_S = 0.05
VELOCITY_M_S = (1.0, 2.0, -0.5)
ON_GROUND, IN_AIR, TAKEOFF = 1, 2, 3


class Bench:
    """A native link to d1, configured as one autopilot, which reports itself each second."""

    def __init__(self, autopilot: str = "ardupilot") -> None:
        clock = asyncio.get_running_loop().time
        self.ports = MemoryPorts(clock)
        frame = ShowFrame(47.0, 8.0, 400.0)
        profile = AUTOPILOTS[autopilot]
        self.link = NativeLink(
            "one", {"d1": 1}, (), frame, autopilots=(profile,), clock=clock, ports=self.ports
        )
        self.landed, self.mode, self.armed, self.number = IN_AIR, 4, True, 3
        self._running = asyncio.create_task(self.link.run())

    def beat(self) -> None:
        base = 0x59 | 0x80 * self.armed
        self.ports.say(
            dialect.MAVLink_heartbeat_message(2, self.number, base, self.mode, 4, 3),
            dialect.MAVLink_extended_sys_state_message(0, self.landed),
            dialect.MAVLink_global_position_int_message(0, 470000000, 80000000, 410000, 10000, 0, 0, 0, 0),
        )

    async def tick(self, count: int = 1, velocity_m_s: tuple[float, float, float] = VELOCITY_M_S) -> None:
        for _ in range(count):
            self.beat()
            self.link.snapshot()
            now_s = asyncio.get_running_loop().time()
            self.link.send(Setpoints(now_s, ("d1",), np.array([velocity_m_s]), np.zeros(1)))
            await asyncio.sleep(TICK_S)

    @property
    def setpoints(self) -> list[Any]:
        return self.ports.of_kind("SET_POSITION_TARGET_LOCAL_NED")

    async def close(self) -> None:
        self._running.cancel()
        with suppress(asyncio.CancelledError):
            await self._running


def run(story: Callable[[Bench], Coroutine[Any, Any, None]], autopilot: str = "ardupilot") -> None:
    async def main() -> None:
        bench = Bench(autopilot)
        await asyncio.sleep(0.1)
        await story(bench)
        await bench.close()

    with asyncio.Runner(loop_factory=async_solipsism.EventLoop) as runner:
        runner.run(main())


def test_no_setpoint_leaves_while_it_takes_off() -> None:
    """One ends its climb, acknowledged and without a word."""

    async def story(bench: Bench) -> None:
        bench.landed = TAKEOFF
        await bench.tick(10)
        assert bench.setpoints == []
        bench.landed = IN_AIR
        await bench.tick(10)
        assert len(bench.setpoints) == 10

    run(story)


def test_px4_gets_setpoints_while_it_takes_off() -> None:
    async def story(bench: Bench) -> None:
        bench.number, bench.landed = 12, TAKEOFF
        await bench.tick(10)
        assert len(bench.setpoints) == 10

    run(story, "px4")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_setpoint_that_is_no_number_never_leaves(bad: float) -> None:
    """It ends the process of ArduCopter 4.1 in flight."""

    async def story(bench: Bench) -> None:
        await bench.tick(3)
        before = len(bench.setpoints)
        await bench.tick(3, (0.0, bad, 0.0))
        assert len(bench.setpoints) == before

    run(story)


def test_velocity_and_yaw_are_the_only_fields_of_a_setpoint() -> None:
    async def story(bench: Bench) -> None:
        await bench.tick(3)
        last = bench.setpoints[-1]
        assert (last.type_mask, last.coordinate_frame) == (0x9C7, dialect.MAV_FRAME_LOCAL_NED)
        assert (last.vx, last.vy, last.vz) == VELOCITY_M_S

    run(story)


def test_setpoints_end_with_one_at_rest_when_ticks_end() -> None:
    """Without it the vehicle flies on for 3 s."""

    async def story(bench: Bench) -> None:
        await bench.tick(5)
        sent = len(bench.setpoints)
        await asyncio.sleep(3.0)
        (last,) = bench.setpoints[sent:]
        assert (last.vx, last.vy, last.vz, last.type_mask) == (0.0, 0.0, 0.0, 0xDC7)
        await bench.tick(5)
        assert bench.setpoints[-1].vx == VELOCITY_M_S[0], "the next tick flies on"

    run(story)


@pytest.mark.parametrize(("autopilot", "number", "at_rest"), [("ardupilot", 3, 1), ("px4", 12, 0)])
def test_closing_link_stops_only_who_would_fly_on(autopilot: str, number: int, at_rest: int) -> None:
    async def story(bench: Bench) -> None:
        bench.number = number
        await bench.tick(5)
        sent = len(bench.setpoints)
        await bench.close()
        assert [each.vx for each in bench.setpoints[sent:]] == [0.0] * at_rest

    run(story, autopilot)


def test_killed_vehicle_gets_no_setpoint_at_rest() -> None:
    async def story(bench: Bench) -> None:
        await bench.tick(5)
        killing = asyncio.create_task(bench.link.execute(Command("d1", Verb.KILL)))
        await asyncio.sleep(0.01)
        bench.armed = False
        bench.beat()
        await asyncio.sleep(0.3)
        await killing
        sent = len(bench.setpoints)
        await bench.close()
        assert bench.setpoints[sent:] == []

    run(story)


def test_other_autopilot_than_configured_is_only_killed() -> None:
    async def story(bench: Bench) -> None:
        await bench.tick(3)
        assert bench.setpoints == []
        assert bench.link.foreign == {"d1": "it reports ArduPilot, and is configured as PX4 (autopilot: px4)"}
        with pytest.raises(CommandError, match="d1: arm impossible: it reports ArduPilot"):
            await bench.link.execute(Command("d1", Verb.ARM))
        with pytest.raises(CommandError, match="FENCE_ACTION cannot be set: it reports ArduPilot"):
            await bench.link.set_parameter("d1", "FENCE_ACTION", 4)
        assert bench.ports.of_kind("PARAM_SET") == []
        killing = asyncio.create_task(bench.link.execute(Command("d1", Verb.KILL)))
        await asyncio.sleep(0.01)
        assert bench.ports.of_kind("COMMAND_LONG")[-1].param2 == 21196.0
        bench.armed = False
        bench.beat()
        await killing

    run(story, "px4")


def test_parameter_that_it_may_lack_is_left_out() -> None:
    async def story(bench: Bench) -> None:
        await bench.tick(3)

        async def answer() -> None:
            answered = 0
            while True:
                requests = bench.ports.of_kind("PARAM_REQUEST_READ")
                for request in requests[answered:]:
                    if request.param_id == "WPNAV_ACCEL":
                        value = dialect.MAVLink_param_value_message(b"WPNAV_ACCEL", 250.0, 9, 900, 65535)
                        bench.ports.say(value)
                answered = len(requests)
                await asyncio.sleep(0.02)

        answering = asyncio.create_task(answer())
        names = ("GUID_TIMEOUT", "WPNAV_ACCEL")
        assert await bench.link.read_parameters("d1", names, ("GUID_TIMEOUT",)) == {"WPNAV_ACCEL": 250.0}
        with pytest.raises(CommandError, match="parameter GUID_TIMEOUT: no answer"):
            await bench.link.read_parameters("d1", names)
        answering.cancel()

    run(story)
