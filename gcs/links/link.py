"""The interface between the fleet and a transport, and what is counted and observed of its frames."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol, TypeAlias

from gcs.model.state import Setpoints, Telemetry, VehicleId

ParameterValue: TypeAlias = int | float
"""As the autopilot holds it: INT32 as int, FLOAT as float."""


class Verb(StrEnum):
    """Commands of an autopilot."""

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


class Direction(StrEnum):
    """Direction of a frame, seen from the ground."""

    SENT = "sent"
    RECEIVED = "received"


Observer: TypeAlias = Callable[[float, Direction, bytes, int], None]
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
    unsigned: int = 0  # refused, where signing is configured
    wrongly_signed: int = 0
    replayed: int = 0
    forwarded: int = 0
    not_forwarded: int = 0
    taken_from_others: int = 0  # frames of other ground stations, passed on to a vehicle
    refused_from_others: int = 0


class Link(Protocol):
    """Many vehicles behind one transport. Raises LinkError; the supervisor retries `run`."""

    @property
    def name(self) -> str: ...

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link, whether connected or not; never changes."""

    @property
    def problems(self) -> Sequence[str]:
        """Problems that do not end the flight but concern an operator, like a failed recording. In words."""

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles with recent frames of their system id from two addresses; the text names both."""

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Source of each vehicle's newest frame: all that a kill from another process needs."""

    @property
    def setpoints_sent(self) -> int: ...

    async def run(self) -> None:
        """Move bytes until cancelled. Raises LinkError when the transport cannot be opened."""

    def snapshot(self) -> Telemetry:
        """The newest telemetry of every vehicle, with arrival times. Never blocks."""

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's setpoints. Waits some milliseconds at most, and for no vehicle.

        A vehicle of this link that is not listed gets no further setpoint from the moment of the call; one
        that is listed gets none later than the watchdog's time after the last call that listed it.
        """

    async def execute(self, command: Command) -> None:
        """Send a command, and return when the vehicle's heartbeat confirms it.

        OFFBOARD needs setpoints already flowing for that vehicle. TAKEOFF returns when the climb has begun.

        Raises: CommandError with a reason a person can act on, when it refuses or does not answer in time.
        """

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """The autopilot's present values of `names`. Takes seconds, and delays no other vehicle.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter, when it does
        not exist or the vehicle does not answer (which cannot be distinguished).
        """

    def watch_parameters(self, names: Collection[str]) -> None:
        """Keep the values of these parameters that vehicles announce, whichever station set them."""

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """Newest values of watched parameters that vehicles announced since the last call."""

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Set one; an int only where the autopilot holds an INT32. To be certain, read it back.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter.
        """
