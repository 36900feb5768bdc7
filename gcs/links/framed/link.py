"""The link over MAVSDK 4.1 and the router: serial ports, TCP, signing, further stations.

MAVSDK repeats the last setpoint at 20 Hz without end, from its own thread, whatever happens to the program
that set it. Therefore its bytes leave through `Router`, where setpoints need a permission that every tick
renews.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from math import degrees, inf
from pathlib import Path
from time import monotonic
from types import MappingProxyType
from typing import Final

import numpy as np

from gcs.links.address_book import SILENT_AFTER_S
from gcs.links.base import BaseLink
from gcs.links.command_protocol import CommandProtocol
from gcs.links.counters import Observer
from gcs.links.endpoints import Place
from gcs.links.framed.router import Router
from gcs.links.framed.stream_requests import is_answer, keep_requesting
from gcs.links.kill_latch import KillLatch
from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.mavsdk.binding import COMPONENT_ID, MavsdkVehicle
from gcs.links.mavsdk.instances import MavsdkInstances
from gcs.links.mavsdk.threads import LinkThread
from gcs.links.mavsdk.workers import MavsdkCommandChannel, Workers
from gcs.links.setpoint_watchdog import ExpectedSetpoints, HeartbeatGate, SetpointWatchdog, before_it_leaves_s
from gcs.links.settings import Forward
from gcs.links.signing_keys import Signing
from gcs.links.stream_rates import NOT_FOR_MAVSDK
from gcs.links.tlog import Recorder
from gcs.links.vehicle_ids import station_id
from gcs.mavlink.framing import GLOBAL_POSITION_INT, PARAM_VALUE, Frame, kill_frame, parameter_value
from gcs.model.errors import CommandError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.state import Mode, Setpoints, Telemetry, VehicleId

log = logging.getLogger(__name__)

_BUSY_S: Final = 0.005
_IDLE_S: Final = 0.025
"""Periods of reading the sockets: while an answer is awaited, and otherwise. Each tick also reads."""

_BEHIND_TICK_S: Final = (0.0005, 0.001, 0.002)
"""After a tick MAVSDK's setpoints are passed on at once, and again after these times."""

_DISCOVER_S: Final = 0.25
_POSITION_PERIOD_S: Final = 0.5
"""Period of the positions that MAVSDK receives; the tick uses all of them."""

_LOOKS_SHARED: Final = 20
_AUTOPILOT_COMPONENT: Final = 1


