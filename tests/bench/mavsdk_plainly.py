"""MAVSDK as its documentation shows it, for `links.py` to compare with: nothing of ours between.

One instance, one port for each vehicle, everything subscribed to, setpoints set one after the other; once
with its own calls and once with its asyncio wrappers.
"""

import asyncio
import time
from collections.abc import Callable
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk import asyncio as wrapped
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
from mavsdk.plugins.telemetry import Telemetry

STREAMS = (
    "position",
    "velocity_ned",
    "heading",
    "battery",
    "landed_state",
    "armed",
    "flight_mode",
    "health_all_ok",
)
MEETING_S = 60.0


def sent_with_subscriptions(
    host: str,
    first_port: int,
    count: int,
    rate_hz: float,
    began: Callable[[], bool],
    ended: Callable[[], bool],
) -> int:
    """Fly them until `ended`. Returns: setpoints that were set after `began`."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    for port in range(first_port, first_port + count):
        mavsdk.add_any_connection(f"udpin://{host}:{port}")
    systems: list[Any] = []
    until_s = time.monotonic() + MEETING_S
    while len(systems) < count and time.monotonic() < until_s:
        time.sleep(0.5)
        systems = [system for system in mavsdk.get_systems() if system.has_autopilot()]
    newest: dict[tuple[int, str], object] = {}
    plugins = [(Telemetry(system), Offboard(system)) for system in systems]
    for row, (telemetry, _) in enumerate(plugins):
        for name in STREAMS:
            getattr(telemetry, f"subscribe_{name}")(
                lambda value, key: newest.update({key: value}), (row, name)
            )
    sent, start_s, tick = 0, time.monotonic(), 0
    while not ended():
        for _, offboard in plugins:
            offboard.set_velocity_ned(VelocityNedYaw(0.1, 0.2, 0.3, 40.0))
            sent += began()
        tick += 1
        time.sleep(max(0.0, start_s + tick / rate_hz - time.monotonic()))
    return sent


async def sent_with_wrappers(
    host: str,
    first_port: int,
    count: int,
    rate_hz: float,
    began: Callable[[], bool],
    ended: Callable[[], bool],
) -> int:
    """The same through `mavsdk.asyncio`."""
    mavsdk = wrapped.Mavsdk(
        wrapped.Configuration.create_with_component_type(wrapped.ComponentType.GROUND_STATION)
    )
    for port in range(first_port, first_port + count):
        await mavsdk.add_any_connection(f"udpin://{host}:{port}")
    systems: list[Any] = []
    until_s = time.monotonic() + MEETING_S
    while len(systems) < count and time.monotonic() < until_s:
        await asyncio.sleep(0.5)
        systems = list(await mavsdk.get_systems())
    newest: dict[tuple[int, str], object] = {}

    async def follow(telemetry: Any, row: int, name: str) -> None:
        async for value in getattr(telemetry, f"subscribe_{name}")():
            newest[row, name] = value

    offboards = [OffboardAsync(system) for system in systems]
    telemetries = [TelemetryAsync(system) for system in systems]
    following = [
        asyncio.create_task(follow(telemetry, row, name))
        for row, telemetry in enumerate(telemetries)
        for name in STREAMS
    ]
    sent, start_s, tick = 0, time.monotonic(), 0
    while not ended():
        for offboard in offboards:
            await offboard.set_velocity_ned(VelocityNedYaw(0.1, 0.2, 0.3, 40.0))
            sent += began()
        tick += 1
        await asyncio.sleep(start_s + tick / rate_hz - time.monotonic())
    for task in following:
        task.cancel()
    return sent
