"""MAV_CMD to deeds: the table of commands that this autopilot knows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol, TypeAlias

from pymavlink.dialects.v20 import common

from sim import reports
from sim.commander import Result
from sim.modes import Mode
from sim.streams import RECORDED_HZ

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim.commander import Commander
    from sim.mavlink import Message
    from sim.streams import Streams

FORCE = 21196  # param2 that overrides the checks: arms anything, kills in the air
CUSTOM_MODE_ENABLED = 1
AUTOPILOT_VERSION_ID, PROTOCOL_VERSION_ID = 148, 300
MAX_MESSAGE_ID = 2**24
VERSION = 0x011001FF  # v1.16.1, release
CAPABILITIES = (  # only what is true here
    common.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | common.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | common.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | common.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | common.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)


@dataclass(frozen=True, slots=True)
class Command:
    """A COMMAND_LONG or COMMAND_INT: the id and the seven parameters."""

    number: int
    values: tuple[float, float, float, float, float, float, float]


class Commanded(Protocol):
    """What commands need of the autopilot that they are given to."""

    system_id: int
    commander: Commander
    streams: Streams

    def arm(self, now_s: float, *, force: bool = False) -> Result:
        """Start the motors, if the checks allow it."""
        ...

    def change_mode(self, mode: Mode, now_s: float) -> Result:
        """Change the flight mode, if it can be flown."""
        ...

    def take_off(self, altitude_amsl_m: float | None, now_s: float) -> Result:
        """Climb; None: to MIS_TAKEOFF_ALT."""
        ...

    def snapshot(self, now_s: float) -> reports.Snapshot:
        """All that reports are made of."""
        ...

    def reply(self, message: Message) -> None:
        """Send to whoever asked."""
        ...


def execute(autopilot: Commanded, command: Command, now_s: float) -> Result:
    """Do it, or say why not; unknown commands are UNSUPPORTED."""
    handler = HANDLERS.get(command.number)
    return Result.UNSUPPORTED if handler is None else handler(autopilot, command, now_s)


def _arm(autopilot: Commanded, command: Command, now_s: float) -> Result:
    wanted, force = command.values[0], command.values[1] == FORCE
    if wanted == 1.0:
        return autopilot.arm(now_s, force=force)
    if wanted == 0.0:
        return autopilot.commander.disarm(force=force)
    return Result.DENIED


def _terminate(autopilot: Commanded, command: Command, _now_s: float) -> Result:
    return autopilot.commander.disarm(force=True) if command.values[0] > 0.5 else Result.ACCEPTED


def _set_mode(autopilot: Commanded, command: Command, now_s: float) -> Result:
    base, main, sub = command.values[:3]
    if not all(math.isfinite(value) for value in (base, main, sub)) or not int(base) & CUSTOM_MODE_ENABLED:
        return Result.DENIED
    mode = Mode.find(int(main), int(sub))
    return Result.DENIED if mode is None else autopilot.change_mode(mode, now_s)


def _take_off(autopilot: Commanded, command: Command, now_s: float) -> Result:
    altitude_amsl_m = command.values[6]
    return autopilot.take_off(altitude_amsl_m if math.isfinite(altitude_amsl_m) else None, now_s)


def _land(autopilot: Commanded, _command: Command, now_s: float) -> Result:
    return autopilot.change_mode(Mode.LAND, now_s)


def _return(autopilot: Commanded, _command: Command, now_s: float) -> Result:
    return autopilot.change_mode(Mode.RETURN, now_s)


def _set_interval(autopilot: Commanded, command: Command, now_s: float) -> Result:
    """SET_MESSAGE_INTERVAL: microseconds; 0 is the default rate, -1 stops."""
    message_id, interval_us = _message_id(command), command.values[1]
    if message_id is None or not reports.exists(message_id) or not math.isfinite(interval_us):
        return Result.FAILED
    interval_s = interval_us * 1e-6 if interval_us > 0 else None
    if interval_us == 0 and message_id in RECORDED_HZ:
        interval_s = 1.0 / RECORDED_HZ[message_id]
    autopilot.streams.set_interval(message_id, interval_s, now_s)
    return Result.ACCEPTED


def _get_interval(autopilot: Commanded, command: Command, _now_s: float) -> Result:
    message_id = _message_id(command)
    if message_id is None:
        return Result.DENIED
    interval_s = autopilot.streams.interval_s(message_id)
    interval_us = -1 if interval_s is None else round(interval_s * 1e6)
    autopilot.reply(common.MAVLink_message_interval_message(message_id, interval_us))
    return Result.ACCEPTED


def _request(autopilot: Commanded, command: Command, now_s: float) -> Result:
    message_id = _message_id(command)
    if message_id == AUTOPILOT_VERSION_ID:
        autopilot.reply(version(autopilot))
        return Result.ACCEPTED
    if message_id == PROTOCOL_VERSION_ID:
        autopilot.reply(common.MAVLink_protocol_version_message(200, 100, 200, [0] * 8, [0] * 8))
        return Result.ACCEPTED
    message = None if message_id is None else reports.report(message_id, autopilot.snapshot(now_s))
    if message is None:
        return Result.DENIED
    autopilot.reply(message)
    return Result.ACCEPTED


def _request_version(autopilot: Commanded, _command: Command, _now_s: float) -> Result:
    autopilot.reply(version(autopilot))
    return Result.ACCEPTED


def version(autopilot: Commanded) -> common.MAVLink_autopilot_version_message:
    """AUTOPILOT_VERSION; the uid is the system id, so that vehicles can be told apart."""
    none = [0] * 8
    return common.MAVLink_autopilot_version_message(
        CAPABILITIES, VERSION, VERSION, 0, 0, none, none, none, 0, 0, autopilot.system_id
    )


def _message_id(command: Command) -> int | None:
    value = command.values[0]
    return int(value) if math.isfinite(value) and 0 <= value < MAX_MESSAGE_ID else None


Handler: TypeAlias = "Callable[[Commanded, Command, float], Result]"
HANDLERS: Mapping[int, Handler] = MappingProxyType(
    {
        common.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
        common.MAV_CMD_NAV_LAND: _land,
        common.MAV_CMD_NAV_TAKEOFF: _take_off,
        common.MAV_CMD_DO_SET_MODE: _set_mode,
        common.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
        common.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
        common.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
        common.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
        common.MAV_CMD_REQUEST_MESSAGE: _request,
        520: _request_version,  # REQUEST_AUTOPILOT_CAPABILITIES, deprecated and still in use
    }
)
