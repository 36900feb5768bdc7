"""SET_POSITION_TARGET_LOCAL_NED of a whole fleet: made, and recognised among what MAVSDK writes. No I/O."""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as dialect

from gcs.mavlink import kernels
from gcs.mavlink.codec import (
    AUTOPILOT_COMPONENT,
    COMPONENT_ID,
    HEADER_LENGTH,
    SYSTEM_ID,
    Frames,
    Records,
    layout,
    records,
)
from gcs.mavlink.framing import SET_POSITION_TARGET_LOCAL_NED
from gcs.mavlink.kernels import MAGIC_2, Bytes, Number, Whole
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask

VELOCITY_AND_YAW: Final = 0x9C7
"""Type mask: velocity and yaw count; the same as MAVSDK's."""

VELOCITY: Final = 0xDC7
"""Type mask: velocity counts; the yaw stays."""

SETPOINT_FRAME: Final = np.dtype(
    [
        ("magic", "u1"),
        ("length", "u1"),
        ("incompatible", "u1"),  # flags; 1: signed
        ("before_id", "V4"),
        ("message_id", "u1", 3),
        ("message", layout(SET_POSITION_TARGET_LOCAL_NED).dtype),
        ("checksum", "<u2"),
    ]
)
"""A MAVLink 2 frame with a SET_POSITION_TARGET_LOCAL_NED; its last byte is never 0 and so never cut off."""

NO_ROW: Final = -1
_LONG: Final = SETPOINT_FRAME.itemsize
_PAYLOAD_LONG: Final = SETPOINT_FRAME.itemsize - HEADER_LENGTH
_SETPOINT: Final = int(SET_POSITION_TARGET_LOCAL_NED)
_EXTRA: Final = layout(SET_POSITION_TARGET_LOCAL_NED).crc_extra


def _begin_of(field: str) -> int:
    frame = np.zeros(1, SETPOINT_FRAME)
    return frame["message"][field].ctypes.data - frame.ctypes.data


_TARGET_AT: Final = _begin_of("target_system")
_VELOCITY_AT: Final = _begin_of("vx")
_YAW_AT: Final = _begin_of("yaw")
_PAYLOAD_AT: Final = _begin_of("time_boot_ms")


def _boot_ms(time_s: float) -> int:
    """Time of our clock as the field `time_boot_ms`."""
    return int(time_s * 1e3) & 0xFFFFFFFF


def setpoint_messages(
    system_ids: Whole, velocity_ned_m_s: Array, yaw_rad: Array, *, time_s: float
) -> Records:
    """Setpoints: (n, 3) velocities; (n,) yaw, clockwise from north, in [-pi, pi); `time_s` of our clock."""
    record = records(SET_POSITION_TARGET_LOCAL_NED, 1)
    record["time_boot_ms"], record["target_component"] = _boot_ms(time_s), AUTOPILOT_COMPONENT
    record["coordinate_frame"], record["type_mask"] = dialect.MAV_FRAME_LOCAL_NED, VELOCITY_AND_YAW
    messages = record.repeat(len(system_ids))
    messages["target_system"], messages["yaw"] = system_ids, yaw_rad
    for name, velocity_m_s in zip(("vx", "vy", "vz"), velocity_ned_m_s.T, strict=True):
        messages[name] = velocity_m_s
    return messages


def setpoint_frames(
    system_ids: Whole,
    velocity_ned_m_s: Array,
    yaw_rad: Array,
    sequence: Bytes,
    *,
    time_s: float,
    system_id: int = SYSTEM_ID,
    component_id: int = COMPONENT_ID,
) -> Frames:
    """As `encode` of `setpoint_messages`, in one compiled loop."""
    at_rest, n = _setpoint_at_rest(), len(system_ids)
    frames, lengths = np.empty((n, _LONG), np.uint8), np.empty(n, np.int64)
    numbers = _boot_ms(time_s), system_id, component_id
    _put_setpoints(at_rest, system_ids, velocity_ned_m_s, yaw_rad, sequence, *numbers, frames, lengths)
    return Frames(frames, lengths)


@cache
def _setpoint_at_rest() -> Bytes:
    """The payload of a setpoint, all its bytes; what differs between setpoints is 0."""
    no_vehicle = np.zeros(1, np.int64)
    return setpoint_messages(no_vehicle, np.zeros((1, 3)), np.zeros(1), time_s=0.0).view(np.uint8)


