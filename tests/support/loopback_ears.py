"""What a loopback link hears of one vehicle, and whether that shows that it obeyed."""

import asyncio
import struct
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.links import Command, ParameterValue, Verb
from gcs.links.telemetry import Heard
from gcs.mavlink.framing import Frame
from gcs.model.state import Landed, Mode

EXTENDED_SYS_STATE, PARAM_VALUE = 245, 22
INT32 = 6
DESIRED_MODE = {
    Verb.HOLD: Mode.HOLD,
    Verb.OFFBOARD: Mode.OFFBOARD,
    Verb.RETURN: Mode.RETURN,
}


class Ears(Heard):
    """What the production link reads, and the numbers that MAVSDK reads for it."""

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
        said: Any = self._mav.decode(bytearray(frame.raw))
        if frame.message_id == EXTENDED_SYS_STATE:
            self.landed = Landed(said.landed_state)
        else:
            whole = said.param_type == INT32  # bytewise: the four bytes of an int in the float's place
            value = struct.unpack("<i", struct.pack("<f", said.param_value))[0] if whole else said.param_value
            self.parameters[said.param_id] = value


def obeyed(verb: Verb, heard: Ears) -> bool:
    """Whether a vehicle's heartbeat shows that it obeyed, by the same rules as the production link's."""
    match verb:
        case Verb.ARM:
            return heard.armed
        case Verb.DISARM:
            return not heard.armed
        case Verb.TAKEOFF:
            climbs = heard.mode is Mode.TAKEOFF or heard.landed in {Landed.IN_AIR, Landed.TAKEOFF}
            return heard.armed and climbs
        case Verb.LAND:
            return heard.mode is Mode.LAND or (heard.landed is Landed.ON_GROUND and not heard.armed)
        case _:
            return heard.mode is DESIRED_MODE[verb]


def failure(command: Command, heard: Ears, began_s: float) -> str:
    """Why an order failed, with what the vehicle itself said since."""
    said = f'; it says "{heard.text}"' if heard.text_time_s >= began_s else ""
    state = f"it reports {heard.mode}, {'armed' if heard.armed else 'disarmed'}"
    return f"{command.vehicle_id}: {command.verb} sent, but not seen to happen: {state}{said}"


async def news(heard: Ears, wait_s: float) -> None:
    """Until the next heartbeat, or `wait_s`."""
    try:
        async with asyncio.timeout(wait_s):
            await heard.news.wait()
    except TimeoutError:
        return
