"""A running link over either transport, and a control loop for it.

The machine may pause for a second or two at any time. The tests therefore wait for a precondition and act
without a pause after it. They measure time by the kernel's arrival times, or subtract the machine's pauses.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from gcs.links import Command, Verb
from gcs.links.mavsdk.link import MavsdkLink
from gcs.links.native.link import NativeLink
from gcs.links.settings import Forward, Listen, Place
from gcs.links.signing import Signing
from gcs.model.frames import ShowFrame
from gcs.model.state import Setpoints

PERIOD_S = 0.05
VELOCITY_M_S = (1.0, 0.5, -0.25)

AGE_S = 1000.0
"""After so long the dates of `DatedTicks` begin again."""

AnyLink = MavsdkLink | NativeLink

KINDS: dict[str, type[MavsdkLink] | type[NativeLink]] = {"mavsdk": MavsdkLink, "native": NativeLink}

chosen = "mavsdk"
"""What `a_link` makes; the fixture `transport` sets it for tests that hold for both."""


def a_link(
    first_port: int,
    system_ids: Sequence[int],
    *,
    port_count: int = 1,
    heading_deg: float = 0.0,
    heartbeat_hold_s: float = 3.0,
    record: Path | None = None,
    places: Sequence[Place] | None = None,
    signing: Signing | None = None,
    forward: Sequence[Forward] = (),
) -> AnyLink:
    """Vehicle "v3" has system id 3. `places` take the place of UDP ports from `first_port` on."""
    return KINDS[chosen](
        "bench",
        {f"v{system_id}": system_id for system_id in system_ids},
        Listen("127.0.0.1", first_port, port_count) if places is None else places,
        ShowFrame(47.4, 8.5, 500.0, heading_deg),
        heartbeat_hold_s=heartbeat_hold_s,
        record=record,
        signing=signing,
        forward=forward,
    )


@asynccontextmanager
async def running(link: AnyLink) -> AsyncIterator[None]:
    """Run the link until the block ends."""
    task = asyncio.create_task(link.run(), name="link")
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def until(true: Callable[[], object], timeout_s: float = 120.0) -> None:
    """Wait for a condition. It still holds when this returns: no other task ran in between."""
    async with asyncio.timeout(timeout_s):
        while not true():  # noqa: ASYNC110  what is awaited happens in other threads and processes
            await asyncio.sleep(0.01)


async def repeated(link: AnyLink, times: int, *, since: int) -> None:
    """Wait until MAVSDK has tried in vain to repeat its setpoint; the native transport repeats nothing."""
    if not isinstance(link, NativeLink):
        await until(lambda: link.counters.setpoints_dropped >= since + times)
    else:
        await asyncio.sleep(times * PERIOD_S)
        assert link.counters.setpoints_dropped == since


def is_open(link: AnyLink) -> bool:
    """Whether the link accepts commands."""
    return link._protocol is not None


async def ready(link: AnyLink) -> None:
    """Wait until every vehicle reports that it can be armed."""
    await until(lambda: all(link.snapshot().ready))


async def do(link: AnyLink, verb: Verb, *vehicle_ids: str, height_m: float = 0.0) -> None:
    """Send one command to several vehicles at the same time."""
    await asyncio.gather(*(link.execute(Command(vehicle_id, verb, height_m)) for vehicle_id in vehicle_ids))


class Ticks:
    """A control loop that sends the same velocity in every tick.

    Attributes:
        listed: the vehicles it commands.
        last_s: time of its last tick.
        times_s: of all its ticks.
    """

    def __init__(self, link: AnyLink, *listed: str) -> None:
        self.link = link
        self.listed: tuple[str, ...] = listed
        self.last_s = 0.0
        self.times_s: list[float] = []

    def tick(self) -> None:
        """Send one batch."""
        self.last_s = time.monotonic()
        self.times_s.append(self.last_s)
        velocity_m_s = np.tile(np.array(self.velocity_m_s()), (len(self.listed), 1))
        self.link.send(Setpoints(self.last_s, self.listed, velocity_m_s, np.zeros(len(self.listed))))

    def velocity_m_s(self) -> tuple[float, float, float]:
        """The velocity of this tick."""
        return VELOCITY_M_S

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Tick at 20 Hz until the block ends."""
        task = asyncio.create_task(self._run(), name="ticks")
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def offboard(self) -> None:
        """Enter OFFBOARD while it ticks, but not just after a pause of the machine: it would be refused."""
        await until(lambda: time.monotonic() - self.last_s < PERIOD_S)
        await do(self.link, Verb.OFFBOARD, *self.listed)

    async def last(self, pause: Callable[[], Awaitable[object]] = lambda: asyncio.sleep(0.01)) -> None:
        """Send one more batch and see its setpoint leave; repeat it if the machine paused meanwhile."""
        for _ in range(50):
            self.tick()
            while time.monotonic() < self.last_s + 2 * PERIOD_S:
                if all(self.link.setpoint_times_s(each)[-1] > self.last_s for each in self.listed):
                    return
                await pause()
        raise AssertionError("no setpoint leaves")

    async def _run(self) -> None:
        while True:
            self.tick()
            await asyncio.sleep(PERIOD_S)


class DatedTicks(Ticks):
    """Sends velocities that encode their time, so that an old one can be recognised."""

    def velocity_m_s(self) -> tuple[float, float, float]:
        """Whole seconds and their fraction, which single precision can hold."""
        return self.last_s // 1 % AGE_S, self.last_s % 1, 0.0


def asked_s(setpoint: Any, near_s: float) -> float:
    """Time encoded in a setpoint of `DatedTicks`, which is less than `AGE_S` / 2 from `near_s`."""
    ahead_s = (setpoint.vx + setpoint.vy - near_s + AGE_S / 2) % AGE_S - AGE_S / 2
    return float(near_s + ahead_s)
