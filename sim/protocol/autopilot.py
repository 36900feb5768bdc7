"""One vehicle's side of the protocol, sans-I/O: messages in, answers out.

Imitates PX4 v1.16.1 as measured (FACTS, section 3). What the vehicle does by itself is computed for the whole
fleet at once (sim.fleet); this is a view of one row of its state.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

from pymavlink.dialects.v20 import common

from gcs.sim.protocol import fences, reports
from gcs.sim.protocol.base import MAX_MESSAGE_ID, BaseAutopilot, Params
from gcs.sim.protocol.equipment import MESSAGES, SET_ACTUATOR
from gcs.sim.protocol.frames import Message
from gcs.sim.protocol.streams import Outbox, Schedule
from gcs.sim.vehicle import px4
from gcs.sim.vehicle.commander import CRITICAL, INFO, Commander, Result
from gcs.sim.vehicle.parameters import ParameterError
from gcs.sim.vehicle.px4 import Mode, Quirks
from gcs.sim.vehicle.state import NO_MODE, State
from gcs.sim.vehicle.versions import Version

MODE_RESULT_AFTER_S = 0.008  # item 3: recorded 6 to 15 ms
SECOND_PARAMETER_AFTER_S = 0.015  # PX4 answers PARAM_SET, then announces the change: recorded
GCS_SILENT_AFTER_S = 2.5
TEXT_LENGTH = 50
FORCE = 21196  # param2 that overrides the checks: arms in any case, kills in the air
CUSTOM_MODE_ENABLED = 1
AUTOPILOT_VERSION_ID, PROTOCOL_VERSION_ID = 148, 300
CAPABILITIES = (  # only those that hold here
    common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | common.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | common.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)


@dataclass(frozen=True, slots=True)
class Shared:
    """Objects that the autopilots of a fleet share."""

    state: State
    schedule: Schedule
    outbox: Outbox
    quirks: Quirks
    version: Version
    set_home: Callable[[int], None]
    reboot: Callable[[int], None]
    place: Callable[[int], tuple[float, float]]  # of a row, as estimated: latitude, longitude
    transfers: set[fences.Fences] = field(default_factory=set)  # of fences, under way


class Autopilot(BaseAutopilot):
    """PX4's protocol for one vehicle."""

    def __init__(self, shared: Shared, row: int, parameters: px4.Parameters) -> None:
        """Represent row `row` of the fleet's state; from now on this vehicle owns the parameters."""
        super().__init__(shared.state, row, shared.outbox)
        self.parameters: px4.Parameters = parameters
        self._shared = shared
        self._commander = Commander(
            *(shared.state, row, parameters, shared.quirks, shared.version.release),
            *(self._post_text, self._announce),
        )
        self._text_id = 0
        self.fences: fences.Fences = fences.Px4Fences(
            self.reply, self._post_text, shared.transfers, shared.version.release, self._must_contain
        )

    @property
    def commander(self) -> Commander:
        """PX4's commander of this vehicle."""
        return self._commander

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
        result = self.commander.take_off(altitude_amsl_m)
        self._forget_target()
        return result

    def forget(self) -> None:
        """Drop what has not been sent yet."""
        self._text_id = 0
        self.fences.reload()
        super().forget()

    def parameter(self, name: str) -> Message:
        listed = self.parameters.listed
        kind = listed.kind(name)
        value = px4.encoded_value(kind, self.parameters.own(name))
        return common.MAVLink_param_value_message(
            name.encode("ascii"), value, kind, len(listed), listed.indices[name]
        )

    def report_invalid(self) -> None:
        """Item 10: PX4 reports a setpoint with every axis ignored, and the loss failsafe follows."""
        self._post_text(CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid\t")

    def _must_contain(self) -> list[tuple[str, tuple[float, float]]]:
        """Places that an area of a fence must allow when it is loaded, with the texts of refusals."""
        state, row = self._state, self.row
        places = list[tuple[str, tuple[float, float]]]()
        if state.home_set[row]:
            home = state.home_place[row]
            places.append((fences.NO_HOME, (float(home[0]), float(home[1]))))
        if self.parameters["GF_ACTION"] and not state.landed[row]:
            places.append((fences.NOT_HERE, self._shared.place(row)))
        return places

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
        params = (message.param1, message.param2, message.param3, message.param4, *place)
        number, after_s = message.command, 0.0
        execute = self._COMMANDS.get(number)
        result = Result.UNSUPPORTED if execute is None else execute(self, params)
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if number == common.MAV_CMD_DO_SET_MODE and self._shared.quirks.double_ack:
            self.reply(common.MAVLink_command_ack_message(number, int(Result.ACCEPTED), 0, 0, *sender))
            after_s = MODE_RESULT_AFTER_S
        self.reply(common.MAVLink_command_ack_message(number, int(result), 0, 0, *sender), after_s)

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
        names = self.parameters.listed.names
        if message.param_index < 0 and message.param_id in self.parameters.listed:
            self.reply(self.parameter(message.param_id))
        elif 0 <= message.param_index < len(names):
            self.reply(self.parameter(names[message.param_index]))

    def _receive_parameter_set(self, message: Message) -> None:
        """Answer with the resulting value; only a change is announced a second time."""
        name = message.param_id
        if name not in self.parameters.listed:
            return
        kind = self.parameters.listed.kind(name)
        try:
            self.parameters.set(name, px4.decoded_value(kind, message.param_type, message.param_value))
        except ParameterError:
            self.reply(self.parameter(name))
            return
        self.reply(self.parameter(name))
        self.reply(self.parameter(name), SECOND_PARAMETER_AFTER_S)

    def _set_actuator(self, params: Params) -> Result:
        return Result.ACCEPTED if self.equipment.set_actuator(params) else Result.DENIED

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

    # the MAV_CMD commands that it knows

    def _arm_or_disarm(self, params: Params) -> Result:
        desired, force = params[0], params[1] == FORCE
        if desired == 1.0:
            return self.arm(force=force)
        return self.commander.disarm(force=force) if desired == 0.0 else Result.DENIED

    def _terminate(self, params: Params) -> Result:
        if params[0] > 0.5:
            self.commander.terminate()
        return Result.ACCEPTED

    def _set_mode(self, params: Params) -> Result:
        base, main, sub = params[:3]
        if not all(map(math.isfinite, params[:3])) or not int(base) & CUSTOM_MODE_ENABLED:
            return Result.DENIED
        mode = Mode.find(int(main), int(sub))
        return Result.DENIED if mode is None else self.change_mode(mode)

    def _reboot(self, params: Params) -> Result:
        """1 reboots, denied while armed; 0 is accepted, and PX4 denies all other values."""
        if params[0] == 0.0:
            return Result.ACCEPTED
        if params[0] != 1.0 or self.commander.armed:
            return Result.DENIED
        self._shared.reboot(self.row)
        return Result.ACCEPTED

    def _set_interval(self, params: Params) -> Result:
        """SET_MESSAGE_INTERVAL: microseconds; 0 is the default rate, -1 stops."""
        message_id, interval_us = _message_id(params), params[1]
        if message_id not in reports.ALL or not math.isfinite(interval_us):
            return Result.FAILED
        interval_s = interval_us * 1e-6 if interval_us > 0 else None
        if interval_us == 0:
            interval_s = self._shared.schedule.default_s.get(message_id)
        self._shared.schedule.set_interval(self.row, message_id, interval_s, self._state.now_s)
        return Result.ACCEPTED

    def _get_interval(self, params: Params) -> Result:
        message_id = _message_id(params)
        if message_id is None:
            return Result.DENIED
        exists = message_id in reports.ALL
        interval_s = self._shared.schedule.interval_s(self.row, message_id) if exists else None
        interval_us = -1 if interval_s is None else round(interval_s * 1e6)
        self.reply(common.MAVLink_message_interval_message(message_id, interval_us))
        return Result.ACCEPTED

    def _request(self, params: Params) -> Result:
        message_id, has_home = _message_id(params), bool(self._state.home_set[self.row])
        if message_id == AUTOPILOT_VERSION_ID:
            return self._request_version(params)
        if message_id == PROTOCOL_VERSION_ID:
            self.reply(common.MAVLink_protocol_version_message(200, 100, 200, [0] * 8, [0] * 8))
        elif message_id in (reports.ALL if has_home else reports.ALWAYS):
            self.reply(message_id)
        else:
            return Result.DENIED
        return Result.ACCEPTED

    def _request_version(self, _params: Params) -> Result:
        """AUTOPILOT_VERSION; the uid is the system id, so that vehicles can be distinguished."""
        none, number = [0] * 8, self._shared.version.flight_sw_version
        self.reply(
            common.MAVLink_autopilot_version_message(
                CAPABILITIES, number, number, 0, 0, none, none, none, 0, 0, self.system_id
            )
        )
        return Result.ACCEPTED

    def _request_capabilities(self, params: Params) -> Result:
        """REQUEST_AUTOPILOT_CAPABILITIES, deprecated and still in use; gone in v1.18."""
        if self._shared.version.release >= (1, 18):
            return Result.UNSUPPORTED
        return self._request_version(params)

    _COMMANDS: ClassVar[Mapping[int, Callable[["Autopilot", Params], Result]]] = MappingProxyType(
        {
            common.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda self, _: self.change_mode(Mode.RETURN),
            common.MAV_CMD_NAV_LAND: lambda self, _: self.change_mode(Mode.LAND),
            common.MAV_CMD_NAV_TAKEOFF: lambda self, params: self.take_off(
                params[6] if math.isfinite(params[6]) else None
            ),
            common.MAV_CMD_DO_SET_MODE: _set_mode,
            common.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
            SET_ACTUATOR: _set_actuator,
            common.MAV_CMD_COMPONENT_ARM_DISARM: _arm_or_disarm,
            common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
            common.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
            common.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
            common.MAV_CMD_REQUEST_MESSAGE: _request,
            520: _request_capabilities,
        }
    )

    handlers: ClassVar[Mapping[str, Callable[..., None]]] = MappingProxyType(
        {
            "HEARTBEAT": _receive_heartbeat,
            "COMMAND_LONG": _receive_command,
            "COMMAND_INT": _receive_command,
            **dict.fromkeys(MESSAGES, lambda self, each: self.equipment.receive(each, self.system_id)),
            **dict.fromkeys(fences.MESSAGES, lambda self, each: self.fences.receive(each, self._state.now_s)),
            "PING": _receive_ping,
            "TIMESYNC": _receive_timesync,
            "PARAM_REQUEST_READ": _receive_parameter_read,
            "PARAM_REQUEST_LIST": lambda self, _: self._shared.outbox.listed.update(
                {self.row: deque(self.parameters.listed.names)}
            ),
            "PARAM_SET": _receive_parameter_set,
        }
    )


def _message_id(params: Params) -> int | None:
    return int(params[0]) if math.isfinite(params[0]) and 0 <= params[0] < MAX_MESSAGE_ID else None
