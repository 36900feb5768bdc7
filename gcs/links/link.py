"""The interface between the fleet and a transport."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeAlias

from gcs.links.address_book import Address
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


class Link(Protocol):
    """Many vehicles behind one transport. Raises LinkError; the supervisor retries `run`."""

    @property
    def name(self) -> str:
        """The name in the configuration."""
        ...

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link, whether connected or not; never changes."""
        ...

    @property
    def problems(self) -> Sequence[str]:
        """Problems that do not end the flight but concern an operator, like a failed recording. In words."""
        ...

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles with recent frames of their system id from two addresses; the text names both."""
        ...

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Source of each vehicle's newest frame: all that a kill from another process needs."""
        ...

    @property
    def setpoints_sent(self) -> int:
        """Total of setpoints sent."""
        ...

    async def run(self) -> None:
        """Move bytes until cancelled. Raises LinkError when the transport cannot be opened."""
        ...

    def snapshot(self) -> Telemetry:
        """The newest telemetry of every vehicle, with arrival times. Never blocks."""
        ...

    def send(self, setpoints: Setpoints) -> None:
        """Send one tick's setpoints. Waits some milliseconds at most, and for no vehicle.

        A vehicle of this link that is not listed gets no further setpoint from the moment of the call; one
        that is listed gets none later than the watchdog's time after the last call that listed it.
        """
        ...

    async def execute(self, command: Command) -> None:
        """Send a command, and return when the vehicle's heartbeat confirms it.

        OFFBOARD needs setpoints already flowing for that vehicle. TAKEOFF returns when the climb has begun.

        Raises: CommandError with a reason a person can act on, when it refuses or does not answer in time.
        """
        ...

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """The autopilot's present values of `names`. Takes seconds, and delays no other vehicle.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter, when it does
        not exist or the vehicle does not answer (which cannot be distinguished).
        """
        ...

    def watch_parameters(self, names: Collection[str]) -> None:
        """Keep the values of these parameters that vehicles announce, whichever station set them."""
        ...

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """Newest values of watched parameters that vehicles announced since the last call."""
        ...

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Set one; an int only where the autopilot holds an INT32. To be certain, read it back.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter.
        """
        ...
