"""All traffic that MAVLink systems are or report, out of datagrams. Pure, but for what it receives."""

from typing import Final

from pymavlink.dialects.v20 import common

from gcs.links.targets.mavlink import (
    ADSB_VEHICLE,
    AIS_VESSEL,
    SILENT_S,
    aircraft,
    record_of,
    system,
    vessel,
)
from gcs.mavlink import codec
from gcs.mavlink.framing import GLOBAL_POSITION_INT, HEARTBEAT, Frame
from gcs.model.errors import LinkError
from gcs.model.target_fix import TargetFix
from gcs.model.traffic import VESSEL_S, TrackKind

QUIET_S: Final = 5.0
"""A receiver of traffic sends heartbeats: without a frame for so long traffic is not known."""

KIND_OF_TYPE: Final[dict[int, TrackKind]] = {
    common.MAV_TYPE_SURFACE_BOAT: "vessel",
    common.MAV_TYPE_SUBMARINE: "vessel",
    common.MAV_TYPE_GROUND_ROVER: "ground",
}
"""Any other MAVLink system flies, without a crew."""


class TrafficReports:
    """Reports of every track but the `own` systems. Never raises."""

    def __init__(self, at: str, own: frozenset[int], now_s: float) -> None:
        self._at, self._own = at, own
        self._types: dict[int, int] = {}  # of a heartbeat, by system id: at most 255
        self._received_s = self._report_s = self._named_s = now_s
        self._refused = ""

    def take(self, data: bytes, now_s: float) -> list[TargetFix]:
        """The reports in the datagrams of a turn."""
        fixes = []
        for frame in codec.split(data).frames:
            self._received_s = now_s
            try:
                fix = self._fix(frame, now_s)
            except LinkError as error:
                self._refused = str(error)
                continue
            if fix is not None:
                self._report_s, self._refused = now_s, ""
                fixes.append(fix)
        return fixes

    def why_silent(self, now_s: float) -> str:
        """Why traffic is not known, in words, once a second. A heartbeat says that there is none."""
        silent_s, wrong = now_s - self._received_s, self._refused and now_s - self._report_s >= SILENT_S
        if now_s - self._named_s < 1.0 or not (wrong or silent_s >= QUIET_S):
            return ""
        self._named_s = now_s
        return self._refused if silent_s < QUIET_S else f"nothing arrives at {self._at}"

    def _fix(self, frame: Frame, now_s: float) -> TargetFix | None:
        """Raises: LinkError with what is wrong in a report."""
        match frame.message_id:
            case message if message == ADSB_VEHICLE:
                return aircraft(record_of(frame), now_s)
            case message if message == AIS_VESSEL:
                return vessel(record_of(frame), now_s, VESSEL_S)
            case message if frame.system_id in self._own:
                return None
            case message if message == HEARTBEAT:
                self._types[frame.system_id] = int(record_of(frame)["type"])
            case message if message == GLOBAL_POSITION_INT:
                kind = KIND_OF_TYPE.get(self._types.get(frame.system_id, 0), "unmanned")
                return system(record_of(frame), now_s, track=f"system {frame.system_id}", kind=kind)
        return None
