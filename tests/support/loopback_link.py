"""A `Link` for virtual time: MAVLink 2 bytes to and from the fake autopilots of `sim`, on the loop's clock.

No sockets, no threads, no MAVSDK: under `async_solipsism.EventLoop` a flight of minutes takes seconds. A
setpoint leaves once for each tick that sends it. Unlike MAVSDK this link repeats nothing, so its setpoint
watchdog only has to refuse a batch that is too old on arrival.
"""

import asyncio
import struct
from collections.abc import Collection, Mapping, Sequence
from math import inf, isfinite, nan, pi
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.links import Command, ParameterValue, Verb
from gcs.links import stream_rates as rates
from gcs.links.address_book import Address
from gcs.links.parameter_updates import ParameterNews
from gcs.links.settings import StreamSettings
from gcs.mavlink.framing import HEARTBEAT, PARAM_VALUE, kill_frame, parameter_value, split
from gcs.model.errors import CommandError, LinkError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, Setpoints, Telemetry, VehicleId
from gcs.sim.faults.injector import FaultInjector, Origin
from gcs.sim.faults.link_faults import Channel
from gcs.sim.fleet import STEP_S, Fleet
from gcs.sim.protocol.autopilot import Autopilot
from gcs.sim.vehicle.modes import Mode as PilotMode
from tests.support.loopback_ears import INT32, Receiver, failure, news, obeyed

STATION = (245, 190)
VELOCITY_AND_YAW = 0x9C7
HEARTBEAT_PERIOD_S = 1.0
CONFIRM_S = 3.2
KILL_REPEAT_S = 0.1
PARAMETER_S, PARAMETER_REPEAT_S = 3.0, 0.5
REAL32 = 9
UNREAD = (4, 42, 83, 85)  # not asked of the vehicles

MODE_NUMBERS = {
    Verb.HOLD: (4, 3),
    Verb.OFFBOARD: (6, 0),
    Verb.RETURN: (4, 5),
}


class SentSetpoint(NamedTuple):
    """One setpoint as sent: NED, with yaw from north."""

    time_s: float
    velocity_ned_m_s: tuple[float, float, float]
    yaw_rad: float


class SentCommand(NamedTuple):
    """One command as given to the link."""

    time_s: float
    verb: Verb


