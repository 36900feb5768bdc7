"""What a fake vehicle has for features of a ground station: a light, and a receiver of corrections. Sans-I/O.

GPS_RTCM_DATA is put together as PX4 does: fragments of one sequence, in any order.
"""

from collections.abc import Sequence
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message

MESSAGES = ("GPS_RTCM_DATA", "LED_CONTROL", "NAMED_VALUE_FLOAT")
SET_ACTUATOR = common.MAV_CMD_DO_SET_ACTUATOR
CUSTOM_PATTERN = 255  # LED_CONTROL_PATTERN_CUSTOM
FRAGMENT_BYTES = 180
FRAGMENTS_MAX = 4
RTCM_PREAMBLE = b"\xd3"


class Reassembly:
    """Fragments of one message; those of another sequence begin anew."""

    def __init__(self) -> None:
        self._sequence = -1
        self._parts: dict[int, bytes] = {}

    def take(self, flags: int, data: bytes) -> bytes | None:
        """The whole message that this fragment completes, else None."""
        if not flags & 1:
            return data
        sequence, number = flags >> 3, flags >> 1 & 3
        if sequence != self._sequence or number in self._parts:
            self._sequence, self._parts = sequence, {}
        self._parts[number] = data
        whole = b""
        for at in range(FRAGMENTS_MAX):
            part = self._parts.get(at)
            if part is None:
                return None
            whole += part
            if len(part) < FRAGMENT_BYTES:
                break
        self._parts = {}
        return whole


class Equipment:
    """That of one vehicle; `truth` is what it has received, in the keys of a truth file."""

    def __init__(self) -> None:
        self.truth: dict[str, Any] = {"light": "#000000", "corrections_received": 0, "lights_received": 0}
        self._corrections = Reassembly()

    def receive(self, message: Message, system_id: int) -> None:
        """Take a message of `MESSAGES`.

        No driver of stock PX4 reads LED_CONTROL; this vehicle has one that does. PX4 publishes the named
        value "rgb17" of system 17 as debug_key_value. RTCM counts once it is whole, and its length is right.
        """
        match message.get_type():
            case "LED_CONTROL" if message.pattern == CUSTOM_PATTERN and message.custom_len == 3:
                self._show(message.custom_bytes[:3])
            case "NAMED_VALUE_FLOAT" if message.name == f"rgb{system_id}" and 0 <= message.value < 1 << 24:
                self._show(int(message.value).to_bytes(3, "big"))
            case "GPS_RTCM_DATA":
                whole = self._corrections.take(message.flags, bytes(message.data[: message.len]))
                if whole is not None and whole[:1] == RTCM_PREAMBLE:
                    size = int.from_bytes(whole[1:3], "big") & 0x3FF
                    self.truth["corrections_received"] += len(whole) == size + 6

    def set_actuator(self, params: Sequence[float]) -> bool:
        """MAV_CMD_DO_SET_ACTUATOR with red, green and blue from -1 to 1 in the first three. False: denied."""
        allowed = params[6] == 0.0 and all(-1.0 <= value <= 1.0 for value in params[:3])
        if allowed:
            self._show([round(127.5 * (value + 1.0)) for value in params[:3]])
        return allowed

    def _show(self, colour: Sequence[int]) -> None:
        self.truth["light"] = "#" + bytes(colour).hex()
        self.truth["lights_received"] += 1
