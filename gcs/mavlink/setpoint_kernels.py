"""Velocity setpoints among the datagrams that MAVSDK wrote: which they are, which are awaited. Compiled."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.codec import HEADER_LENGTH, layout
from gcs.mavlink.framing import SET_POSITION_TARGET_LOCAL_NED
from gcs.mavlink.kernels import Bytes, Number, Whole
from gcs.model.jit import kernel
from gcs.model.state import Mask

FRAME: Final = np.dtype(
    [
        ("magic", "u1"),
        ("length", "u1"),
        ("incompatible", "u1"),  # flags; 1: signed
        ("before_id", "V4"),
        ("message_id", "u1", 3),
        ("stated", layout(SET_POSITION_TARGET_LOCAL_NED).dtype),
        ("checksum", "<u2"),
    ]
)
"""A MAVLink 2 frame with a SET_POSITION_TARGET_LOCAL_NED; its last byte is never 0 and so never cut off."""

NO_ROW: Final = -1

_MAGIC: Final = 0xFD
_LONG: Final = FRAME.itemsize
_PAYLOAD_LONG: Final = FRAME.itemsize - HEADER_LENGTH
_MESSAGE: Final = int(SET_POSITION_TARGET_LOCAL_NED)


def _begin_of(field: str) -> int:
    """Offset of a message field in a frame."""
    frame = np.zeros(1, FRAME)
    return frame["stated"][field].ctypes.data - frame.ctypes.data


_TARGET_AT: Final = _begin_of("target_system")
_VELOCITY_AT: Final = _begin_of("vx")


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
        stated = data[at]
        number = np.int64(stated[7]) | np.int64(stated[8]) << 8 | np.int64(stated[9]) << 16
        whole = length[at] == _LONG and stated[0] == _MAGIC and stated[1] == _PAYLOAD_LONG
        are[at] = whole and stated[2] == 0 and number == _MESSAGE
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
    rows, found = np.empty(len(awaited), np.int64), 0
    for at in range(len(setpoints)):
        if not setpoints[at]:
            continue
        stated = data[at]
        row = row_of[stated[_TARGET_AT]]
        if row == NO_ROW or not awaited[row]:
            continue
        same = True
        for axis in range(3):
            bits = np.uint32(0)
            for byte in range(4):
                bits |= np.uint32(stated[_VELOCITY_AT + 4 * axis + byte]) << np.uint32(8 * byte)
            same = same and bits == velocity[row, axis]
        if not same:
            continue
        if place[row] < 0:
            rows[found] = row
            found += 1
        place[row] = at
    return place[rows[:found]], rows[:found]


def warm_up() -> None:
    """Compile, or load, the kernels of this module, with the types used in flight."""
    data, length, row_of = np.zeros((1, _LONG), np.uint8), np.zeros(1, np.int64), np.zeros(256, np.int64)
    found = are_setpoints(data, length, 1)
    awaited_setpoints(data, found, row_of, np.zeros(1, np.bool_), np.zeros((1, 3), np.uint32))
