"""A fake transponder for Remote ID behind a fake autopilot: it receives, and reports how it is. Sans-I/O.

As ArduRemoteID: ARM_STATUS and a heartbeat once a second, and an error while it lacks what it needs. The
autopilot passes on what the ground station sends, and the transponder's messages to the ground station.
What ArduPilot says of it is as in AP_OpenDroneID.cpp (0581fe9d) with bit 0 of DID_OPTIONS.
"""

from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import common

from gcs.sim.protocol.frames import Message

SYSTEM = "OPEN_DRONE_ID_SYSTEM"
PLACES = (SYSTEM, "OPEN_DRONE_ID_SYSTEM_UPDATE")
MESSAGES = (
    *PLACES,
    "OPEN_DRONE_ID_OPERATOR_ID",
    "OPEN_DRONE_ID_SELF_ID",
    "OPEN_DRONE_ID_BASIC_ID",
)
COMPONENT = common.MAV_COMP_ID_ODID_TXRX_1
BEAT_S = 1.0
OLD_S = 3.0
"""As long as ArduRemoteID and ArduPilot believe a message."""
LOST_S = 5.0
"""Without a message ArduPilot sends a text, and so often."""

WARNING, INFO = 4, 6  # MAV_SEVERITY
GOOD, NOT_GOOD = 0, 1  # MAV_ODID_ARM_STATUS
STANDBY, CRITICAL = 3, 5  # MAV_STATE


class TransponderFault(Enum):
    """What is wrong with a transponder."""

    NONE = "none"
    LOST = "lost"  # it sends and receives nothing
    NOT_GOOD = "not-good"
    DEAF = "lost-operator"  # it no longer receives where the operator is


class FromTransponder:
    """A message from the component of the transponder, whatever the codec's own is."""

    def __init__(self, message: Message) -> None:
        self._message = message

    def pack(self, mav: Any) -> bytes:
        """The frame."""
        before = mav.srcComponent
        mav.srcComponent = COMPONENT
        try:
            return bytes(self._message.pack(mav))
        finally:
            mav.srcComponent = before


class Transponder:
    """One vehicle's transponder.

    Attributes:
        newest: fields of the newest message of each kind that the autopilot received, by its name.
        times_s: when it received SYSTEM and SYSTEM_UPDATE.
    """

    def __init__(self) -> None:
        self.fault = TransponderFault.NONE
        self.newest: dict[str, dict[str, Any]] = {}
        self.times_s: list[float] = []
        self._place_s = self._beat_s = float("-inf")
        self._text_s = [float("-inf")] * 2  # about itself, about the operator's place

    def receive(self, message: Message, now_s: float) -> None:
        """Take one of MESSAGES from the autopilot."""
        kind = message.get_type()
        self.newest[kind] = message.to_dict()
        if kind in PLACES:
            self.times_s = [*self.times_s[-1023:], now_s]
            if self.fault in {TransponderFault.NONE, TransponderFault.NOT_GOOD}:
                self._place_s = now_s

    def error(self, now_s: float) -> str:
        """Why it would not arm, in ArduRemoteID's words; empty: it would."""
        if self.fault is TransponderFault.NOT_GOOD:
            return "LOC"
        return "SYS OP_LOC" if now_s - self._place_s > OLD_S else ""

    def is_ready(self, now_s: float) -> bool:
        """Whether its autopilot takes it as ready."""
        return now_s - self._beat_s <= OLD_S and not self.error(now_s)

    def due(self, now_s: float) -> list[FromTransponder]:
        """What it sends now."""
        if self.fault is TransponderFault.LOST or now_s - self._beat_s < BEAT_S - 1e-6:
            return []
        self._beat_s = now_s
        error = self.error(now_s)
        state = CRITICAL if error else STANDBY
        beat = common.MAVLink_heartbeat_message(common.MAV_TYPE_ODID, 8, 0, 0, state, 3)
        status = NOT_GOOD if error else GOOD
        arm = common.MAVLink_open_drone_id_arm_status_message(status, error.encode("ascii"))
        return [FromTransponder(beat), FromTransponder(arm)]

    def refusal(self, now_s: float) -> str:
        """Why ArduPilot does not arm with it; empty: it does."""
        system = self.newest.get(SYSTEM, {})
        if not (system.get("operator_latitude") or system.get("operator_longitude")):
            return "operator location must be set"
        if now_s - self._beat_s > OLD_S:
            return "ARM_STATUS not available"
        if not self.times_s or now_s - self.times_s[-1] > OLD_S:
            return "SYSTEM not available"
        return self.error(now_s)

    def texts(self, now_s: float, boot_s: float) -> list[tuple[int, str]]:
        """ArduPilot's texts about it now, with their severity; in the first seconds after a boot none."""
        place_s = self.times_s[-1] if self.times_s and SYSTEM in self.newest else boot_s
        texts = []
        if now_s - max(self._beat_s, boot_s) <= LOST_S:
            if self._text_s[0] > boot_s:
                self._text_s[0] = float("-inf")
                texts.append((INFO, "ODID: transmitter OK"))
        elif now_s - self._text_s[0] > LOST_S:
            self._text_s[0] = now_s
            texts.append((WARNING, "ODID: lost transmitter"))
        if now_s - max(place_s, boot_s, self._text_s[1]) > LOST_S:
            self._text_s[1] = now_s
            texts.append((WARNING, "ODID: lost operator location"))
        return texts