@kernel
def _put_setpoints(
    at_rest: Bytes,
    system_ids: Whole,
    velocity_ned_m_s: Array,
    yaw_rad: Array,
    sequence: Bytes,
    boot_ms: int,
    system_id: int,
    component_id: int,
    frames: Bytes,
    lengths: Whole,
) -> None:
    """As `setpoint_frames`; `at_rest` is the payload of a setpoint at rest, the last two are written."""
    n = len(system_ids)
    payloads, values = np.empty((n, len(at_rest)), np.uint8), np.empty(4, np.float32)
    bits, systems = values.view(np.uint8), np.full(n, system_id, np.uint8)
    for row in range(n):
        for axis in range(3):
            values[axis] = velocity_ned_m_s[row, axis]
        values[3] = yaw_rad[row]
        for at in range(len(at_rest)):
            payloads[row, at] = at_rest[at]
        for at in range(4):
            payloads[row, at] = boot_ms >> 8 * at & 0xFF  # the payload begins with it
        for at in range(12):
            payloads[row, _VELOCITY_AT - _PAYLOAD_AT + at] = bits[at]
        for at in range(4):
            payloads[row, _YAW_AT - _PAYLOAD_AT + at] = bits[12 + at]
        payloads[row, _TARGET_AT - _PAYLOAD_AT] = system_ids[row]
    kernels.put_frames(payloads, _SETPOINT, _EXTRA, sequence, systems, component_id, frames, lengths)


@kernel
def are_setpoints(data: Bytes, length: Whole, count: Number) -> Mask:
    """(count,) whether each of the first `count` datagrams is one unsigned velocity setpoint, whole.

    Args:
        data: (room, longest) bytes of each.
        length: (room,) of each.
        count: number of datagrams.
    """
    are = np.zeros(count, np.bool_)
    for at in range(count):
        message = data[at]
        number = np.int64(message[7]) | np.int64(message[8]) << 8 | np.int64(message[9]) << 16
        whole = length[at] == _LONG and message[0] == MAGIC_2 and message[1] == _PAYLOAD_LONG
        are[at] = whole and message[2] == 0 and number == _SETPOINT
    return are


@kernel
def awaited_setpoints(
    data: Bytes, setpoints: Mask, row_of: Whole, awaited: Mask, velocity: NDArray[np.uint32]
) -> tuple[Whole, Whole]:
    """The setpoints with the awaited velocity; of several equal ones for one vehicle the last.

    Args:
        data: (room, longest) bytes of each datagram.
        setpoints: (k,) which of the first k are setpoints.
        row_of: (256,) the row of each system id, NO_ROW without one.
        awaited: (n,) rows whose setpoint is to leave.
        velocity: (n, 3) awaited velocities, as bits of single-precision numbers.

    Returns: (m,) their places in `data`, and (m,) their rows, all different.
    """
    place = np.full(len(awaited), -1, np.int64)
    rows, count = np.empty(len(awaited), np.int64), 0
    for at in range(len(setpoints)):
        if not setpoints[at]:
            continue
        message = data[at]
        row = row_of[message[_TARGET_AT]]
        if row == NO_ROW or not awaited[row]:
            continue
        same = True
        for axis in range(3):
            bits = np.uint32(0)
            for byte in range(4):
                bits |= np.uint32(message[_VELOCITY_AT + 4 * axis + byte]) << np.uint32(8 * byte)
            same = same and bits == velocity[row, axis]
        if not same:
            continue
        if place[row] < 0:
            rows[count] = row
            count += 1
        place[row] = at
    return place[rows[:count]], rows[:count]


def warm_up() -> None:
    """Compile, or load, the kernels of this module, with the types used in flight."""
    setpoint_frames(np.ones(1, np.int64), np.zeros((1, 3)), np.zeros(1), np.zeros(1, np.uint8), time_s=0.0)
    data, length, row_of = np.zeros((1, _LONG), np.uint8), np.zeros(1, np.int64), np.zeros(256, np.int64)
    places = are_setpoints(data, length, 1)
    awaited_setpoints(data, places, row_of, np.zeros(1, np.bool_), np.zeros((1, 3), np.uint32))
