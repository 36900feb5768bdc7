"""MAVSDK as its documentation shows it, for `links.py` to compare with: nothing of ours between.

One instance, one port for each vehicle, everything subscribed to, setpoints set one after the other; once
with its own calls and once with its asyncio wrappers. The yaw of a setpoint returns the stamp that its
vehicle's newest position carries in its relative altitude.
"""

import asyncio
import time
from math import degrees, isfinite
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk import asyncio as wrapped
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.offboard import Offboard, VelocityNedYaw
from mavsdk.plugins.telemetry import Telemetry

from tests.bench.link_measures import FIRST_PORT, MEETING_S, CannotError, Cost, Fleet, Window, flying
from tests.bench.link_traffic import HOST

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
Newest = dict[tuple[int, str], Any]


def setpoint(newest: Newest, row: int) -> VelocityNedYaw:
    """With the stamp of the vehicle's newest position."""
    position = newest.get((row, "position"))
    return VelocityNedYaw(0.1, 0.2, 0.0, 0.0 if position is None else degrees(position.relative_altitude_m))


def opened(count: int) -> Mavsdk:
    """One instance with a port for each vehicle."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    for port in range(FIRST_PORT, FIRST_PORT + count):
        mavsdk.add_any_connection(f"udpin://{HOST}:{port}")
    return mavsdk


def check_met(met: int, count: int, until_s: float) -> None:
    """Raises: CannotError when time is up and somebody is missing."""
    if met < count and time.monotonic() > until_s:
        raise CannotError(f"has met {met} of {count} within {MEETING_S:.0f} s")


def with_subscriptions(fleet: Fleet, count: int, rate_hz: float, missing: int = 0) -> Cost:
    """Fly them, but for `missing` that never speak."""
    mavsdk = opened(count)
    systems: list[Any] = []
    until_s = time.monotonic() + MEETING_S
    while len(systems) < count - missing:
        check_met(len(systems), count - missing, until_s)
        time.sleep(0.5)
        systems = [system for system in mavsdk.get_systems() if system.has_autopilot()]
    newest: Newest = {}
    plugins = [(Telemetry(system), Offboard(system)) for system in systems]
    for row, (telemetry, _) in enumerate(plugins):
        for name in STREAMS:
            getattr(telemetry, f"subscribe_{name}")(
                lambda value, key: newest.update({key: value}), (row, name)
            )
    window, sent, start_s, tick = Window(fleet), 0, time.monotonic(), 0
    while window.goes_on(sent):
        for row, (_, offboard) in enumerate(plugins):
            offboard.set_velocity_ned(setpoint(newest, row))
        sent += len(plugins)
        tick += 1
        time.sleep(max(0.0, start_s + tick / rate_hz - time.monotonic()))
    return window.cost()


async def with_wrappers(fleet: Fleet, count: int, rate_hz: float) -> Cost:
    """The same through `mavsdk.asyncio`."""
    mavsdk = wrapped.Mavsdk(
        wrapped.Configuration.create_with_component_type(wrapped.ComponentType.GROUND_STATION)
    )
    for port in range(FIRST_PORT, FIRST_PORT + count):
        await mavsdk.add_any_connection(f"udpin://{HOST}:{port}")
    systems: list[Any] = []
    until_s = time.monotonic() + MEETING_S
    while len(systems) < count:
        check_met(len(systems), count, until_s)
        await asyncio.sleep(0.5)
        systems = list(await mavsdk.get_systems())
    newest: Newest = {}

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
    window, sent, start_s, tick = Window(fleet), 0, time.monotonic(), 0
    while window.goes_on(sent):
        for row, offboard in enumerate(offboards):
            await offboard.set_velocity_ned(setpoint(newest, row))
        sent += len(offboards)
        tick += 1
        await asyncio.sleep(start_s + tick / rate_hz - time.monotonic())
    for task in following:
        task.cancel()
    return window.cost()


def connecting_s(count: int) -> float:
    """The longest time from a vehicle's first heartbeat until it is a system with a position."""
    mavsdk = opened(count)
    time.sleep(2.0)
    met_s: dict[int, float] = {}
    known: dict[int, tuple[Any, Telemetry]] = {}
    with flying(count, "--own-ports") as fleet:
        until_s = time.monotonic() + MEETING_S
        while len(met_s) < count:
            check_met(len(met_s), count, until_s)
            time.sleep(0.02)
            for system in mavsdk.get_systems():
                system_id = system.get_system_id()
                if system_id not in known and system.has_autopilot():
                    known[system_id] = system, Telemetry(system)
            for system_id in known.keys() - met_s.keys():
                system, telemetry = known[system_id]
                if system.is_connected() and isfinite(telemetry.position().latitude_deg):
                    met_s[system_id] = time.monotonic()
    return fleet.connecting_s([(0, system_id, when_s) for system_id, when_s in met_s.items()])
