"""The MAV_CMD commands that the fake autopilot knows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol, TypeAlias

from pymavlink.dialects.v20 import common

from gcs.sim.protocol import reports
from gcs.sim.vehicle.commander import Result
from gcs.sim.vehicle.px4 import Mode

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from gcs.sim.protocol.streams import Item
    from gcs.sim.vehicle.commander import Commander

FORCE = 21196  # param2 that overrides the checks: arms in any case, kills in the air
CUSTOM_MODE_ENABLED = 1
AUTOPILOT_VERSION_ID, PROTOCOL_VERSION_ID = 148, 300
MAX_MESSAGE_ID = 2**24
VERSION = 0x011001FF  # v1.16.1, release
CAPABILITIES = (  # only those that hold here
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
    """What commands need of the autopilot that executes them."""

    commander: Commander

    @property
    def system_id(self) -> int:
        """1 to 250."""
        ...

    def arm(self, *, force: bool = False) -> Result:
        """Start the motors, if the checks allow it."""
        ...

    def change_mode(self, mode: Mode) -> Result:
        """Change the flight mode, if it can be flown."""
        ...

    def take_off(self, altitude_amsl_m: float | None) -> Result:
        """Climb; None: to MIS_TAKEOFF_ALT."""
        ...

    def reboot(self) -> Result:
        """Reboot, if it is disarmed."""
        ...

    def available(self, message_id: int) -> bool:
        """Whether that report can be sent now."""
        ...

    def interval_s(self, message_id: int) -> float | None:
        """The interval of a stream, or None while it is not sent."""
        ...

    def default_interval_s(self, message_id: int) -> float | None:
        """The interval after booting."""
        ...

    def set_interval(self, message_id: int, interval_s: float | None) -> None:
        """Send at that interval from now on; None stops the stream."""
        ...

    def reply(self, item: Item) -> None:
        """Send a message, or the report of that id, to the sender of the command."""
        ...


def execute(autopilot: Commanded, command: Command) -> Result:
    """Execute the command, or return why not; unknown commands are UNSUPPORTED."""
    handler = HANDLERS.get(command.number)
    return Result.UNSUPPORTED if handler is None else handler(autopilot, command)


def _arm(autopilot: Commanded, command: Command) -> Result:
    desired, force = command.values[0], command.values[1] == FORCE
    if desired == 1.0:
        return autopilot.arm(force=force)
    if desired == 0.0:
        return autopilot.commander.disarm(force=force)
    return Result.DENIED


def _terminate(autopilot: Commanded, command: Command) -> Result:
    return autopilot.commander.disarm(force=True) if command.values[0] > 0.5 else Result.ACCEPTED


def _set_mode(autopilot: Commanded, command: Command) -> Result:
    base, main, sub = command.values[:3]
    if not all(math.isfinite(value) for value in (base, main, sub)) or not int(base) & CUSTOM_MODE_ENABLED:
        return Result.DENIED
    mode = Mode.find(int(main), int(sub))
    return Result.DENIED if mode is None else autopilot.change_mode(mode)


def _take_off(autopilot: Commanded, command: Command) -> Result:
    altitude_amsl_m = command.values[6]
    return autopilot.take_off(altitude_amsl_m if math.isfinite(altitude_amsl_m) else None)


def _land(autopilot: Commanded, _command: Command) -> Result:
    return autopilot.change_mode(Mode.LAND)


def _return(autopilot: Commanded, _command: Command) -> Result:
    return autopilot.change_mode(Mode.RETURN)


def _reboot(autopilot: Commanded, command: Command) -> Result:
    """1 reboots the autopilot, denied while armed; 0 is accepted, and PX4 denies all other values."""
    desired = command.values[0]
    if desired == 0.0:
        return Result.ACCEPTED
    return autopilot.reboot() if desired == 1.0 else Result.DENIED


def _set_interval(autopilot: Commanded, command: Command) -> Result:
    """SET_MESSAGE_INTERVAL: microseconds; 0 is the default rate, -1 stops."""
    message_id, interval_us = _message_id(command), command.values[1]
    if message_id is None or not reports.exists(message_id) or not math.isfinite(interval_us):
        return Result.FAILED
    interval_s = interval_us * 1e-6 if interval_us > 0 else None
    if interval_us == 0:
        interval_s = autopilot.default_interval_s(message_id)
    autopilot.set_interval(message_id, interval_s)
    return Result.ACCEPTED


def _get_interval(autopilot: Commanded, command: Command) -> Result:
    message_id = _message_id(command)
    if message_id is None:
        return Result.DENIED
    interval_s = autopilot.interval_s(message_id) if reports.exists(message_id) else None
    interval_us = -1 if interval_s is None else round(interval_s * 1e6)
    autopilot.reply(common.MAVLink_message_interval_message(message_id, interval_us))
    return Result.ACCEPTED


def _request(autopilot: Commanded, command: Command) -> Result:
    message_id = _message_id(command)
    if message_id == AUTOPILOT_VERSION_ID:
        autopilot.reply(version(autopilot))
        return Result.ACCEPTED
    if message_id == PROTOCOL_VERSION_ID:
        autopilot.reply(common.MAVLink_protocol_version_message(200, 100, 200, [0] * 8, [0] * 8))
        return Result.ACCEPTED
    if message_id is None or not autopilot.available(message_id):
        return Result.DENIED
    autopilot.reply(message_id)
    return Result.ACCEPTED


def _request_version(autopilot: Commanded, _command: Command) -> Result:
    autopilot.reply(version(autopilot))
    return Result.ACCEPTED


def version(autopilot: Commanded) -> common.MAVLink_autopilot_version_message:
    """AUTOPILOT_VERSION; the uid is the system id, so that vehicles can be distinguished."""
    none = [0] * 8
    return common.MAVLink_autopilot_version_message(
        CAPABILITIES, VERSION, VERSION, 0, 0, none, none, none, 0, 0, autopilot.system_id
    )


def _message_id(command: Command) -> int | None:
    value = command.values[0]
    return int(value) if math.isfinite(value) and 0 <= value < MAX_MESSAGE_ID else None


Handler: TypeAlias = "Callable[[Commanded, Command], Result]"
HANDLERS: Mapping[int, Handler] = MappingProxyType(
    {
        common.MAV_CMD_NAV_RETURN_TO_LAUNCH: _return,
        common.MAV_CMD_NAV_LAND: _land,
        common.MAV_CMD_NAV_TAKEOFF: _take_off,
        common.MAV_CMD_DO_SET_MODE: _set_mode,
        common.MAV_CMD_DO_FLIGHTTERMINATION: _terminate,
        common.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
        common.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
        common.MAV_CMD_GET_MESSAGE_INTERVAL: _get_interval,
        common.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
        common.MAV_CMD_REQUEST_MESSAGE: _request,
        520: _request_version,  # REQUEST_AUTOPILOT_CAPABILITIES, deprecated and still in use
    }
)