class MavsdkLink(BaseLink):
    """Up to 250 vehicles, 64 for each MAVSDK instance. A `gcs.links.Link`."""

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        listen: Place | Sequence[Place],
        frame: ShowFrame,
        *,
        setpoint_timeout_s: float = 0.2,
        heartbeat_hold_s: float = 3.0,
        clock: Callable[[], float] = monotonic,
        rates_hz: Mapping[int, float] | None = None,
        record: Path | None = None,
        signing: Signing | None = None,
        forward: Sequence[Forward] = (),
    ) -> None:
        """Nothing is opened before `run`.

        Args:
            name: the name in the configuration.
            vehicles: system id of each vehicle, 1 to 250, each once.
            listen: where the vehicles are.
            frame: to turn setpoints from the show frame to NED.
            setpoint_timeout_s: no setpoint leaves later than this after the time of its tick.
            heartbeat_hold_s: our heartbeats end when `send` has not been called for this long.
            clock: the loop's, ``loop.time``.
            rates_hz: rate to request for each message; without it no rates are requested.
            record: a folder for recordings of every frame.
            signing: signs sent frames, refuses unsigned ones. Of this link alone.
            forward: further ground stations.

        Raises:
            InvalidError: a system id is out of range or used twice, or `setpoint_timeout_s` leaves no time
            to send.
        """
        self._frame = frame
        self._clock = clock
        self._setpoint_watchdog = SetpointWatchdog(before_it_leaves_s(setpoint_timeout_s))
        self._asked = ExpectedSetpoints()
        self._heartbeat_gate = HeartbeatGate(heartbeat_hold_s)
        self._latch = KillLatch(vehicles.values())
        self._source = station_id(vehicles.values()), COMPONENT_ID
        self._router = Router(
            name=name,
            system_ids=vehicles.values(),
            listen=listen,
            setpoint_watchdog=self._setpoint_watchdog,
            latch=self._latch,
            clock=clock,
            deliver=self._deliver,
            station_id=self._source[0],
            asked=self._asked,
            heartbeat_gate=self._heartbeat_gate,
            signing=signing,
            forward=forward,
        )
        self._rates_hz = dict(rates_hz or {})
        recorder = None if record is None else Recorder(record, name, clock)
        super().__init__(name, vehicles, self._router, self._router.counters, recorder)
        self._signing = signing
        self._system_ids = tuple(vehicles.values())
        self._id_of = {system_id: vehicle_id for vehicle_id, system_id in vehicles.items()}
        self._telemetry = tuple(self._router.telemetry[system_id] for system_id in vehicles.values())
        self._fleet: MavsdkInstances | None = None
        self._protocol: CommandProtocol | None = None
        self._workers: Workers | None = None
        self._met: Mapping[int, MavsdkVehicle] = {}
        self._kills = 0
        self._ticked = asyncio.Event()
        n = len(self._ids)
        self._passed_s = dict.fromkeys(vehicles.values(), -inf)  # newest position given to MAVSDK
        self._looks = 0
        self._healthy = [False] * n

    def observe(self, observer: Observer) -> Callable[[], None]:
        """Pass every frame to `observer` from now on; call the result to stop. See `Observer`."""
        router = self._router
        router.observers = (*router.observers, observer)

        def stop() -> None:
            router.observers = tuple(other for other in router.observers if other is not observer)

        return stop

    def setpoint_times_s(self, vehicle_id: VehicleId) -> tuple[float, ...]:
        """Times at which the latest setpoints to this vehicle left our socket, oldest first; bounded."""
        return self._router.setpoint_times_s(self._vehicles[vehicle_id])

    async def run(self) -> None:
        """Move bytes until cancelled. Raises: LinkError naming the port that cannot be opened."""
        router = self._router
        router.open()
        self._heartbeat_gate.beat(self._clock())  # control gets time to start
        fleet = MavsdkInstances(tuple(self._vehicles.values()), self._source[0])
        protocol, workers = CommandProtocol(self._vehicles, self._latch, self._clock), Workers(self._vehicles)
        recorder = self._recorder
        stop_recording = None if recorder is None else self.observe(recorder.record)
        link_thread = LinkThread(fleet, recorder, self._signing)
        try:
            await asyncio.to_thread(link_thread.open)
            self._fleet, self._protocol, self._workers = fleet, protocol, workers
            async with asyncio.TaskGroup() as group:
                group.create_task(self._receive(protocol), name=f"link/{self._name}/receive")
                group.create_task(self._pass_on_behind_ticks(fleet), name=f"link/{self._name}/pass on")
                group.create_task(self._discover(fleet), name=f"link/{self._name}/discover")
                asking = keep_requesting(
                    router.telemetry, self._rates_hz, self._source[0], self._is_met, router.send, self._clock
                )
                group.create_task(asking, name=f"link/{self._name}/ask")
        finally:
            await self._shut(link_thread, protocol, workers)
            if stop_recording is not None:
                stop_recording()

    def snapshot(self) -> Telemetry:
        """The newest telemetry of every vehicle, with arrival times; pending datagrams are read first."""
        self._take_in()
        self._look()
        is_met = np.array([system_id in self._met for system_id in self._vehicles.values()], np.bool_)
        motion = np.array([telemetry.motion for telemetry in self._telemetry]).reshape(-1, 7)
        motion[~is_met] = np.nan  # vehicles that cannot be commanded yet
        position_time_s = np.array([telemetry.position_time_s for telemetry in self._telemetry])
        position_time_s[~is_met] = -np.inf
        return Telemetry(
            ids=self._ids,
            position_time_s=position_time_s,
            heartbeat_time_s=np.array([telemetry.heartbeat_time_s for telemetry in self._telemetry]),
            life_time_s=np.array([telemetry.life_time_s for telemetry in self._telemetry]),
            latitude_deg=motion[:, 0].copy(),
            longitude_deg=motion[:, 1].copy(),
            altitude_amsl_m=motion[:, 2].copy(),
            velocity_ned_m_s=motion[:, 3:6].copy(),
            yaw_deg=motion[:, 6].copy(),
            battery_remaining=np.array([telemetry.battery_remaining for telemetry in self._telemetry]),
            armed=tuple(telemetry.armed for telemetry in self._telemetry),
            mode=tuple(telemetry.mode for telemetry in self._telemetry),
            in_failsafe=tuple(telemetry.in_failsafe for telemetry in self._telemetry),
            landed=tuple(telemetry.landed for telemetry in self._telemetry),
            ready=tuple(
                healthy and telemetry.prearm_ok
                for healthy, telemetry in zip(self._healthy, self._telemetry, strict=True)
            ),
            horizontal_accuracy_m=np.array(
                [telemetry.accuracy.horizontal_m for telemetry in self._telemetry]
            ),
            vertical_accuracy_m=np.array([telemetry.accuracy.vertical_m for telemetry in self._telemetry]),
            reboot_count=tuple(telemetry.reboot_count for telemetry in self._telemetry),
            position_resets=tuple(telemetry.position_resets for telemetry in self._telemetry),
            fix_type=np.array([telemetry.fix_type for telemetry in self._telemetry]),
            unhealthy_sensors=np.array(
                [telemetry.unhealthy_sensors for telemetry in self._telemetry], np.int64
            ),
            clock_base_s=np.array([telemetry.clock_base_s for telemetry in self._telemetry]),
            texts=tuple(telemetry.texts for telemetry in self._telemetry),
        )

    def _look(self) -> None:
        """Query MAVSDK for the health of a part of the vehicles, and of all that were unhealthy."""
        self._looks += 1
        unhealthy = [row for row, healthy in enumerate(self._healthy) if not healthy]
        for row in (*unhealthy, *range(self._looks % _LOOKS_SHARED, len(self._ids), _LOOKS_SHARED)):
            vehicle = self._met.get(self._system_ids[row])
            self._healthy[row] = vehicle is not None and vehicle.healthy()

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's setpoints. Never blocks.

        Permission lasts `setpoint_timeout_s` from the tick's own time, `setpoints.time_s`, on the link's
        clock: a batch
        that is already older is not sent at all. A row that is not finite, and one for a vehicle that is not
        connected, is left out, as if it were not listed.
        """
        now_s = self._clock()
        self._heartbeat_gate.beat(now_s)
        velocity_ned_m_s = self._frame.into_ned(setpoints.velocity_m_s)
        finite = np.isfinite(velocity_ned_m_s).all(axis=1) & np.isfinite(setpoints.yaw_rad)
        rows: dict[int, int] = {}
        for row, vehicle_id in enumerate(setpoints.ids):
            system_id = self._vehicles.get(vehicle_id, 0)
            if finite[row] and system_id in self._met and self._is_connected(system_id, now_s):
                rows[system_id] = row
        # First forbid the vehicles that are not listed, and the previous setpoints. Then replace the
        # setpoints that MAVSDK repeats, and only then allow. In another order MAVSDK could repeat an old
        # setpoint of a vehicle that is listed again.
        since_s = min(now_s, setpoints.time_s)
        reported = velocity_ned_m_s.astype("<f4")
        self._asked.replace({system_id: reported[row].tobytes() for system_id, row in rows.items()})
        self._setpoint_watchdog.refresh(
            (known for known in rows if self._setpoint_watchdog.allows(known, now_s)), since_s
        )
        agreed: list[int] = []
        for system_id, row in rows.items():
            north_m_s, east_m_s, down_m_s = velocity_ned_m_s[row].tolist()
            yaw_deg = (degrees(setpoints.yaw_rad[row]) + self._frame.heading_deg + 180) % 360 - 180
            if self._met[system_id].set_velocity(north_m_s, east_m_s, down_m_s, yaw_deg):
                agreed.append(system_id)
        self._setpoint_watchdog.refresh(agreed, since_s)
        self._ticked.set()
        if self._fleet is not None:
            self._fleet.pass_on(self._router)

    async def execute(self, command: Command) -> None:
        """Send a command, and return when the vehicle's heartbeat confirms it. See `Link.execute`.

        Raises: UnknownError for a vehicle of another link; CommandError.
        """
        protocol, system_id = self._protocol_for(command.vehicle_id, f"{command.verb} impossible")
        telemetry = self._router.telemetry[system_id]
        if command.verb is Verb.KILL:
            await protocol.kill(command, telemetry, lambda: self._send_kill(system_id))
            return
        channel = self._command_channel(command.vehicle_id, f"{command.verb} impossible")
        if command.verb is Verb.OFFBOARD and not self._setpoint_watchdog.allows(system_id, self._clock()):
            raise CommandError(f"{command.vehicle_id}: offboard refused: no setpoints are flowing to it")
        await protocol.execute(command, channel, telemetry)

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """See `Link.read_parameters`."""
        protocol, _ = self._protocol_for(vehicle_id, "its parameters cannot be read")
        channel = self._command_channel(vehicle_id, "its parameters cannot be read")
        return await protocol.read_parameters(vehicle_id, names, channel)

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """See `Link.set_parameter`."""
        protocol, _ = self._protocol_for(vehicle_id, f"{name} cannot be set")
        channel = self._command_channel(vehicle_id, f"{name} cannot be set")
        await protocol.set_parameter(vehicle_id, name, value, channel)

    def _protocol_for(self, vehicle_id: VehicleId, otherwise: str) -> tuple[CommandProtocol, int]:
        """The command protocol, and the vehicle's system id. Raises: UnknownError, CommandError."""
        system_id = self._vehicles.get(vehicle_id)
        if system_id is None:
            raise UnknownError(f"{vehicle_id} is not on link {self._name}")
        if self._protocol is None:
            raise CommandError(f"{vehicle_id}: {otherwise}: link {self._name} is not open")
        return self._protocol, system_id

    def _command_channel(self, vehicle_id: VehicleId, otherwise: str) -> MavsdkCommandChannel:
        """The vehicle's command channel. Raises: CommandError for one that MAVSDK has not discovered."""
        vehicle = self._met.get(self._vehicles[vehicle_id])
        if vehicle is None or self._workers is None:
            raise CommandError(f"{vehicle_id}: {otherwise}: never received on link {self._name}")
        return self._workers.channel(vehicle_id, vehicle, self._router.telemetry[self._vehicles[vehicle_id]])

    def _is_connected(self, system_id: int, now_s: float) -> bool:
        """Whether it has a recent sign of life and a known mode."""
        telemetry = self._router.telemetry[system_id]
        return now_s - telemetry.life_time_s <= SILENT_AFTER_S and telemetry.mode is not Mode.UNKNOWN

    def _is_met(self, system_id: int) -> bool:
        return system_id in self._met

    def _deliver(self, frame: Frame) -> None:
        if frame.message_id == PARAM_VALUE and frame.component_id == _AUTOPILOT_COMPONENT:
            self._parameter_news.take(self._id_of[frame.system_id], *parameter_value(frame))
        if self._fleet is None or frame.message_id in NOT_FOR_MAVSDK:
            return  # it was counted as an arrival, and observers receive it
        if frame.message_id == GLOBAL_POSITION_INT:
            now_s = self._router.telemetry[frame.system_id].position_time_s
            if now_s - self._passed_s[frame.system_id] < _POSITION_PERIOD_S:
                return
            self._passed_s[frame.system_id] = now_s
        if not is_answer(frame):  # MAVSDK did not send the request
            self._fleet.receive(frame.system_id, frame.raw)

    def _send_kill(self, system_id: int) -> None:
        frame = kill_frame(
            system_id,
            sequence=self._kills,
            source_system=self._source[0],
            source_component=self._source[1],
        )
        self._kills += 1
        self._router.send_kill(frame)

    def _take_in(self) -> None:
        self._router.receive()
        if self._fleet is not None:
            self._fleet.flush()
            self._fleet.pass_on(self._router)

    async def _pass_on_behind_ticks(self, fleet: MavsdkInstances) -> None:
        """MAVSDK's threads write a moment after the call."""
        while True:
            await self._ticked.wait()
            self._ticked.clear()
            for wait_s in _BEHIND_TICK_S:
                fleet.pass_on(self._router)
                await asyncio.sleep(wait_s)
            fleet.pass_on(self._router)

    async def _receive(self, protocol: CommandProtocol) -> None:
        while True:
            self._take_in()
            is_idle = len(self._met) == len(self._ids) and not protocol.awaited
            await asyncio.sleep(_IDLE_S if is_idle else _BUSY_S)

    async def _discover(self, fleet: MavsdkInstances) -> None:
        """Look for newly discovered vehicles of MAVSDK, without end."""
        desired = frozenset(self._vehicles.values())
        while True:
            missing = desired - self._met.keys()
            if any(telemetry.mode is not Mode.UNKNOWN for telemetry in self._telemetry) and missing:
                found = await asyncio.to_thread(fleet.discover, missing)
                if found:
                    self._met = MappingProxyType({**self._met, **found})
                    log.info("vehicles_met", extra={"link": self._name, "system_ids": tuple(sorted(found))})
            await asyncio.sleep(_DISCOVER_S)

    async def _shut(self, link_thread: LinkThread, protocol: CommandProtocol, workers: Workers) -> None:
        """Close from the inside out: setpoints, calls, MAVSDK, sockets."""
        self._setpoint_watchdog.refresh((), self._clock())
        self._fleet, self._protocol, self._workers, self._met = None, None, None, {}
        self._healthy = [False] * len(self._ids)
        protocol.close()
        workers.close()

        def end() -> None:
            workers.join()
            link_thread.close()

        try:
            await asyncio.to_thread(end)
        finally:
            self._router.close()
