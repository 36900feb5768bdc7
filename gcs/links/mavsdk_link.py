"""The link over MAVSDK 4.1: its protocol knowledge, our bytes.

MAVSDK repeats the last setpoint at 20 Hz for ever, from its own thread, whatever becomes of the program that
set it. Therefore its bytes leave through `Wire`, where setpoints need a permission that every tick renews.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping
from math import degrees, isnan
from time import monotonic
from types import MappingProxyType
from typing import Final

import numpy as np

from gcs.errors import InvalidError, OrderError, UnknownError
from gcs.frames import ShowFrame
from gcs.links.deadman import Deadman
from gcs.links.killlatch import KillLatch
from gcs.links.link import Order, Verb
from gcs.links.mavlink_frames import Frame, kill_frame
from gcs.links.mavsdk_fleet import COMPONENT_ID, SYSTEM_ID, MavsdkFleet, MavsdkVehicle
from gcs.links.mavsdk_orders import Workers
from gcs.links.orders import Orders
from gcs.links.roster import Address
from gcs.links.wire import Counters, Listen, Observer, Wire
from gcs.state import Landed, Mode, Setpoints, Telemetry, VehicleId

log = logging.getLogger(__name__)

VEHICLES_MAX: Final = 64
"""Per MAVSDK instance: beyond, its own chatter grows with the square."""

SILENT_AFTER_S: Final = 3.0
"""Without a heartbeat for this long a vehicle counts as not connected, and is sent no setpoint."""

_SYSTEM_ID_MAX: Final = 250
_RECEIVE_PERIOD_S: Final = 0.005
_DISCOVER_S: Final = 0.25
_SEND_MARGIN_S: Final = 0.02
"""Between asking the deadman and the datagram's leaving, other threads may hold the interpreter."""

_NOT_FOR_MAVSDK: Final = frozenset({30, 31, 32, 36, 74, 83, 85, 87, 105, 132, 141, 331})
"""Frequent, and nothing here reads them: attitudes, local position, servos, HUD, targets, IMU, range,
altitude, odometry. They still count as arrivals and reach observers."""


