"""One vehicle's autopilot, sans-I/O: datagrams in, frames and a velocity demand out, time injected.

Imitates PX4 v1.16.1 as measured (FACTS, section 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

from pymavlink.dialects.v20 import common

from sim import params, reports, setpoints
from sim.battery import Battery
from sim.commander import CRITICAL, INFO, Commander, Result
from sim.commands import Command, execute
from sim.guidance import Guidance
from sim.mavlink import AUTOPILOT_COMPONENT, Codec
from sim.outbox import Outbox
from sim.streams import Streams

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import numpy as np

    from sim.mavlink import Message
    from sim.modes import Mode
    from sim.sensed import Sensed, Triple

READY_AFTER_S = (4.0, 6.0)  # item 2
FIX_BEFORE_READY_S = 1.0
CLOCK_LOSS = (0.01, 0.02)  # item 12: the boot clock is slower than the wall's
MODE_RESULT_AFTER_S = 0.008  # item 3: recorded 6 to 15 ms
SECOND_PARAMETER_AFTER_S = 0.015  # PX4 answers PARAM_SET, then announces the change: recorded
GCS_SILENT_AFTER_S = 2.5
TEXT_LENGTH = 50


@dataclass(frozen=True, slots=True)
class Demand:
    """What the autopilot asks of the vehicle."""

    velocity_m_s: Triple  # local NED
    powered: bool  # False: the motors stand still


class Autopilot:
    """PX4's behaviour for one vehicle. Feed receive and advance with one monotonic clock."""

    def __init__(
        self,
        system_id: int,
        parameters: params.Parameters,
        *,
        now_s: float,
        random: np.random.Generator,
        unix_at_start_s: float = 0.0,
        yaw_rad: float = 0.0,
        endurance_s: float = 1200.0,
    ) -> None:
        """Boot at now_s.

        Args:
            system_id: 1 to 250.
            parameters: owned by this vehicle from now on.
            now_s: the caller's clock.
            random: decides the start-up time, the clock's error and the streams' phases.
            unix_at_start_s: what a wall clock shows at now_s.
            yaw_rad: where the nose points.
            endurance_s: how long a full battery carries the vehicle.
        """
        self.system_id = system_id
        self.parameters = parameters
        self._boot_s = now_s
        self._unix_at_start_s = unix_at_start_s
        self._clock_rate = 1.0 - random.uniform(*CLOCK_LOSS)
        self.ready_at_s = now_s + random.uniform(*READY_AFTER_S)
        self.fix_at_s = self.ready_at_s - FIX_BEFORE_READY_S
        self.commander = Commander(parameters, ready_at_s=self.ready_at_s)
        self.battery = Battery(parameters, endurance_s)
        self.streams = Streams(now_s, random)
        self._guidance = Guidance(parameters, yaw_rad)
        self._codec = Codec(system_id)
        self._outbox = Outbox()
        self._now_s = now_s
        self._sensed: Sensed | None = None
        self._home: reports.Home | None = None
        self._demanded_m_s: Triple = (0.0, 0.0, 0.0)
        self._gcs_seen_s = -math.inf
        self._text_id = 0
        self._pings = 0

    @property
    def yaw_rad(self) -> float:
        """Where the nose points, from north, clockwise."""
        return self._guidance.yaw_rad

    def receive(self, datagram: bytes, now_s: float) -> bool:
        """Hear a datagram. Bad bytes, other vehicles' messages and unknown ones change nothing.

        Returns: whether there was a sound frame in it, whoever it was for. Replies come out of take_frames.
        """
        messages = self._codec.decode(datagram)
        self._now_s = max(self._now_s, now_s)
        for message in messages:
            handler = self._HANDLERS.get(message.get_type())
            if handler is not None and message.get_srcSystem() != self.system_id and self._addressed(message):
                handler(self, message)
        return bool(messages)

    def advance(self, now_s: float, dt_s: float, sensed: Sensed | None) -> Demand:
        """Let dt_s pass, up to now_s.

        Args:
            now_s: the time it is now.
            dt_s: since the last call.
            sensed: the estimate, or None before the first fix.
        """
        self._now_s = now_s
        self._sensed = sensed
        if sensed is None:
            return Demand((0.0, 0.0, 0.0), powered=False)
        if self._home is None:
            self._set_home(sensed)
        velocity_m_s = self._guidance.velocity(self.commander, sensed, now_s, dt_s)
        self.commander.update(now_s, sensed, climb_m_s=-velocity_m_s[2], charge=self.battery.charge_state)
        self._guidance.turn(self.commander, dt_s)
        if self.commander.powered:
            self.battery.drain(dt_s)
        self._demanded_m_s = velocity_m_s if self.commander.armed else (math.nan,) * 3
        return Demand(velocity_m_s, powered=self.commander.powered)

    def take_frames(self, now_s: float, *, streams: bool = True) -> list[bytes]:
        """The frames to send now: replies and texts, and the streams that are due unless not wanted."""
        self._now_s = now_s
        self._post_texts()
        messages = self._outbox.take(now_s)
        if streams:
            messages += [self._parameter(name) for name in self._outbox.take_parameters()]
            due = self.streams.due(now_s)
            if due:
                self._pings += common.MAVLINK_MSG_ID_PING in due
                snapshot = self.snapshot(now_s)
                reported = (reports.report(message_id, snapshot) for message_id in due)
                messages += [message for message in reported if message is not None]
        return [self._codec.encode(message) for message in messages]

    def snapshot(self, now_s: float) -> reports.Snapshot:
        """The state that messages are made from."""
        return reports.Snapshot(
            boot_ms=self._boot_ms(now_s),
            unix_s=self._unix_at_start_s + now_s - self._boot_s,
            sensed=self._sensed,
            home=self._home,
            commander=self.commander,
            battery=self.battery,
            yaw_rad=self.yaw_rad,
            demanded_m_s=self._demanded_m_s,
            ping=self._pings,
        )

    def reply(self, message: Message, after_s: float = 0.0) -> None:
        """Queue an answer."""
        self._outbox.post(message, self._now_s + after_s)

    def arm(self, now_s: float, *, force: bool = False) -> Result:
        """Arm; home is where it happens."""
        was_armed = self.commander.armed
        result = self.commander.arm(now_s, force=force)
        if self.commander.armed and not was_armed and self._sensed is not None:
            self._set_home(self._sensed)
        return result

    def change_mode(self, mode: Mode, now_s: float) -> Result:
        """Change the mode; asking for the same one again takes a new target."""
        result = self.commander.change_mode(mode, now_s)
        if result is Result.ACCEPTED:
            self._guidance.reset()
        return result

    def take_off(self, altitude_amsl_m: float | None, now_s: float) -> Result:
        """Take off, now or at the next arming."""
        result = self.commander.take_off(altitude_amsl_m, now_s)
        self._guidance.reset()
        return result

    def _set_home(self, sensed: Sensed) -> None:
        self._home = reports.Home(
            position_m=sensed.position_m,
            latitude_deg=sensed.latitude_deg,
            longitude_deg=sensed.longitude_deg,
            altitude_amsl_m=sensed.altitude_amsl_m,
            yaw_rad=self.yaw_rad,
            boot_ms=self._boot_ms(self._now_s),
        )
        self._guidance.home_m = sensed.position_m

    def _boot_ms(self, now_s: float) -> int:
        return int((now_s - self._boot_s) * self._clock_rate * 1e3)

    def _addressed(self, message: Message) -> bool:
        """Whether a message is for this autopilot or for everyone; those without an address are."""
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self.system_id) and component in (0, AUTOPILOT_COMPONENT)

    def _hear_heartbeat(self, message: Message) -> None:
        if message.type == common.MAV_TYPE_GCS:
            regained = not self._gcs_listens()
            self._gcs_seen_s = self._now_s
            if regained:
                self._post_text(INFO, "GCS connection regained\t")

    def _hear_setpoint(self, message: Message) -> None:
        setpoint = setpoints.read(message, self.yaw_rad)
        if setpoint is None:
            return
        if not setpoint.commands_something:
            self._say_invalid()
            return
        self.commander.hear_setpoint(self._now_s)
        self._guidance.setpoint = setpoint

    def _say_invalid(self) -> None:
        """Item 10: with every axis ignored PX4 complains, and the loss failsafe follows."""
        self._post_text(CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid\t")

    def _hear_command(self, message: Message) -> None:
        """COMMAND_LONG and COMMAND_INT; a mode change is acknowledged twice (item 3)."""
        if message.get_type() == "COMMAND_LONG":
            place: tuple[float, float, float] = (message.param5, message.param6, message.param7)
        else:
            place = (message.x * 1e-7, message.y * 1e-7, message.z)
        command = Command(
            message.command, (message.param1, message.param2, message.param3, message.param4, *place)
        )
        result = execute(self, command, self._now_s)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        after_s = 0.0
        if command.number == common.MAV_CMD_DO_SET_MODE:
            self.reply(
                common.MAVLink_command_ack_message(command.number, int(Result.ACCEPTED), 0, 0, *sender)
            )
            after_s = MODE_RESULT_AFTER_S
        self.reply(common.MAVLink_command_ack_message(command.number, int(result), 0, 0, *sender), after_s)

    def _hear_ping(self, message: Message) -> None:
        """Echo a request; an answer to one of ours needs nothing."""
        if message.target_system == 0:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self.reply(common.MAVLink_ping_message(message.time_usec, message.seq, *sender))

    def _hear_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            self.reply(common.MAVLink_timesync_message(self._boot_ms(self._now_s) * 1_000_000, message.ts1))

    def _hear_parameter_read(self, message: Message) -> None:
        """By index, or by name where the index is -1; what does not exist is not answered."""
        by_name = message.param_index < 0
        name = message.param_id if by_name else params.name_at(message.param_index)
        if name is not None and name in self.parameters:
            self.reply(self._parameter(name))

    def _hear_parameter_list(self, _message: Message) -> None:
        self._outbox.list_parameters(self.parameters.names())

    def _hear_parameter_set(self, message: Message) -> None:
        """Answered with the value that holds afterwards; only a change is announced again."""
        name = message.param_id
        if name not in self.parameters:
            return
        try:
            self.parameters.set(name, params.from_wire(name, message.param_type, message.param_value))
        except params.ParameterError:
            self.reply(self._parameter(name))
            return
        self.reply(self._parameter(name))
        self.reply(self._parameter(name), SECOND_PARAMETER_AFTER_S)

    def _parameter(self, name: str) -> Message:
        value = params.to_wire(name, self.parameters[name])
        return common.MAVLink_param_value_message(
            name.encode("ascii"), value, params.kind(name), len(self.parameters), params.index(name)
        )

    def _gcs_listens(self) -> bool:
        return self._now_s - self._gcs_seen_s <= GCS_SILENT_AFTER_S

    def _post_texts(self) -> None:
        for severity, text in self.commander.take_texts():
            self._post_text(severity, text)

    def _post_text(self, severity: int, text: str) -> None:
        """Item 8: in chunks of 50, and only where a ground station has been heard of late."""
        if not self._gcs_listens():
            return
        raw = text.encode("ascii")
        for chunk, start in enumerate(range(0, len(raw), TEXT_LENGTH)):
            part = raw[start : start + TEXT_LENGTH]
            self.reply(common.MAVLink_statustext_message(severity, part, self._text_id, chunk))
        self._text_id = (self._text_id + 1) % 65536

    _HANDLERS: ClassVar[Mapping[str, Callable[[Autopilot, Message], None]]] = MappingProxyType(
        {
            "HEARTBEAT": _hear_heartbeat,
            "SET_POSITION_TARGET_LOCAL_NED": _hear_setpoint,
            "COMMAND_LONG": _hear_command,
            "COMMAND_INT": _hear_command,
            "PING": _hear_ping,
            "TIMESYNC": _hear_timesync,
            "PARAM_REQUEST_READ": _hear_parameter_read,
            "PARAM_REQUEST_LIST": _hear_parameter_list,
            "PARAM_SET": _hear_parameter_set,
        }
    )
