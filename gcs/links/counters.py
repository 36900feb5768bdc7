"""What passes the wire: counted, and shown to whoever wants to see it."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias


class Direction(StrEnum):
    """Seen from the ground."""

    SENT = "sent"
    RECEIVED = "received"


Observer: TypeAlias = Callable[[float, Direction, bytes, int], None]
"""Called with the time, the direction, one whole frame, and the system it is for or from (0: everybody).

On the loop's thread for received frames and on MAVSDK's for sent ones: quick, and safe on both.
"""


@dataclass(slots=True)
class Counters:
    """What passed and what did not, since the wire was made. Frames, except where it says bytes."""

    received: int = 0
    sent: int = 0
    setpoints_sent: int = 0
    setpoints_dropped: int = 0  # not permitted: late, old, or repeated by MAVSDK
    heartbeats_withheld: int = 0  # of ours, while control was dead
    commands_dropped: int = 0  # ordered before a kill, and repeated behind it
    unroutable: int = 0  # for a system not heard yet
    send_errors: int = 0
    no_room: int = 0  # for want of room in a buffer: a slow serial port or connection
    garbage_bytes: int = 0
    unknown_bytes: int = 0  # of messages that pymavlink does not know: not checked, so not taken
    strangers: int = 0
    duplicates: int = 0
    unsigned: int = 0  # refused, where signatures are configured
    wrongly_signed: int = 0
    replayed: int = 0
    not_signed: int = 0  # of ours: not sent, since nobody told us the checksum of such a message
    recorded: int = 0
    not_recorded: int = 0  # the disk was full, gone or slow
    forwarded: int = 0
    not_forwarded: int = 0
    taken_from_others: int = 0  # other ground stations' frames, passed on to a vehicle
    refused_from_others: int = 0
