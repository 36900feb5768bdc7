"""What passes between the fleet and a link, and what is counted and observed of its frames."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple, TypeAlias

from gcs.links.intake import Intake
from gcs.model.state import VehicleId

ParameterValue: TypeAlias = int | float
"""As the autopilot holds it: INT32 as int, FLOAT as float."""


class Verb(StrEnum):
    """Commands of an autopilot."""

    STANDBY = "standby"  # on the ground: the mode in which it can be armed
    ARM = "arm"
    DISARM = "disarm"
    TAKEOFF = "takeoff"
    HOLD = "hold"
    OFFBOARD = "offboard"
    LAND = "land"
    RETURN = "return"
    KILL = "kill"


@dataclass(frozen=True, slots=True)
class Command:
    """One command to one vehicle."""

    vehicle_id: VehicleId
    verb: Verb
    height_m: float = 0.0  # TAKEOFF only: above its position on the ground


class Address(NamedTuple):
    """Source of a system's frames, and the socket of ours that received them."""

    host: str
    port: int
    socket_index: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}" if self.port else self.host  # a serial port has none


class Absent(NamedTuple):
    """A vehicle of which other components are received, but not the autopilot."""

    problem: str
    to_do: str

    def __str__(self) -> str:
        return f"{self.problem}: {self.to_do}"


class FrameDirection(StrEnum):
    """Direction of a frame, seen from the ground."""

    SENT = "sent"
    RECEIVED = "received"


Observer: TypeAlias = Callable[[float, FrameDirection, bytes, int], None]
"""Called with the time, the direction, one whole frame, and its target or source system (0: all).

On the loop's thread; it must be quick.
"""


@dataclass(slots=True)
class Counters:
    """Totals since the link was created. Frames, except where the name says bytes."""

    received: int = 0
    sent: int = 0
    setpoints_sent: int = 0
    setpoints_dropped: int = 0  # not permitted: late, old, or repeated by MAVSDK
    commands_dropped: int = 0  # given before a kill, and repeated after it
    unroutable: int = 0  # for a system without an address yet
    send_errors: int = 0
    no_room: int = 0  # no room in a buffer: a slow serial port or connection
    garbage_bytes: int = 0
    unknown_bytes: int = 0  # of messages that pymavlink does not know: not checked, so not accepted
    strangers: int = 0
    duplicates: int = 0
    late_samples: int = 0  # dropped: older than the newest of their kind
    unsigned: int = 0  # refused, where signing is configured
    wrongly_signed: int = 0
    replayed: int = 0
    forwarded: int = 0
    not_forwarded: int = 0
    taken_from_others: int = 0  # frames of other ground stations, passed on to a vehicle
    refused_from_others: int = 0
    intakes: list[Intake] = field(default_factory=list)  # of the ports, and of further ground stations
