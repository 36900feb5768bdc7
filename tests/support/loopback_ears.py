"""Telemetry of one vehicle on a loopback link, and whether it shows that the vehicle obeyed."""

import asyncio
import struct
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.links import Command, ParameterValue, Verb
from gcs.links.telemetry import VehicleTelemetry
from gcs.mavlink.framing import Frame
from gcs.model.state import Landed, Mode

EXTENDED_SYS_STATE, PARAM_VALUE = 245, 22
INT32 = 6
DESIRED_MODE = {
    Verb.HOLD: Mode.HOLD,
    Verb.OFFBOARD: Mode.OFFBOARD,
    Verb.RETURN: Mode.RETURN,
}


class Receiver(VehicleTelemetry):
    """Reads the telemetry of the production link and the values that MAVSDK reads for it."""

    def __init__(self) -> None:
        super().__init__()
        self.landed = Landed.UNKNOWN
        self.parameters: dict[str, ParameterValue] = {}  # as last announced
        self._mav = common.MAVLink(None)

    def take(self, frame: Frame, time_s: float) -> None:
        """Read one frame of this vehicle."""
        super().take(frame, time_s)
        if frame.message_id not in {EXTENDED_SYS_STATE, PARAM_VALUE}:
            return
        stated: Any = self._mav.decode(bytearray(frame.raw))
        if frame.message_id == EXTENDED_SYS_STATE:
            self.landed = Landed(stated.landed_state)
        else:
            whole = stated.param_type == INT32  # bytewise: the four bytes of an int in the float's place
            value = (
                struct.unpack("<i", struct.pack("<f", stated.param_value))[0] if whole else stated.param_value
            )
            self.parameters[stated.param_id] = value


def obeyed(verb: Verb, received: Receiver) -> bool:
    """Whether a vehicle's heartbeat shows that it obeyed, by the rules of the production link."""
    match verb:
        case Verb.ARM:
            return received.armed
        case Verb.DISARM:
            return not received.armed
        case Verb.TAKEOFF:
            climbs = received.mode is Mode.TAKEOFF or received.landed in {Landed.IN_AIR, Landed.TAKEOFF}
            return received.armed and climbs
        case Verb.LAND:
            return received.mode is Mode.LAND or (received.landed is Landed.ON_GROUND and not received.armed)
        case _:
            return received.mode is DESIRED_MODE[verb]


def failure(command: Command, received: Receiver, began_s: float) -> str:
    """Reason of a failed command, with the status texts of the vehicle since."""
    stated = f'; it says "{received.text}"' if received.text_time_s >= began_s else ""
    state = f"it reports {received.mode}, {'armed' if received.armed else 'disarmed'}"
    return f"{command.vehicle_id}: {command.verb} sent, but not seen to happen: {state}{stated}"


async def news(received: Receiver, wait_s: float) -> None:
    """Wait for the next heartbeat, at most `wait_s`."""
    try:
        async with asyncio.timeout(wait_s):
            await received.news.wait()
    except TimeoutError:
        return
