"""Messages of the mission protocol that carry a fence, and the identity of a fence. No I/O.

Source: https://mavlink.io/en/services/mission.html. `opaque_id` of MISSION_COUNT and `fence_id` of
MISSION_CURRENT are extensions that pymavlink does not know yet: they are read behind the known fields.
"""

import zlib
from collections.abc import Sequence
from struct import pack
from typing import Final, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink.codec import Records, addressed
from gcs.mavlink.framing import COMMAND_LONG, REQUEST_MESSAGE
from gcs.mavlink.kernels import LENGTH, PAYLOAD, Bytes, Whole
from gcs.model.polygon_fence import PolygonFence

MISSION_REQUEST: Final = 40
MISSION_CURRENT: Final = 42
MISSION_REQUEST_LIST: Final = 43
MISSION_COUNT: Final = 44
MISSION_ACK: Final = 47
MISSION_REQUEST_INT: Final = 51
MISSION_ITEM_INT: Final = 73
HOME_POSITION: Final = 242

REQUESTS: Final = frozenset({MISSION_REQUEST, MISSION_REQUEST_INT})
TRANSFERS: Final = (
    *(MISSION_REQUEST, MISSION_CURRENT, MISSION_COUNT, MISSION_ACK, MISSION_REQUEST_INT, MISSION_ITEM_INT),
)  # fmt: skip
"""Messages of autopilots that carry fences, and their identities."""

READ: Final = (*TRANSFERS, HOME_POSITION)
"""What is read of autopilots."""

FENCE: Final = int(dialect.MAV_MISSION_TYPE_FENCE)
INCLUSION: Final = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION)
EXCLUSION: Final = int(dialect.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION)
ACCEPTED: Final = int(dialect.MAV_MISSION_ACCEPTED)
ERROR: Final = int(dialect.MAV_MISSION_ERROR)
DENIED: Final = int(dialect.MAV_MISSION_DENIED)
CANCELLED: Final = int(dialect.MAV_MISSION_OPERATION_CANCELLED)

_FRAME: Final = int(dialect.MAV_FRAME_GLOBAL)
_AUTOCONTINUE: Final = 1
_OPAQUE_AT: Final = 5  # in MISSION_COUNT, behind `mission_type`
_FENCE_ID_AT: Final = 10  # in MISSION_CURRENT, behind the state, the mode and the id of the mission
_ID_BYTES: Final = 4
_PER_DEG: Final = 1e7

RESULTS: Final = {
    ERROR: "an error, or it is busy",
    int(dialect.MAV_MISSION_UNSUPPORTED_FRAME): "unsupported frame",
    int(dialect.MAV_MISSION_UNSUPPORTED): "unsupported",
    int(dialect.MAV_MISSION_NO_SPACE): "no space",
    int(dialect.MAV_MISSION_INVALID): "invalid",
    int(dialect.MAV_MISSION_INVALID_PARAM1): "invalid number of vertices",
    int(dialect.MAV_MISSION_INVALID_SEQUENCE): "invalid sequence",
    DENIED: "denied: another station is at it",
    CANCELLED: "cancelled",
}
"""MAV_MISSION_RESULT in words."""


class FenceVertex(NamedTuple):
    """One item: a corner, and how many its polygon has."""

    command: int  # MAV_CMD
    corners: int
    latitude_e7: int
    longitude_e7: int


def vertices_of(fence: PolygonFence) -> tuple[FenceVertex, ...]:
    """Items of a fence, polygon by polygon."""
    return tuple(
        FenceVertex(
            INCLUSION if polygon.inclusion else EXCLUSION,
            len(polygon.corners_deg),
            round(latitude_deg * _PER_DEG),
            round(longitude_deg * _PER_DEG),
        )
        for polygon in fence.polygons
        for latitude_deg, longitude_deg in polygon.corners_deg
    )


def fence_id(vertices: Sequence[FenceVertex]) -> int:
    """CRC-32 without inversion that PX4 has of a fence, 0 of none.

    Source: `crc32_for_mission_item` in PX4's mavlink_mission.cpp, over the items as they were received.
    """
    crc = 0
    for vertex in vertices:
        item = pack(
            "<BHB4f2if",
            *(_FRAME, vertex.command, _AUTOCONTINUE, vertex.corners, 0.0, 0.0, 0.0),
            *(vertex.latitude_e7, vertex.longitude_e7, 0.0),
        )
        crc = zlib.crc32(item, crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
    return crc


def count_message(system_id: int, count: int) -> Records:
    return addressed(MISSION_COUNT, np.array([system_id]), count=count, mission_type=FENCE)


def request_list_message(system_id: int) -> Records:
    return addressed(MISSION_REQUEST_LIST, np.array([system_id]), mission_type=FENCE)


def request_message(system_id: int, sequence: int) -> Records:
    return addressed(MISSION_REQUEST_INT, np.array([system_id]), seq=sequence, mission_type=FENCE)


def ack_message(system_id: int, result: int) -> Records:
    return addressed(MISSION_ACK, np.array([system_id]), type=result, mission_type=FENCE)


def home_request(system_id: int) -> Records:
    """COMMAND_LONG that asks for HOME_POSITION."""
    return addressed(COMMAND_LONG, np.array([system_id]), command=REQUEST_MESSAGE, param1=HOME_POSITION)


def item_messages(system_id: int, vertices: Sequence[FenceVertex]) -> Records:
    """(n,) MISSION_ITEM_INT, in their order."""
    rows = np.array(vertices, np.int64).reshape(-1, len(FenceVertex._fields))
    return addressed(
        MISSION_ITEM_INT,
        np.full(len(rows), system_id),
        seq=np.arange(len(rows)),
        frame=_FRAME,
        autocontinue=_AUTOCONTINUE,
        command=rows[:, 0],
        param1=rows[:, 1],
        x=rows[:, 2],
        y=rows[:, 3],
        mission_type=FENCE,
    )


def vertex_of(item: Records) -> FenceVertex | None:
    """Corner of a MISSION_ITEM_INT; None for what is none, or has no whole number of corners."""
    command, count = int(item["command"]), float(item["param1"])
    if command not in {INCLUSION, EXCLUSION} or not 0.0 <= count < 1e6 or count != int(count):
        return None
    return FenceVertex(command, int(count), int(item["x"]), int(item["y"]))


def opaque_id(data: Bytes, frame: Whole) -> int:
    """`opaque_id` of a MISSION_COUNT, of which `frame` (FRAME_COLUMNS,) is in `data`; 0: none."""
    return _behind(data, frame, _OPAQUE_AT)


def reported_fence_id(data: Bytes, frame: Whole) -> int:
    """`fence_id` of a MISSION_CURRENT, as above; 0: no fence, or it does not say."""
    return _behind(data, frame, _FENCE_ID_AT)


def _behind(data: Bytes, frame: Whole, at: int) -> int:
    begin, end = int(frame[PAYLOAD]), int(frame[PAYLOAD] + frame[LENGTH])
    field = data[min(begin + at, end) : min(begin + at + _ID_BYTES, end)].tobytes()
    return int.from_bytes(field, "little")
