"""One vehicle's side of the protocol, sans-I/O: messages in, answers out. ArduCopter 4.1-dev as measured."""

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from pymavlink.dialects.v20 import common

from gcs.sim.autopilots.ardupilot import reports
from gcs.sim.autopilots.ardupilot.commander import (
    FORCE_ARM,
    FORCE_DISARM,
    INFO,
    Commander,
)
from gcs.sim.autopilots.ardupilot.modes import Mode
from gcs.sim.autopilots.ardupilot.parameters import NO_INDEX, Parameters
from gcs.sim.autopilots.ardupilot.power import Batteries
from gcs.sim.autopilots.ardupilot.state import ArduState
from gcs.sim.protocol import fences
from gcs.sim.protocol.base import MAX_MESSAGE_ID, BaseAutopilot, Params
from gcs.sim.protocol.frames import Message
from gcs.sim.protocol.streams import Outbox, Schedule
from gcs.sim.vehicle.commander import Result
from gcs.sim.vehicle.dynamics import Array
from gcs.sim.vehicle.sensors import Sensors
from gcs.sim.vehicle.versions import Version

HEARTBEAT, HOME, ORIGIN, VERSION = 0, 242, 49, 148
STRAY_ACK_S = 0.2  # habit 18
CUSTOM_MODE_ENABLED = 1
HIGHEST_M = 1e4  # of places in commands
FASTEST_S = 0.003  # habit 5: 400 Hz asked, 334 sent
BANNER = ("ArduCopter V{software} (01bdf537)", "3d1219c7c4c5404aaa1f6d2a48adfda4", "Frame: QUAD")
DATA_STREAMS: Mapping[int, tuple[str, tuple[int, ...]]] = MappingProxyType(
    {
        1: ("SR0_RAW_SENS", (129,)),
        2: ("SR0_EXT_STAT", (1, 24, 87, 162)),
        3: ("SR0_RC_CHAN", (36, 65)),
        6: ("SR0_POSITION", (32, 33)),
        10: ("SR0_EXTRA1", (30,)),
        11: ("SR0_EXTRA2", (74,)),
        12: ("SR0_EXTRA3", (2, 147, 193, 241)),
    }
)
"""Parameter and messages by MAV_DATA_STREAM, of those that it sends here (habit 6)."""


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """Objects that the autopilots of a fleet share."""

    state: ArduState
    schedule: Schedule
    outbox: Outbox
    batteries: Batteries
    version: Version
    sensors: Callable[[], Sensors]  # of the newest step
    set_home: Callable[[int], None]
    reboot: Callable[[int], None]
    transfers: set[fences.Fences] = field(default_factory=set)  # of fences, under way