class MavsdkLink:
    """Up to 64 vehicles over UDP through one MAVSDK instance. A `gcs.links.Link`."""

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        listen: Listen,
        frame: ShowFrame,
        *,
        deadman_s: float = 0.2,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """Nothing is opened before `run`.

        Args:
            name: as the configuration calls it.
            vehicles: system id of each vehicle, 1 to 250, each once.
            listen: UDP ports where the vehicles send to.
            frame: to turn setpoints from the show frame to NED.
            deadman_s: no setpoint leaves later than this after the time of the tick that asked for it.
            clock: the loop's, ``loop.time``.

        Raises: InvalidError for a system id out of range, used twice or MAVSDK's own, for too many vehicles,
            and for a deadman's time that leaves nothing.
        """
        if not deadman_s > _SEND_MARGIN_S:
            raise InvalidError("deadman_s", deadman_s, f"above {_SEND_MARGIN_S} s")
        _check(vehicles)
        self._name = name
        self._vehicles = MappingProxyType(dict(vehicles))
        self._ids = tuple(vehicles)
        self._frame = frame
        self._clock = clock
        self._deadman = Deadman(deadman_s - _SEND_MARGIN_S)
        self._latch = KillLatch(vehicles.values())
        self._wire = Wire(
            name=name,
            system_ids=vehicles.values(),
            listen=listen,
            deadman=self._deadman,
            latch=self._latch,
            clock=clock,
            deliver=self._deliver,
        )
        self._heard = tuple(self._wire.heard[system_id] for system_id in vehicles.values())
        self._fleet: MavsdkFleet | None = None
        self._orders: Orders | None = None
        self._workers: Workers | None = None
        self._met: Mapping[int, MavsdkVehicle] = {}
        self._kills = 0

    @property
    def name(self) -> str:
        """As the configuration calls it."""
        return self._name

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link, heard or not."""
        return self._ids

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles whose system id was heard lately from two addresses: both named in the text."""
        texts = self._wire.conflicts()
        return {
            vehicle_id: texts[system_id]
            for vehicle_id, system_id in self._vehicles.items()
            if system_id in texts
        }

    @property
    def setpoints_sent(self) -> int:
        """How many setpoints have left, in all."""
        return self._wire.counters.setpoints_sent

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Where each vehicle heard so far spoke from last: all that a kill from outside needs to know."""
        known = {
            vehicle_id: self._wire.address(system_id) for vehicle_id, system_id in self._vehicles.items()
        }
        return {vehicle_id: address for vehicle_id, address in known.items() if address is not None}

    @property
    def counters(self) -> Counters:
        """Totals since the link was made: setpoints sent, dropped by the deadman, and so on."""
        return self._wire.counters

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Show every frame to `observer` from now on; call the result to stop. See `Observer`."""
        wire = self._wire
        wire.observers = (*wire.observers, observer)

        def stop() -> None:
            wire.observers = tuple(other for other in wire.observers if other is not observer)

        return stop

    def setpoint_times_s(self, vehicle_id: VehicleId) -> tuple[float, ...]:
        """When the latest setpoints to this vehicle left our socket, oldest first; bounded."""
        return self._wire.setpoint_times_s(self._vehicles[vehicle_id])

    async def run(self) -> None:
        """Move bytes until cancelled. Raises: LinkError naming the port that cannot be had."""
        self._wire.open()
        fleet, orders = MavsdkFleet(self._wire.send), Orders(self._vehicles, self._latch, self._clock)
        workers = Workers(self._vehicles)
        try:
            await asyncio.to_thread(fleet.open)
            self._fleet, self._orders, self._workers = fleet, orders, workers
            async with asyncio.TaskGroup() as group:
                group.create_task(self._receive(), name=f"link/{self._name}/receive")
                group.create_task(self._discover(fleet), name=f"link/{self._name}/discover")
        finally:
            await self._shut(fleet, orders, workers)

    def snapshot(self) -> Telemetry:
        """The newest known of every vehicle, with arrival times. About 20 us per vehicle."""
        n = len(self._ids)
        position_time_s = np.full(n, -np.inf)
        motion = np.full((n, 7), np.nan)
        battery = np.full(n, np.nan)
        landed = [Landed.UNKNOWN] * n
        ready = [False] * n
        for row, (system_id, heard) in enumerate(zip(self._vehicles.values(), self._heard, strict=True)):
            vehicle = self._met.get(system_id)
            if vehicle is None:
                continue
            motion[row] = vehicle.motion()
            if not isnan(motion[row, 0]):  # MAVSDK may not have seen yet what the wire has
                position_time_s[row] = heard.position_time_s
            battery[row] = vehicle.battery_remaining()
            landed[row] = vehicle.landed()
            ready[row] = heard.prearm_ok and vehicle.healthy()
        return Telemetry(
            ids=self._ids,
            position_time_s=position_time_s,
            heartbeat_time_s=np.array([heard.heartbeat_time_s for heard in self._heard]),
            latitude_deg=motion[:, 0].copy(),
            longitude_deg=motion[:, 1].copy(),
            altitude_amsl_m=motion[:, 2].copy(),
            velocity_ned_m_s=motion[:, 3:6].copy(),
            yaw_deg=motion[:, 6].copy(),
            battery_remaining=battery,
            armed=tuple(heard.armed for heard in self._heard),
            mode=tuple(heard.mode for heard in self._heard),
            landed=tuple(landed),
            ready=tuple(ready),
        )

    def send(self, setpoints: Setpoints) -> None:
        """Hand over one tick's orders. Never blocks.

        Permission lasts `deadman_s` from the tick's own time, `setpoints.time_s`, on the link's clock: a
        batch that is older than that when it comes is not sent at all. A row that is not finite, and one for
        a vehicle that is not connected, is left out, as if it were not listed.
        """
        now_s = self._clock()
        velocity_ned_m_s = self._frame.into_ned(setpoints.velocity_m_s)
        finite = np.isfinite(velocity_ned_m_s).all(axis=1) & np.isfinite(setpoints.yaw_rad)
        rows: dict[int, int] = {}
        for row, vehicle_id in enumerate(setpoints.ids):
            system_id = self._vehicles.get(vehicle_id, 0)
            if finite[row] and system_id in self._met and self._is_connected(system_id, now_s):
                rows[system_id] = row
        # Forbid first what is not listed; then replace what MAVSDK repeats; only then allow. The other way
        # round it could repeat an old setpoint of a vehicle that is listed again.
        since_s = min(now_s, setpoints.time_s)
        self._deadman.refresh((known for known in rows if self._deadman.allows(known, now_s)), since_s)
        agreed: list[int] = []
        for system_id, row in rows.items():
            north_m_s, east_m_s, down_m_s = velocity_ned_m_s[row].tolist()
            yaw_deg = (degrees(setpoints.yaw_rad[row]) + self._frame.heading_deg + 180) % 360 - 180
            if self._met[system_id].set_velocity(north_m_s, east_m_s, down_m_s, yaw_deg):
                agreed.append(system_id)
        self._deadman.refresh(agreed, since_s)

    async def execute(self, order: Order) -> None:
        """Order, and return when the vehicle is seen to obey. See `Link.execute`.

        Raises: UnknownError for a vehicle of another link; OrderError.
        """
        system_id = self._vehicles.get(order.vehicle_id)
        if system_id is None:
            raise UnknownError(f"{order.vehicle_id} is not on link {self._name}")
        if self._orders is None or self._workers is None:
            raise OrderError(f"{order.vehicle_id}: {order.verb} impossible: link {self._name} is not open")
        heard = self._wire.heard[system_id]
        if order.verb is Verb.KILL:
            await self._orders.kill(order, heard, lambda: self._send_kill(system_id))
            return
        vehicle = self._met.get(system_id)
        if vehicle is None:
            raise OrderError(f"{order.vehicle_id}: {order.verb} impossible: never heard on link {self._name}")
        if order.verb is Verb.OFFBOARD and not self._deadman.allows(system_id, self._clock()):
            raise OrderError(f"{order.vehicle_id}: offboard refused: no setpoints are flowing to it")
        await self._orders.execute(order, self._workers.hand(order.vehicle_id, vehicle), heard)

    def _is_connected(self, system_id: int, now_s: float) -> bool:
        return now_s - self._wire.heard[system_id].heartbeat_time_s <= SILENT_AFTER_S

    def _deliver(self, frame: Frame) -> None:
        if self._fleet is not None and frame.message_id not in _NOT_FOR_MAVSDK:
            self._fleet.receive(frame.raw)

    def _send_kill(self, system_id: int) -> None:
        frame = kill_frame(
            system_id, sequence=self._kills, source_system=SYSTEM_ID, source_component=COMPONENT_ID
        )
        self._kills += 1
        self._wire.send_kill(frame)

    async def _receive(self) -> None:
        while True:
            self._wire.receive()
            await asyncio.sleep(_RECEIVE_PERIOD_S)

    async def _discover(self, fleet: MavsdkFleet) -> None:
        """Look for vehicles that MAVSDK has met since, for ever."""
        wanted = frozenset(self._vehicles.values())
        while True:
            missing = wanted - self._met.keys()
            if any(heard.mode is not Mode.UNKNOWN for heard in self._heard) and missing:
                found = await asyncio.to_thread(fleet.discover, missing)
                if found:
                    self._met = MappingProxyType({**self._met, **found})
                    log.info("vehicles_met", extra={"link": self._name, "system_ids": tuple(sorted(found))})
            await asyncio.sleep(_DISCOVER_S)

    async def _shut(self, fleet: MavsdkFleet, orders: Orders, workers: Workers) -> None:
        """Stop, inside out: no setpoints, no calls, no MAVSDK, no sockets."""
        self._deadman.refresh((), self._clock())
        self._fleet, self._orders, self._workers, self._met = None, None, None, {}
        orders.close()
        workers.close()

        def end() -> None:
            workers.join()
            fleet.destroy()

        try:
            await asyncio.to_thread(end)
        finally:
            self._wire.close()


def _check(vehicles: Mapping[VehicleId, int]) -> None:
    """Raises: InvalidError."""
    if len(vehicles) > VEHICLES_MAX:
        raise InvalidError("vehicles", len(vehicles), f"at most {VEHICLES_MAX} on one link")
    owners: dict[int, VehicleId] = {}
    for vehicle_id, system_id in vehicles.items():
        if not 1 <= system_id <= _SYSTEM_ID_MAX or system_id == SYSTEM_ID:
            allowed = f"1 to {_SYSTEM_ID_MAX}, but not {SYSTEM_ID}, which is this station's own"
            raise InvalidError(f"vehicles.{vehicle_id}", system_id, allowed)
        if system_id in owners:
            raise InvalidError(
                f"vehicles.{vehicle_id}", system_id, f"another system id: {owners[system_id]} has it"
            )
        owners[system_id] = vehicle_id
