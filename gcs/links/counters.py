"""Counters and observers of the frames on a link."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias


class Direction(StrEnum):
    """Direction of a frame, seen from the ground."""

    SENT = "sent"
    RECEIVED = "received"


Observer: TypeAlias = Callable[[float, Direction, bytes, int], None]
"""Called with the time, the direction, one whole frame, and its target or source system (0: all).

On the loop's thread for received frames and on MAVSDK's for sent ones: it must be quick, and safe on both.
"""


@dataclass(slots=True)
class Counters:
    """Totals since the link was created. Frames, except where the name says bytes."""

    received: int = 0
    sent: int = 0
    setpoints_sent: int = 0
    setpoints_dropped: int = 0  # not permitted: late, old, or repeated by MAVSDK
    heartbeats_withheld: int = 0  # our own, while control did not run
    commands_dropped: int = 0  # given before a kill, and repeated after it
    unroutable: int = 0  # for a system without an address yet
    send_errors: int = 0
    no_room: int = 0  # no room in a buffer: a slow serial port or connection
    garbage_bytes: int = 0
    unknown_bytes: int = 0  # of messages that pymavlink does not know: not checked, so not accepted
    strangers: int = 0
    duplicates: int = 0
    unsigned: int = 0  # refused, where signing is configured
    wrongly_signed: int = 0
    replayed: int = 0
    not_signed: int = 0  # our own, not sent: the checksum seed of the message is unknown
    forwarded: int = 0
    not_forwarded: int = 0
    taken_from_others: int = 0  # frames of other ground stations, passed on to a vehicle
    refused_from_others: int = 0
