"""What a fake vehicle has for features of a ground station: a light, and a receiver of corrections. Sans-I/O.

GPS_RTCM_DATA is put together as PX4 does: fragments of one sequence, in any order.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message

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
    """That of one vehicle, and what it has received."""

    def __init__(self) -> None:
        self.light = (0, 0, 0)  # red, green, blue
        self.lights_received = self.corrections_received = 0  # colours, and whole RTCM messages
        self._corrections = Reassembly()

    def truth(self) -> dict[str, object]:
        """Its keys of a truth file."""
        received = {
            "corrections_received": self.corrections_received,
            "lights_received": self.lights_received,
        }
        return {"light": "#" + bytes(self.light).hex(), **received}

    def receive(self, message: Message, system_id: int) -> None:
        """Take a message of `MESSAGES`."""
        self.MESSAGES[message.get_type()](self, message, system_id)

    def set_actuator(self, params: Sequence[float]) -> bool:
        """MAV_CMD_DO_SET_ACTUATOR with red, green and blue from -1 to 1 in the first three. False: denied."""
        if params[6] != 0.0 or not all(-1.0 <= value <= 1.0 for value in params[:3]):
            return False
        self._show_light([round(127.5 * (value + 1.0)) for value in params[:3]])
        return True

    def _receive_led(self, message: Message, _: int) -> None:
        """LED_CONTROL: no driver of stock PX4 reads it; this vehicle has one that does."""
        if message.pattern == CUSTOM_PATTERN and message.custom_len == 3:
            self._show_light(message.custom_bytes[:3])

    def _receive_named_value(self, message: Message, system_id: int) -> None:
        """Read NAMED_VALUE_FLOAT "rgb17" of system 17, which PX4 publishes as debug_key_value."""
        if message.name == f"rgb{system_id}" and 0 <= message.value < 1 << 24:
            self._show_light(int(message.value).to_bytes(3, "big"))

    def _receive_correction(self, message: Message, _: int) -> None:
        """GPS_RTCM_DATA: a message counts once all its fragments are here, and its RTCM length is right."""
        whole = self._corrections.take(message.flags, bytes(message.data[: message.len]))
        if whole is not None and whole[:1] == RTCM_PREAMBLE:
            size = int.from_bytes(whole[1:3], "big") & 0x3FF
            self.corrections_received += len(whole) == size + 6

    def _show_light(self, colour: Sequence[int]) -> None:
        red, green, blue = colour
        self.light, self.lights_received = (red, green, blue), self.lights_received + 1

    MESSAGES: ClassVar[Mapping[str, Callable[["Equipment", Message, int], None]]] = MappingProxyType(
        {
            "GPS_RTCM_DATA": _receive_correction,
            "LED_CONTROL": _receive_led,
            "NAMED_VALUE_FLOAT": _receive_named_value,
        }
    )
