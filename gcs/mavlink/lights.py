"""Colours of vehicles as MAVLink messages. No I/O.

No message of MAVLink's common dialect sets a colour. What reads each of these: docs/how-to/lights.md.
"""

from enum import StrEnum
from math import nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.codec import Records, addressed, records, text_field
from gcs.mavlink.framing import COMMAND_LONG, NAMED_VALUE_FLOAT
from gcs.mavlink.kernels import Whole

LED_CONTROL: Final = 186
_ALL_LEDS: Final = 255
_CUSTOM: Final = 255
"""LED_CONTROL_PATTERN_CUSTOM: the bytes are red, green and blue."""

_DO_SET_ACTUATOR: Final = 187
_NAME_LENGTH: Final = 10


class LightDriver(StrEnum):
    """How vehicles receive their colours."""

    NONE = "none"
    LED_CONTROL = "led-control"  # of the ardupilotmega dialect
    DEBUG_KEY_VALUE = "debug-key-value"  # NAMED_VALUE_FLOAT, which PX4 publishes as debug_key_value
    ACTUATOR = "actuator"  # MAV_CMD_DO_SET_ACTUATOR: PX4's outputs "Peripheral via Actuator Set" 1 to 3


def light_messages(
    driver: LightDriver, system_ids: Whole, colour: NDArray[np.uint8], *, time_s: float
) -> tuple[int, Records]:
    """Messages that set the colours of n vehicles.

    Args:
        driver: any but NONE.
        system_ids: (n,) of the vehicles.
        colour: (n, 3) red, green, blue.
        time_s: of our clock.

    Returns: the message id, and (n,) messages. NAMED_VALUE_FLOAT has no target, so its name has the system
        id ("rgb17"), and its value is 65536 red + 256 green + blue, which a float holds exactly.
    """
    if driver is LightDriver.LED_CONTROL:
        messages = addressed(LED_CONTROL, system_ids, instance=_ALL_LEDS, pattern=_CUSTOM, custom_len=3)
        messages["custom_bytes"][:, :3] = colour
        return LED_CONTROL, messages
    if driver is LightDriver.DEBUG_KEY_VALUE:
        messages = records(NAMED_VALUE_FLOAT, len(system_ids))
        messages["time_boot_ms"] = int(time_s * 1e3) & 0xFFFFFFFF
        messages["value"] = colour @ np.array([65536, 256, 1])
        for at, system_id in enumerate(system_ids.tolist()):
            messages["name"][at] = text_field(f"rgb{system_id}", _NAME_LENGTH)
        return NAMED_VALUE_FLOAT, messages
    output = dict(zip(("param1", "param2", "param3"), colour.T / 127.5 - 1.0, strict=True))
    unused = dict.fromkeys(("param4", "param5", "param6"), nan)
    return COMMAND_LONG, addressed(COMMAND_LONG, system_ids, command=_DO_SET_ACTUATOR, **output, **unused)
