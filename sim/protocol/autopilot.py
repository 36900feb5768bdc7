"""One vehicle's side of the protocol, sans-I/O: messages in, answers out.

Imitates PX4 v1.16.1 as measured (FACTS, section 3). What the vehicle does by itself is computed for the whole
fleet at once (sim.fleet); this is a view of one row of its state.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

from pymavlink.dialects.v20 import common

from gcs.sim.protocol import reports
from gcs.sim.protocol.commands import Command, execute
from gcs.sim.protocol.frames import AUTOPILOT_COMPONENT
from gcs.sim.vehicle import px4
from gcs.sim.vehicle.commander import CRITICAL, INFO, Commander, Result
from gcs.sim.vehicle.state import NO_MODE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from gcs.sim.protocol.frames import Message
    from gcs.sim.protocol.streams import Item, Outbox, Schedule
    from gcs.sim.vehicle.px4 import Mode, Quirks
    from gcs.sim.vehicle.state import State

MODE_RESULT_AFTER_S = 0.008  # item 3: recorded 6 to 15 ms
SECOND_PARAMETER_AFTER_S = 0.015  # PX4 answers PARAM_SET, then announces the change: recorded
GCS_SILENT_AFTER_S = 2.5
TEXT_LENGTH = 50


@dataclass(frozen=True, slots=True)
class Shared:
    """Objects that the autopilots of a fleet share."""

    state: State
    schedule: Schedule
    outbox: Outbox
    quirks: Quirks
    set_home: Callable[[int], None]
    reboot: Callable[[int], None]


class Autopilot:
    """PX4's protocol for one vehicle."""

    def __init__(self, shared: Shared, row: int, parameters: px4.Parameters) -> None:
        """Represent row `row` of the fleet's state; from now on this vehicle owns the parameters."""
        self.row = row
        self.parameters = parameters
        self._shared = shared
        self._state = shared.state
        self.commander = Commander(
            shared.state, row, parameters, shared.quirks, self._post_text, self._announce
        )
        self._text_id = 0

    @property
    def system_id(self) -> int:
        """1 to 250, unique in its namespace."""
        return int(self._state.system_id[self.row])

    @property
    def yaw_rad(self) -> float:
        """Heading from north, clockwise."""
        return float(self._state.yaw_rad[self.row])

    def receive(self, message: Message) -> None:
        """Execute or answer a message for this vehicle; unknown ones change nothing."""
        handler = self._HANDLERS.get(message.get_type())
        if handler is not None and not self.is_sender(message):
            handler(self, message)

    def is_sender(self, message: Message) -> bool:
        """Whether it claims to come from this autopilot itself: ignored, as by PX4.

        Another component with its system id is accepted: vehicle 245 accepts a ground station 245/190.
        """
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return bool(sender == (self.system_id, AUTOPILOT_COMPONENT))

    def reply(self, item: Item, after_s: float = 0.0) -> None:
        """Queue an answer: a message, or the id of a report."""
        self._shared.outbox.post(self.row, item, self._state.now_s + after_s)

    def arm(self, *, force: bool = False) -> Result:
        """Arm; the present position becomes home."""
        was_armed = self.commander.armed
        result = self.commander.arm(force=force)
        if self.commander.armed and not was_armed:
            self._shared.set_home(self.row)
        return result

    def change_mode(self, mode: Mode) -> Result:
        """Change the mode; a request for the same mode sets a new target."""
        result = self.commander.change_mode(mode)
        if result is Result.ACCEPTED:
            self._forget_target()
        return result

    def take_off(self, altitude_amsl_m: float | None) -> Result:
        """Take off, now or at the next arming."""
        result = self.commander.take_off(altitude_amsl_m)
        self._forget_target()
        return result

    def reboot(self) -> Result:
        """Reboot by command: denied while armed, as by PX4."""
        if self.commander.armed:
            return Result.DENIED
        self._shared.reboot(self.row)
        return Result.ACCEPTED

    def forget(self) -> None:
        """Boot: clear texts and pending answers."""
        self._text_id = 0
        self._shared.outbox.forget(self.row)

    def available(self, message_id: int) -> bool:
        """Whether that report can be sent now."""
        return message_id in reports.ALWAYS or (
            message_id in reports.WITH_A_FIX and bool(self._state.home_set[self.row])
        )

    def interval_s(self, message_id: int) -> float | None:
        """The interval of a stream, or None while it is not sent."""
        return self._shared.schedule.interval_s(self.row, message_id)

    def set_interval(self, message_id: int, interval_s: float | None) -> None:
        """Send at that interval from now on; None stops the stream."""
        self._shared.schedule.set_interval(self.row, message_id, interval_s, self._state.now_s)

    def default_interval_s(self, message_id: int) -> float | None:
        """The interval after booting."""
        return self._shared.schedule.default_s(message_id)

    def parameter(self, name: str) -> Message:
        """A PARAM_VALUE."""
        value = px4.encoded_value(name, self.parameters[name])
        return common.MAVLink_param_value_message(
            name.encode("ascii"), value, px4.kind(name), len(self.parameters), px4.index(name)
        )

    def report_invalid(self) -> None:
        """Item 10: PX4 reports a setpoint with every axis ignored, and the loss failsafe follows."""
        self._post_text(CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid\t")

    def _forget_target(self) -> None:
        self._state.guided_mode[self.row] = NO_MODE

    def _announce(self) -> None:
        """Mode or arming has changed; item 9: PX4 reports it in the next HEARTBEAT."""
        if not self._shared.quirks.late_heartbeat:
            self.reply(common.MAVLINK_MSG_ID_HEARTBEAT)

    def _receive_heartbeat(self, message: Message) -> None:
        if message.type == common.MAV_TYPE_GCS:
            regained = not self._gcs_listens()
            self._state.station_s[self.row] = self._state.now_s
            if regained:
                self._post_text(INFO, "GCS connection regained\t")

    def _receive_command(self, message: Message) -> None:
        """COMMAND_LONG and COMMAND_INT; a mode change is acknowledged twice (item 3)."""
        if message.get_type() == "COMMAND_LONG":
            place: tuple[float, float, float] = (message.param5, message.param6, message.param7)
        else:
            place = (message.x * 1e-7, message.y * 1e-7, message.z)
        command = Command(
            message.command, (message.param1, message.param2, message.param3, message.param4, *place)
        )
        result = execute(self, command)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        after_s = 0.0
        if command.number == common.MAV_CMD_DO_SET_MODE and self._shared.quirks.double_ack:
            self.reply(
                common.MAVLink_command_ack_message(command.number, int(Result.ACCEPTED), 0, 0, *sender)
            )
            after_s = MODE_RESULT_AFTER_S
        self.reply(common.MAVLink_command_ack_message(command.number, int(result), 0, 0, *sender), after_s)

    def _receive_ping(self, message: Message) -> None:
        """Echo a request; an answer to a ping of ours needs no reply."""
        if message.target_system == 0:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self.reply(common.MAVLink_ping_message(message.time_usec, message.seq, *sender))

    def _receive_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            boot_ns = self._state.boot_ms(self.row) * 1_000_000
            self.reply(common.MAVLink_timesync_message(boot_ns, message.ts1))

    def _receive_parameter_read(self, message: Message) -> None:
        """By index, or by name where the index is -1; there is no answer for an unknown parameter."""
        by_name = message.param_index < 0
        name = message.param_id if by_name else px4.name_at(message.param_index)
        if name is not None and name in self.parameters:
            self.reply(self.parameter(name))

    def _receive_parameter_list(self, _message: Message) -> None:
        self._shared.outbox.list_parameters(self.row, self.parameters.names())

    def _receive_parameter_set(self, message: Message) -> None:
        """Answer with the resulting value; only a change is announced a second time."""
        name = message.param_id
        if name not in self.parameters:
            return
        try:
            self.parameters.set(name, px4.decoded_value(name, message.param_type, message.param_value))
        except px4.ParameterError:
            self.reply(self.parameter(name))
            return
        self.reply(self.parameter(name))
        self.reply(self.parameter(name), SECOND_PARAMETER_AFTER_S)

    def _gcs_listens(self) -> bool:
        return bool(self._state.now_s - self._state.station_s[self.row] <= GCS_SILENT_AFTER_S)

    def _post_text(self, severity: int, text: str) -> None:
        """Item 8: in chunks of 50, and only with a recent heartbeat of a ground station."""
        if self._shared.quirks.quiet_texts and not self._gcs_listens():
            return
        raw = text.encode("ascii")
        for chunk, start in enumerate(range(0, len(raw), TEXT_LENGTH)):
            part = raw[start : start + TEXT_LENGTH]
            self.reply(common.MAVLink_statustext_message(severity, part, self._text_id, chunk))
        self._text_id = (self._text_id + 1) % 65536

    _HANDLERS: ClassVar[Mapping[str, Callable[[Autopilot, Message], None]]] = MappingProxyType(
        {
            "HEARTBEAT": _receive_heartbeat,
            "COMMAND_LONG": _receive_command,
            "COMMAND_INT": _receive_command,
            "PING": _receive_ping,
            "TIMESYNC": _receive_timesync,
            "PARAM_REQUEST_READ": _receive_parameter_read,
            "PARAM_REQUEST_LIST": _receive_parameter_list,
            "PARAM_SET": _receive_parameter_set,
        }
    )