class ArduPilot(BaseAutopilot):
    """ArduCopter's protocol for one vehicle."""

    def __init__(self, shared: Shared, row: int, parameters: Parameters) -> None:
        """Represent row `row` of the fleet's state; from now on this vehicle owns the parameters."""
        super().__init__(shared.state, row, shared.outbox)
        self.parameters: Parameters = parameters
        self._shared = shared
        self._columns = shared.state
        self._commander = Commander(
            shared.state,
            row,
            parameters,
            shared.batteries,
            self._post_text,
            self._send_heartbeat,
            self._move_home,
            shared.version.release,
        )
        about = (self.reply, self._post_text, shared.transfers, shared.version.software)
        self.fences: fences.Fences = fences.ArduPilotFences(*about)

    @property
    def commander(self) -> Commander:
        """Modes, arming and take-off of this vehicle."""
        return self._commander

    def receive(self, message: Message) -> None:
        """Execute or answer a message, if the vehicle accepts its sender (habit 44)."""
        if self.accepts_sender(message.get_srcSystem()):
            self._columns.old_frames[self.row] = False
            super().receive(message)

    def run_transponder(self) -> None:
        """Have the transponder send what is due, and send what ArduPilot reports of it."""
        super().run_transponder()
        columns, row = self._columns, self.row
        if self.transponder is not None:
            columns.odid_reasons[row] = self.transponder.refusal(columns.now_s)
            for severity, text in self.transponder.texts(columns.now_s, float(columns.boot_s[row])):
                self._post_text(severity, text)

    def accepts_sender(self, system_id: int) -> bool:
        """Whether messages of that system count: with SYSID_ENFORCE only those of SYSID_MYGCS."""
        enforced = bool(self.parameters["SYSID_ENFORCE"]) and system_id != self.parameters["SYSID_MYGCS"]
        return not (enforced or self._columns.dead[self.row])

    def parameter(self, name: str, index: int | None = None) -> Message:
        """PARAM_VALUE: the value as a real number (habit 58)."""
        listed = self.parameters.listed
        place = listed.indices[name] if index is None else index
        value, kind = float(self.parameters.own(name)), listed.kind(name)
        return common.MAVLink_param_value_message(name.encode(), value, kind, len(listed), place)

    def _post_text(self, severity: int, text: str) -> None:
        """Texts are sent only on a link on which something has been received: recorded."""
        if not self._columns.old_frames[self.row]:
            self.reply(common.MAVLink_statustext_message(severity, text.encode("ascii"), 0, 0))

    def _send_heartbeat(self) -> None:
        self.reply(HEARTBEAT)

    def _move_home(self) -> None:
        self._shared.set_home(self.row)

    def _acknowledge(self, command: int, result: Result, after_s: float = 0.0) -> None:
        self.reply(common.MAVLink_command_ack_message(command, int(result), 0, 0, 0, 0), after_s)

    def _receive_heartbeat(self, message: Message) -> None:
        if message.get_srcSystem() == self.parameters["SYSID_MYGCS"]:
            self._columns.station_s[self.row] = self._columns.now_s

    def _receive_command(self, message: Message) -> None:
        params = (
            *(message.param1, message.param2, message.param3, message.param4),
            *(message.param5, message.param6, message.param7),
        )
        execute = self._COMMANDS.get(message.command)
        result = Result.UNSUPPORTED if execute is None else execute(self, params)
        self._acknowledge(message.command, result)

    def _receive_command_int(self, message: Message) -> None:
        """Only DO_REPOSITION and DO_SET_HOME are known in this form (habit 16)."""
        place = (message.x * 1e-7, message.y * 1e-7, message.z)
        params = (message.param1, message.param2, message.param3, message.param4, *place)
        result = Result.UNSUPPORTED
        if message.command == common.MAV_CMD_DO_REPOSITION:
            result = self._reposition(place, message.frame)
        elif message.command == common.MAV_CMD_DO_SET_HOME:
            result = self._set_home(params)
        self._acknowledge(message.command, result)

    def _receive_set_mode(self, message: Message) -> None:
        """SET_MODE is acknowledged as command 11 (habit 12)."""
        result = Result.FAILED
        if message.base_mode & CUSTOM_MODE_ENABLED:
            result = self._commander.change_mode(message.custom_mode)
        self._acknowledge(common.MAVLINK_MSG_ID_SET_MODE, result)

    def _receive_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            boot_ns = self._columns.boot_ms(self.row) * 1_000_000
            self.reply(common.MAVLink_timesync_message(boot_ns, message.ts1))

    def _receive_parameter_read(self, message: Message) -> None:
        """By name, answered without an index, or by index; there is no answer for an unknown one."""
        names = self.parameters.listed.names
        if message.param_index < 0 and message.param_id in self.parameters.listed:
            self.reply(self.parameter(message.param_id, NO_INDEX))
        elif 0 <= message.param_index < len(names):
            self.reply(self.parameter(names[message.param_index]))

    def _receive_parameter_list(self, _message: Message) -> None:
        for text in BANNER:
            self._post_text(INFO, text.format(software=self._shared.version.software))
        self._outbox.listed[self.row] = deque(self.parameters.listed.names)

    def _receive_parameter_set(self, message: Message) -> None:
        """Answer with the resulting value, also an unchanged one (habit 59)."""
        if self.parameters.assign(message.param_id, message.param_value):
            self.reply(self.parameter(message.param_id, NO_INDEX))

    def _receive_data_stream(self, message: Message) -> None:
        """REQUEST_DATA_STREAM changes parameters, unlike SET_MESSAGE_INTERVAL (habit 6)."""
        rate_hz = message.req_message_rate if message.start_stop else 0
        streams = DATA_STREAMS if message.req_stream_id == 0 else {message.req_stream_id}
        for name, ids in (DATA_STREAMS[each] for each in streams if each in DATA_STREAMS):
            self.parameters.assign(name, rate_hz)
            for message_id in ids:
                interval_s = 1.0 / rate_hz if rate_hz else None
                self._shared.schedule.set_interval(self.row, message_id, interval_s, self._columns.now_s)

    # the MAV_CMD commands that it knows

    def _arm_or_disarm(self, params: Params) -> Result:
        if params[0] == 1.0:
            return self._commander.arm(force=params[1] == FORCE_ARM)
        if params[0] == 0.0:
            return self._commander.disarm(force=params[1] == FORCE_DISARM)
        return Result.UNSUPPORTED

    def _set_mode(self, params: Params) -> Result:
        if not all(map(math.isfinite, params[:2])) or not int(params[0]) & CUSTOM_MODE_ENABLED:
            return Result.FAILED
        return self._commander.change_mode(params[1])

    def _take_off(self, params: Params) -> Result:
        if not abs(params[6]) <= HIGHEST_M:
            return Result.FAILED
        return self._commander.take_off(params[6], self._shared.sensors().position_m[self.row])

    def _turn(self, params: Params) -> Result:
        """CONDITION_YAW: the heading is kept under setpoints without a yaw (habit 17)."""
        if not math.isfinite(params[0]):
            return Result.FAILED
        start_rad = float(self._columns.yaw_rad[self.row]) if params[3] == 1.0 else 0.0
        self._columns.goal_yaw_rad[self.row] = start_rad + math.radians(params[0])
        return Result.ACCEPTED

    def _reposition(self, place: tuple[float, float, float], frame: int) -> Result:
        """Fly to a place in GUIDED; its height is above home unless the frame is global."""
        if self._commander.mode is not Mode.GUIDED or not _is_place(*place):
            return Result.FAILED
        goal_m = self._local(*place)
        if frame not in {common.MAV_FRAME_GLOBAL, common.MAV_FRAME_GLOBAL_INT}:
            goal_m[2] = self._columns.home_m[self.row, 2] - place[2]
        self._commander.fly_to(goal_m)
        return Result.ACCEPTED

    def _set_home(self, params: Params) -> Result:
        """1: the present place; else the coordinates, which are float32 in a COMMAND_LONG (habit 33)."""
        if params[0] == 1.0:
            self._move_home()
            return Result.ACCEPTED
        if not _is_place(*params[4:]):
            return Result.FAILED
        self._columns.home_m[self.row] = self._local(*params[4:])
        self._columns.home_place[self.row] = params[4:]
        return Result.ACCEPTED

    def _local(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Array:
        """(3,) local NED of a place near the vehicle."""
        sensors, row = self._shared.sensors(), self.row
        here_m = sensors.estimate_m[row]
        steps_m = 100.0 * np.eye(3)[:2]
        here, north, east = sensors.locate(here_m + np.vstack([np.zeros(3), steps_m]))
        slopes = np.column_stack([north - here, east - here])[:2] / 100.0
        way_m = np.linalg.solve(slopes, np.array((latitude_deg, longitude_deg)) - here[:2])
        local_m: Array = sensors.position_m[row] + np.array((*way_m, here[2] - altitude_m))
        return local_m

    def _reboot(self, params: Params) -> Result:
        """Refused while armed; a second, stray answer follows (habit 18)."""
        if params[0] != 1.0 or self._commander.armed:
            return Result.FAILED
        self._shared.reboot(self.row)
        self._acknowledge(common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, Result.FAILED, STRAY_ACK_S)
        return Result.ACCEPTED

    def _set_interval(self, params: Params) -> Result:
        """A text says that a message is unknown (habit 4)."""
        message_id = _message_id(params)
        if message_id is None or not math.isfinite(params[1]):
            return Result.FAILED
        if message_id in reports.SILENT:
            return Result.ACCEPTED
        if message_id not in reports.ALL:
            self._post_text(INFO, f"No ap_message for mavlink id ({message_id})")
            return Result.FAILED
        interval_s = max(params[1] * 1e-6, FASTEST_S) if params[1] > 0 else None
        if params[1] == 0:
            interval_s = self._shared.schedule.default_s.get(message_id)
        self._shared.schedule.set_interval(self.row, message_id, interval_s, self._columns.now_s)
        return Result.ACCEPTED

    def _get_interval(self, params: Params) -> Result:
        """MESSAGE_INTERVAL answers in any case; 0 for an unknown message (habit 5)."""
        number = _message_id(params) or 0
        is_sent = _message_id(params) in reports.ALL
        interval_s = self._shared.schedule.interval_s(self.row, number) if is_sent else None
        interval_us = round(1e6 * interval_s) if interval_s is not None else -1 if is_sent else 0
        self.reply(common.MAVLink_message_interval_message(number % 65536, interval_us))
        return Result.ACCEPTED if is_sent else Result.FAILED

    def _request(self, params: Params) -> Result:
        """Accepted for each known message, also where there is nothing to send yet (habit 7)."""
        message_id = _message_id(params)
        if message_id in reports.SILENT:
            return Result.ACCEPTED
        if message_id is None or message_id not in reports.ALL:
            return Result.FAILED
        self.reply(message_id)
        return Result.ACCEPTED

    def _answer_with(self, *message_ids: int) -> Result:
        for message_id in message_ids:
            self.reply(message_id)
        return Result.ACCEPTED

    def _terminate(self, params: Params) -> Result:
        return self._commander.disarm(force=True) if params[0] > 0.5 else Result.FAILED

    _COMMANDS: ClassVar[Mapping[int, Callable[["ArduPilot", Params], Result]]] = MappingProxyType(
        {
            common.MAV_CMD_NAV_LOITER_UNLIM: lambda self, _: self._commander.change_mode(Mode.LOITER),
            common.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda self, _: self._commander.change_mode(Mode.RTL),
            common.MAV_CMD_NAV_LAND: lambda self, _: self._commander.change_mode(Mode.LAND),
            common.MAV_CMD_NAV_TAKEOFF: _take_off,
            common.MAV_CMD_CONDITION_YAW: _turn,
            common.MAV_CMD_DO_SET_MODE: _set_mode,
            common.MAV_CMD_DO_CHANGE_SPEED: lambda _self, _: Result.ACCEPTED,  # habit 17: no effect seen
            common.MAV_CMD_DO_SET_HOME: _set_home,
            common.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
            common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
            common.MAV_CMD_MISSION_START: lambda _self, _: Result.FAILED,  # habit 15: there is none
            common.MAV_CMD_COMPONENT_ARM_DISARM: _arm_or_disarm,
            410: lambda self, _: self._answer_with(HOME, ORIGIN),  # GET_HOME_POSITION
            common.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
            common.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
            common.MAV_CMD_REQUEST_MESSAGE: _request,
            520: lambda self, _: self._answer_with(VERSION),  # REQUEST_AUTOPILOT_CAPABILITIES
        }
    )

    handlers: ClassVar[Mapping[str, Callable[..., None]]] = MappingProxyType(
        {
            "HEARTBEAT": _receive_heartbeat,
            "COMMAND_LONG": _receive_command,
            "COMMAND_INT": _receive_command_int,
            "SET_MODE": _receive_set_mode,
            "TIMESYNC": _receive_timesync,
            "PARAM_REQUEST_READ": _receive_parameter_read,
            "PARAM_REQUEST_LIST": _receive_parameter_list,
            "PARAM_SET": _receive_parameter_set,
            "REQUEST_DATA_STREAM": _receive_data_stream,
            **dict.fromkeys(
                fences.MESSAGES, lambda self, each: self.fences.receive(each, self._columns.now_s)
            ),
        }
    )


def _is_place(latitude_deg: float, longitude_deg: float, altitude_m: float) -> bool:
    return abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0 and abs(altitude_m) <= HIGHEST_M


def _message_id(params: Params) -> int | None:
    return int(params[0]) if math.isfinite(params[0]) and 0 <= params[0] < MAX_MESSAGE_ID else None
