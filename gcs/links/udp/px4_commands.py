"""Each command in MAVLink, for PX4."""

from collections.abc import Callable
from math import nan
from typing import Final

from pymavlink.dialects.v20 import development as dialect

from gcs.links.link import Command, ParameterValue, Verb
from gcs.links.udp.commands import Commands
from gcs.links.udp.telemetry import VehicleReport
from gcs.mavlink.codec import Records, records
from gcs.mavlink.framing import COMMAND_LONG
from gcs.model.state import Landed

ARM_DISARM: Final = int(dialect.MAV_CMD_COMPONENT_ARM_DISARM)
SET_MODE: Final = int(dialect.MAV_CMD_DO_SET_MODE)
TAKEOFF: Final = int(dialect.MAV_CMD_NAV_TAKEOFF)
LAND: Final = int(dialect.MAV_CMD_NAV_LAND)
TAKEOFF_HEIGHT: Final = "MIS_TAKEOFF_ALT"

_CUSTOM: Final = float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
_KILL_MAGIC: Final = 21196.0  # param2: also in flight
_FROM_HERE: Final = (nan,) * 7  # at its position, with the configured parameters

_COMMANDS: Final[dict[Verb, tuple[int, tuple[float, ...]]]] = {
    Verb.ARM: (ARM_DISARM, (1.0,)),
    Verb.DISARM: (ARM_DISARM, (0.0,)),
    Verb.TAKEOFF: (TAKEOFF, _FROM_HERE),
    Verb.HOLD: (SET_MODE, (_CUSTOM, 4.0, 3.0)),
    Verb.OFFBOARD: (SET_MODE, (_CUSTOM, 6.0, 0.0)),
    Verb.RETURN: (SET_MODE, (_CUSTOM, 4.0, 5.0)),
    Verb.LAND: (LAND, _FROM_HERE),
}
"""PX4's main and sub mode where a mode is set."""


class NativeCommandChannel:
    """One vehicle. A `gcs.links.command_protocol.CommandChannel`."""

    def __init__(self, row: int, commands: Commands, reported: VehicleReport) -> None:
        self._row = row
        self._commands = commands
        self._stated = reported

    def landed(self) -> Landed:
        """From the newest EXTENDED_SYS_STATE."""
        return self._stated.landed

    async def command(self, given: Command, may_leave: Callable[[], None]) -> None:
        """Send it and wait for the acknowledgement. Raises: CommandError."""
        if given.verb is Verb.TAKEOFF:
            await self._commands.set_parameter(self._row, TAKEOFF_HEIGHT, float(given.height_m), may_leave)
        command, values = _COMMANDS[given.verb]
        await self._commands.command(self._row, command, values, may_leave)

    async def parameter(self, name: str) -> ParameterValue:
        """The autopilot's value. Raises: CommandError."""
        return await self._commands.get_parameter(self._row, name, _moves_nothing)

    async def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Set the value; returns when the vehicle reports it. Raises: CommandError."""
        await self._commands.set_parameter(self._row, name, value, _moves_nothing)


def _moves_nothing() -> None:
    """Parameters may also be read and set after a kill."""


def kill_message(system_id: int) -> Records:
    """COMMAND_LONG that stops the motors at once, also in flight."""
    message = records(COMMAND_LONG, 1)
    message["target_system"], message["target_component"] = system_id, 1
    message["command"] = ARM_DISARM
    message["param2"] = _KILL_MAGIC
    return message
