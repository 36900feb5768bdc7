"""The boundary between the fleet and a transport."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, TypeAlias

from gcs.links.address_book import Address
from gcs.model.state import Setpoints, Telemetry, VehicleId

ParameterValue: TypeAlias = int | float
"""As the autopilot holds it: INT32 as int, FLOAT as float."""


class Verb(StrEnum):
    """What an autopilot can be ordered to do."""

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
    """One order to one vehicle."""

    vehicle_id: VehicleId
    verb: Verb
    height_m: float = 0.0  # TAKEOFF only: above the place where it stands


class Link(Protocol):
    """Many vehicles behind one transport. Raises LinkError; the supervisor retries `run`."""

    @property
    def name(self) -> str:
        """As the configuration calls it."""
        ...

    @property
    def ids(self) -> tuple[VehicleId, ...]:
        """The vehicles configured on this link, heard or not; never changes."""
        ...

    @property
    def problems(self) -> Sequence[str]:
        """What does not end the flight, but an operator should know: a recording that fails. In words."""
        ...

    @property
    def conflicts(self) -> Mapping[VehicleId, str]:
        """Vehicles whose system id was heard lately from two addresses: both named in the text."""
        ...

    @property
    def addresses(self) -> Mapping[VehicleId, Address]:
        """Where each vehicle heard so far spoke from last: all that a kill from outside needs to know."""
        ...

    @property
    def setpoints_sent(self) -> int:
        """How many setpoints have left, in all."""
        ...

    async def run(self) -> None:
        """Move bytes until cancelled. Raises LinkError when the transport cannot be had."""
        ...

    def snapshot(self) -> Telemetry:
        """The newest known of every vehicle, with arrival times. Never blocks."""
        ...

    def send(self, setpoints: Setpoints) -> None:
        """Hand over one tick's orders. Waits some milliseconds at most, and for no vehicle.

        A vehicle of this link that is not listed gets no further setpoint from the moment of the call; one
        that is listed gets none later than the deadman's time after the last call that listed it.
        """
        ...

    async def execute(self, command: Command) -> None:
        """Order, and return when the vehicle is seen to obey (by its heartbeat).

        OFFBOARD needs setpoints already flowing for that vehicle. TAKEOFF returns when the climb has begun.
        Raises: CommandError with a reason a person can act on, when it refuses or does not answer in time.
        """
        ...

    async def read_parameters(
        self, vehicle_id: VehicleId, names: Sequence[str]
    ) -> Mapping[str, ParameterValue]:
        """What the autopilot holds now, for every one of `names`. Takes seconds, and blocks nobody else.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter, when there is
        no such one or the vehicle does not answer (which cannot be told apart).
        """
        ...

    def watch_parameters(self, names: Collection[str]) -> None:
        """Keep the values of these parameters that vehicles announce, whichever station set them."""
        ...

    def reported_parameters(self) -> Mapping[VehicleId, Mapping[str, ParameterValue]]:
        """Newest values of watched parameters that vehicles announced since the last call."""
        ...

    async def set_parameter(self, vehicle_id: VehicleId, name: str, value: ParameterValue) -> None:
        """Change one; an int only where the autopilot holds an INT32. Whoever needs to be sure reads it back.

        Raises: UnknownError for a vehicle of another link; CommandError naming the parameter.
        """
        ...