class LoopbackLink:
    """A `gcs.links.Link` to a fake fleet in the same loop. Steps the fleet's physics while it runs.

    Attributes:
        sent, commands: setpoints and commands sent to each vehicle, oldest first.
        failures: `run` raises the first of them, at once or while it runs, and removes it.
        runs: how often `run` was called.
        fault_injector: its faults lose and delay frames; None: no link has faults.
        addresses, conflicts, problems: values of the properties with these names.
    """

    def __init__(
        self,
        name: str,
        vehicles: Mapping[VehicleId, int],
        fleet: Fleet,
        frame: ShowFrame,
        *,
        setpoint_timeout_s: float,
    ) -> None:
        """`vehicles` and `fleet.autopilots` belong together by system id."""
        self._name = name
        self._system_ids = dict(vehicles)
        self._fleet = fleet
        self._frame = frame
        self._setpoint_timeout_s = setpoint_timeout_s
        self._row = {pilot.system_id: row for row, pilot in enumerate(fleet.autopilots)}
        self._mav = common.MAVLink(None, *STATION)
        self._receivers = {vehicle_id: Receiver() for vehicle_id in vehicles}
        self._locks = {vehicle_id: asyncio.Lock() for vehicle_id in vehicles}
        self._uplink: list[tuple[VehicleId, bytes]] = []
        self._setpoint_s = dict.fromkeys(vehicles, -inf)
        self._deaf: set[VehicleId] = set()  # it receives nothing
        self._mute: set[VehicleId] = set()  # nothing is received from it
        self.beatless: set[VehicleId] = set()  # its heartbeats do not
        self.sent: dict[VehicleId, list[SentSetpoint]] = {vehicle_id: [] for vehicle_id in vehicles}
        self.commands: dict[VehicleId, list[SentCommand]] = {vehicle_id: [] for vehicle_id in vehicles}
        self.failures: list[LinkError] = []
        self.refusing: set[tuple[VehicleId, Verb]] = set()  # commands that are refused, as by PX4
        self.parameter_reads: list[
            tuple[float, VehicleId]
        ] = []  # times of parameter requests, with their vehicles
        self._news = ParameterNews()
        self.runs = 0
        self.takes_s = 0.0  # of every batch of setpoints, as on a machine that has too much to do
        self.conflicts: dict[VehicleId, str] = {}
        self.addresses: dict[VehicleId, Address] = {}
        self.problems: tuple[str, ...] = ()
        self.fault_injector: FaultInjector | None = None  # of the broken links that bytes pass

    # the link

    @property
    def name(self) -> str:
        """Name of the link in the configuration."""
        return self._name

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link."""
        return tuple(self._system_ids)

    @property
    def setpoints_sent(self) -> int:
        """Number of setpoints sent."""
        return sum(len(sent) for sent in self.sent.values())

    async def run(self) -> None:
        """Move bytes and step the physics until cancelled. Raises: LinkError while `failures` has any.

        The physics catch up with the time in which the link did not run: vehicles do not wait for a link.
        """
        self.runs += 1
        loop = asyncio.get_running_loop()
        self._ask_for_less()
        beat_s = loop.time()
        while not self.failures:
            if loop.time() >= beat_s:
                beat_s += HEARTBEAT_PERIOD_S
                self._post_to_all(common.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
            while self._fleet.time_s + STEP_S / 2 < loop.time():
                self._deliver()
                self._fleet.step()
                if self.fault_injector is not None:
                    self.fault_injector.pass_time()
                self._listen(loop.time())
            await asyncio.sleep(self._fleet.time_s + STEP_S - loop.time())
        raise self.failures.pop(0)

    def snapshot(self) -> Telemetry:
        """The newest known of every vehicle."""
        receiver = tuple(self._receivers.values())
        motion = np.array([received.motion for received in receiver])
        return Telemetry(
            ids=self.ids,
            position_time_s=np.array([received.position_time_s for received in receiver]),
            heartbeat_time_s=np.array([received.heartbeat_time_s for received in receiver]),
            life_time_s=np.array([received.life_time_s for received in receiver]),
            latitude_deg=motion[:, 0].copy(),
            longitude_deg=motion[:, 1].copy(),
            altitude_amsl_m=motion[:, 2].copy(),
            velocity_ned_m_s=motion[:, 3:6].copy(),
            yaw_deg=motion[:, 6].copy(),
            battery_remaining=np.array([received.battery_remaining for received in receiver]),
            armed=tuple(received.armed for received in receiver),
            mode=tuple(received.mode for received in receiver),
            in_failsafe=tuple(received.in_failsafe for received in receiver),
            landed=tuple(received.landed for received in receiver),
            ready=tuple(received.prearm_ok for received in receiver),
            horizontal_accuracy_m=np.array([received.accuracy.horizontal_m for received in receiver]),
            vertical_accuracy_m=np.array([received.accuracy.vertical_m for received in receiver]),
            reboot_count=tuple(received.reboot_count for received in receiver),
            position_resets=tuple(received.position_resets for received in receiver),
            fix_type=np.array([received.fix_type for received in receiver]),
            unhealthy_sensors=np.array([received.unhealthy_sensors for received in receiver], np.int64),
            clock_base_s=np.array([received.clock_base_s for received in receiver]),
            texts=tuple(received.texts for received in receiver),
        )

    def send(self, setpoints: Setpoints) -> None:
        """Send the setpoints of one tick unless they are older than the watchdog's hold time."""
        now_s = asyncio.get_running_loop().time()
        if now_s - setpoints.time_s > self._setpoint_timeout_s:
            return
        velocity_ned_m_s = self._frame.into_ned(setpoints.velocity_m_s)
        yaw_rad = (setpoints.yaw_rad + np.radians(self._frame.heading_deg) + pi) % (2 * pi) - pi
        for vehicle_id, velocity, yaw in zip(setpoints.ids, velocity_ned_m_s, yaw_rad, strict=True):
            if vehicle_id in self._system_ids and isfinite(yaw) and np.isfinite(velocity).all():
                self._send_setpoint(vehicle_id, velocity, float(yaw), now_s)
        if self.takes_s > 0.0:
            loop: Any = asyncio.get_running_loop()  # async_solipsism's: time passes while this one works
            loop._selector.clock.advance(self.takes_s)

    async def execute(self, command: Command) -> None:
        """Send a command; return when the heartbeat shows that the vehicle obeyed. Raises: CommandError."""
        if command.vehicle_id not in self._system_ids:
            raise UnknownError(f"{command.vehicle_id} is not on link {self._name}")
        loop = asyncio.get_running_loop()
        received = self._receivers[command.vehicle_id]
        self.commands[command.vehicle_id].append(SentCommand(loop.time(), command.verb))
        if command.verb is Verb.KILL:
            await self._kill(command, received)
            return
        async with self._locks[command.vehicle_id]:
            began_s = loop.time()
            if (command.vehicle_id, command.verb) in self.refusing:
                raise CommandError(f"{command.vehicle_id}: {command.verb} refused: COMMAND_DENIED")
            self._refuse_the_impossible(command, received, began_s)
            self._post_command(command, received)
            while not (received.heartbeat_time_s > began_s and obeyed(command.verb, received)):
                left_s = began_s + CONFIRM_S - loop.time()
                if left_s <= STEP_S:  # shorter sleeps are below the clock's resolution
                    raise CommandError(failure(command, received, began_s))
                await news(received, left_s)

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """Request all at once, and again those that are not answered. Raises: CommandError naming one."""
        loop = asyncio.get_running_loop()
        known, target = self._receivers[vehicle_id].parameters, self._system_ids[vehicle_id]
        self.parameter_reads.append((loop.time(), vehicle_id))
        for name in names:
            known.pop(name, None)
        until_s, ask_s = loop.time() + PARAMETER_S, -inf
        while missing := [name for name in names if name not in known]:
            if loop.time() > until_s:
                raise CommandError(f"{vehicle_id}: parameter {missing[0]}: no answer")
            if loop.time() - ask_s >= PARAMETER_REPEAT_S:
                ask_s = loop.time()
                for name in missing:
                    self._post(
                        vehicle_id,
                        common.MAVLink_param_request_read_message(target, 1, name.encode("ascii"), -1),
                    )
            await asyncio.sleep(STEP_S)
        return {name: known[name] for name in names}

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Set a parameter and wait until the vehicle announces it. Raises: CommandError naming it."""
        known, target = self._receivers[vehicle_id].parameters, self._system_ids[vehicle_id]
        whole = isinstance(value, int)
        encoded = struct.unpack("<f", struct.pack("<i", value))[0] if whole else value
        kind = INT32 if whole else REAL32
        known.pop(name, None)
        message = common.MAVLink_param_set_message(target, 1, name.encode("ascii"), encoded, kind)
        self._post(vehicle_id, message)
        until_s = asyncio.get_running_loop().time() + PARAMETER_S
        while name not in known:
            if asyncio.get_running_loop().time() > until_s:
                raise CommandError(f"{vehicle_id}: parameter {name}: no answer")
            await asyncio.sleep(STEP_S)

    def watch_parameters(self, names: Collection[str]) -> None:
        """Keep announced values of these parameters."""
        self._news.watch(names)

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """Values announced since the last call."""
        return self._news.drain()

    # test controls

    def silence(self, *vehicle_ids: VehicleId, up: bool = True, down: bool = True) -> None:
        """Cut these vehicles off: they receive nothing (up), and nothing is received from them (down)."""
        self._deaf |= set(vehicle_ids if up else ())
        self._mute |= set(vehicle_ids if down else ())

    def restore(self, *vehicle_ids: VehicleId) -> None:
        """End the silence in both directions."""
        self._deaf -= set(vehicle_ids)
        self._mute -= set(vehicle_ids)

    def is_silent(self, vehicle_id: VehicleId) -> bool:
        """Whether nothing is received from this vehicle."""
        return vehicle_id in self._mute

    def autopilot(self, vehicle_id: VehicleId) -> Autopilot:
        """The fake autopilot."""
        return self._fleet.autopilots[self._row[self._system_ids[vehicle_id]]]

    def pilot(self, vehicle_id: VehicleId, mode: PilotMode) -> None:
        """Change the mode by the vehicle's remote control, which uses no link."""
        self.autopilot(vehicle_id).change_mode(mode)

    # its parts

    def _post(self, vehicle_id: VehicleId, message: Any) -> None:
        frame = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        self._uplink.append((vehicle_id, frame))

    def _post_to_all(self, message: Any) -> None:
        for vehicle_id in self._system_ids:
            self._post(vehicle_id, message)

    def _post_long(self, vehicle_id: VehicleId, command: int, *values: float) -> None:
        filled = (*values, *(0.0,) * (7 - len(values)))
        target = self._system_ids[vehicle_id]
        self._post(vehicle_id, common.MAVLink_command_long_message(target, 1, command, 0, *filled))

    def _ask_for_less(self) -> None:
        """Send SET_MESSAGE_INTERVAL as the production links do, but stop the messages that no test reads."""
        rates_hz = {**rates.desired(StreamSettings()), **dict.fromkeys(UNREAD, 0.0)}
        for vehicle_id in self._system_ids:
            for message_id, rate_hz in rates_hz.items():
                interval_us = 1e6 / rate_hz if rate_hz else -1
                self._post_long(vehicle_id, common.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)

    def _send_setpoint(self, vehicle_id: VehicleId, velocity: Array, yaw_rad: float, now_s: float) -> None:
        north_m_s, east_m_s, down_m_s = velocity.tolist()
        vectors = (0.0, 0.0, 0.0, north_m_s, east_m_s, down_m_s, 0.0, 0.0, 0.0)
        target = self._system_ids[vehicle_id]
        message = common.MAVLink_set_position_target_local_ned_message(
            0, target, 1, common.MAV_FRAME_LOCAL_NED, VELOCITY_AND_YAW, *vectors, yaw_rad, 0.0
        )
        self._post(vehicle_id, message)
        self._setpoint_s[vehicle_id] = now_s
        self.sent[vehicle_id].append(SentSetpoint(now_s, (north_m_s, east_m_s, down_m_s), yaw_rad))

    def _post_command(self, command: Command, received: Receiver) -> None:
        match command.verb:
            case Verb.ARM | Verb.DISARM:
                desired = float(command.verb is Verb.ARM)
                self._post_long(command.vehicle_id, common.MAV_CMD_COMPONENT_ARM_DISARM, desired)
            case Verb.TAKEOFF:
                top_m = received.motion[2] + command.height_m
                anywhere = (0.0, 0.0, 0.0, nan, nan, nan)
                self._post_long(command.vehicle_id, common.MAV_CMD_NAV_TAKEOFF, *anywhere, top_m)
            case Verb.LAND:
                self._post_long(command.vehicle_id, common.MAV_CMD_NAV_LAND)
            case _:
                self._post_long(
                    command.vehicle_id, common.MAV_CMD_DO_SET_MODE, 129.0, *MODE_NUMBERS[command.verb]
                )

    def _refuse_the_impossible(self, command: Command, received: Receiver, now_s: float) -> None:
        fed = now_s - self._setpoint_s[command.vehicle_id] <= self._setpoint_timeout_s
        if command.verb is Verb.OFFBOARD and not fed:
            raise CommandError(f"{command.vehicle_id}: offboard refused: no setpoints are flowing to it")
        if command.verb is Verb.TAKEOFF and not received.armed:
            raise CommandError(f"{command.vehicle_id}: takeoff while disarmed; arm it first")

    async def _kill(self, command: Command, received: Receiver) -> None:
        loop = asyncio.get_running_loop()
        began_s, target = loop.time(), self._system_ids[command.vehicle_id]
        while loop.time() - began_s < CONFIRM_S:
            system, component = STATION
            frame = kill_frame(target, sequence=0, source_system=system, source_component=component)
            self._uplink.append((command.vehicle_id, frame))
            await news(received, KILL_REPEAT_S)
            if received.heartbeat_time_s > began_s and not received.armed:
                return
        raise CommandError(failure(command, received, began_s))

    def _deliver(self) -> None:
        """Each vehicle has its own link; frames on a link with a fault pass through the fault injector."""
        now_s, arrived = asyncio.get_running_loop().time(), []
        for vehicle_id, frame in self._uplink:
            row = self._row[self._system_ids[vehicle_id]]
            channel = self._broken().get(row)
            if vehicle_id in self._deaf:
                continue
            if channel is None:
                arrived.append((row, frame))
            else:
                channel.into.put(frame, None, now_s)  # type: ignore[arg-type]  # its source is not used
        for row, channel in self._broken().items():
            arrived += [(row, frame) for frame, _ in channel.into.take(now_s)]
        self._fleet.receiver.hear(arrived)
        self._uplink.clear()

    def _broken(self) -> Mapping[int, Channel[Origin]]:
        return {} if self.fault_injector is None else self.fault_injector.broken

    def _listen(self, now_s: float) -> None:
        self.hear(self._fleet.take_frames(), now_s)

    def hear(self, stated: Mapping[int, list[bytes]], now_s: float) -> None:
        """Receive messages of the vehicles, by row."""
        for vehicle_id, received in self._receivers.items():
            row = self._row[self._system_ids[vehicle_id]]
            arrived, channel = stated.get(row, []), self._broken().get(row)
            if channel is not None:
                if arrived:
                    channel.out.put(b"".join(arrived), None, now_s)
                arrived = [data for data, _ in channel.out.take(now_s)]
            for data in arrived:
                for frame in () if vehicle_id in self._mute else split(data).frames:
                    if frame.message_id != HEARTBEAT or vehicle_id not in self.beatless:
                        received.take(frame, now_s)
                    if frame.message_id == PARAM_VALUE:
                        self._news.take(vehicle_id, *parameter_value(frame))


def system_ids(ids: Collection[VehicleId]) -> dict[VehicleId, int]:
    """1, 2, 3 ... in order."""
    return {vehicle_id: place for place, vehicle_id in enumerate(ids, start=1)}
