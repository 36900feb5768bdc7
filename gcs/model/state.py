"""Batches that cross the boundaries: one array row per vehicle, frozen, checked on construction.

Times are seconds of the event loop's clock (``loop.time()``, monotonic). The show frame is x along the
show's heading, y to its right, z down; see ``gcs.model.frames``.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum, StrEnum
from operator import attrgetter
from typing import Annotated, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, computed_field

from gcs.model.errors import ShapeError
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.response import FleetResponse

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Bits: TypeAlias = NDArray[np.int64]
VehicleId: TypeAlias = str

TINY = 1e-9
"""A shorter vector has no direction."""

FIX_3D: Final = 3
"""Least GPS_FIX_TYPE with which positions are trusted."""


class Mode(StrEnum):
    """Flight mode as the autopilot's heartbeat reports it; OTHER is any mode this station never commands."""

    __hash__ = str.__hash__  # Enum's own is written in Python, and a tick hashes thousands of times

    UNKNOWN = "unknown"
    READY = "ready"
    TAKEOFF = "takeoff"
    HOLD = "hold"
    OFFBOARD = "offboard"
    RETURN = "return"
    LAND = "land"
    POSITION = "position"
    OTHER = "other"
    TERMINATED = "terminated"  # whatever its own mode is: it has stopped its motors in flight


class Landed(IntEnum):
    """MAV_LANDED_STATE, as EXTENDED_SYS_STATE carries it."""

    UNKNOWN = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


def freeze(array: Array | Bits | Mask, shape: tuple[int, ...], what: str) -> None:
    """Check an array's shape, and make the array read-only.

    Raises: ShapeError, naming `what`, when the shape differs.
    """
    if array.shape != shape:
        raise ShapeError(f"{what}: {array.shape} where {shape} is needed")
    array.setflags(write=False)


@dataclass(frozen=True, slots=True)
class StatusText:
    """A STATUSTEXT of an autopilot."""

    time_s: float  # of its arrival
    severity: int  # MAV_SEVERITY: 0 emergency to 7 debug
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """The newest telemetry of each vehicle of one link. Owns its arrays.

    Every group of values has its own time of arrival, ``-inf`` before the first, so that old values cannot
    pass as new ones.
    """

    ids: tuple[VehicleId, ...]
    position_time_s: Array  # (n,) arrival of the newest global position
    heartbeat_time_s: Array  # (n,) arrival of the newest heartbeat
    life_time_s: Array  # (n,) arrival of any message from its autopilot
    latitude_deg: Array  # (n,) WGS84, NaN before the first
    longitude_deg: Array  # (n,)
    altitude_amsl_m: Array  # (n,)
    velocity_ned_m_s: Array  # (n, 3)
    yaw_deg: Array  # (n,) clockwise from north
    attitude_rad: Array  # (n, 3) roll, pitch and yaw of ATTITUDE, NaN before the first
    attitude_time_s: Array  # (n,) its arrival
    battery_remaining: Array  # (n,) 0 to 1, NaN when unknown
    armed: tuple[bool, ...]  # from HEARTBEAT
    mode: tuple[Mode, ...]  # from HEARTBEAT
    in_failsafe: tuple[bool, ...]  # from HEARTBEAT: the autopilot reports a failsafe
    landed: tuple[Landed, ...]
    ready: tuple[bool, ...]  # the autopilot reports that it can be armed
    horizontal_accuracy_m: Array  # (n,) as its receiver reports, one sigma; NaN unknown, inf without a fix
    vertical_accuracy_m: Array  # (n,)
    gnss_altitude_amsl_m: Array  # (n,) as its receiver reports, not its estimator; NaN without a fix
    reboot_count: tuple[int, ...]  # how often its boot clock has begun anew
    position_resets: tuple[int, ...]  # how often its estimator reported a position reset
    fix_type: Array  # (n,) GPS_FIX_TYPE of its receiver, 3 and more with a height; NaN unknown
    unhealthy_sensors: Bits  # (n,) of MAV_SYS_STATUS_SENSOR: sensors in use and unhealthy; -1 unknown
    clock_base_s: Array  # (n,) its own clock (Unix time) when the loop's clock was 0; NaN unknown
    round_trip_s: Array  # (n,) from a request of ours to its newest answer (TIMESYNC); NaN unknown
    position_clock_s: Array  # (n,) its own clock as it sent its newest position, of any origin; NaN unknown
    position_late_s: Array  # (n,) by how much its newest position is older than what it could be; 0 unknown
    texts: tuple[tuple[StatusText, ...], ...]  # (n,) its last few status texts, the oldest first
    version: tuple[int, ...]  # flight_sw_version of its AUTOPILOT_VERSION, 0: not reported

    def __post_init__(self) -> None:
        n = len(self.ids)
        for name, column in zip(_TELEMETRY, _TELEMETRY_COLUMNS(self), strict=True):
            if isinstance(column, np.ndarray):
                if column.shape != ((n, 3) if name in ("velocity_ned_m_s", "attitude_rad") else (n,)):
                    raise ShapeError(f"{name}: {column.shape} for {n} vehicles")
                column.setflags(write=False)
            elif len(column) != n:
                raise ShapeError(f"{name}: {len(column)} values for {n} vehicles")


_TELEMETRY: Final = tuple(field.name for field in fields(Telemetry))
_TELEMETRY_COLUMNS: Final = attrgetter(*_TELEMETRY)


@dataclass(frozen=True, slots=True, eq=False)
class FleetState:
    """State of every vehicle at one instant, in the show frame. Owns its arrays.

    Positions are brought forward from their arrival to `time_s` with the reported velocity. Rows of vehicles
    without telemetry are NaN.
    """

    time_s: float
    ids: tuple[VehicleId, ...]
    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)
    yaw_rad: Array  # (n,) from the show's x axis, towards y
    age_s: Array  # (n,) since the newest position arrived, inf before the first
    doubtful: Mask = field(  # (n,) its positions are not to be trusted: no 3D fix; empty: they all are
        default_factory=lambda: np.zeros(0, np.bool_)
    )

    def __post_init__(self) -> None:
        n = len(self.ids)
        if not len(self.doubtful):
            object.__setattr__(self, "doubtful", np.zeros(n, np.bool_))
        freeze(self.position_m, (n, 3), "position_m")
        freeze(self.doubtful, (n,), "doubtful")
        freeze(self.velocity_m_s, (n, 3), "velocity_m_s")
        freeze(self.yaw_rad, (n,), "yaw_rad")
        freeze(self.age_s, (n,), "age_s")


@dataclass(frozen=True, slots=True, eq=False)
class Traits:
    """In what the vehicles differ from each other. Rows as in FleetState. Owns its arrays."""

    charge: Array  # (n,) share of the sphere, above 0; 1 for equal shares
    speed_max_m_s: Array  # (n,) in any direction; inf: only the fleet's limits apply
    uncertainty_m: Array  # (n,) standard deviation of the reported position, sideways; up as the floor has it
    response: FleetResponse  # to setpoints

    def __post_init__(self) -> None:
        n = len(self.charge)
        for name in ("charge", "speed_max_m_s", "uncertainty_m"):
            freeze(getattr(self, name), (n,), name)
        if len(self.response) != n:
            raise ShapeError(f"response: of {len(self.response)} vehicles where {n} are needed")

    @staticmethod
    def alike(count: int, uncertainty_m: float = 0.0) -> "Traits":
        """Equal shares, no speed limit but the fleet's, one uncertainty."""
        return Traits(
            np.ones(count),
            np.full(count, np.inf),
            np.full(count, uncertainty_m),
            FleetResponse.alike(count),
        )

    def rows(self, rows: NDArray[np.intp]) -> "Traits":
        """Those in rows (m,)."""
        return Traits(
            self.charge[rows],
            self.speed_max_m_s[rows],
            self.uncertainty_m[rows],
            self.response.rows(rows),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Setpoints:
    """Velocity setpoints of one tick, in the show frame. A vehicle not listed is not commanded."""

    time_s: float
    ids: tuple[VehicleId, ...]
    velocity_m_s: Array  # (n, 3)
    yaw_rad: Array  # (n,)

    def __post_init__(self) -> None:
        freeze(self.velocity_m_s, (len(self.ids), 3), "velocity_m_s")
        freeze(self.yaw_rad, (len(self.ids),), "yaw_rad")


KILLED_RECEIVED_S: Final = 3.0
"""Age from which the landed state of a killed vehicle does not count; heartbeats come once a second."""


class Whereabouts(StrEnum):
    """Where one vehicle is, as far as known; each vehicle is in exactly one of these."""

    __hash__ = str.__hash__

    CONTROLLED = "controlled"  # airborne, under this station's control
    UNCONTROLLED = "uncontrolled"  # airborne, under a pilot's or its own autopilot's control
    UNKNOWN = "unknown"  # lost in flight or killed, and not confirmed on the ground
    ON_GROUND = "on ground"
    OFFLINE = "offline"


@dataclass(frozen=True, slots=True)
class Counts:
    """Numbers of vehicles by where they are and what controls them; the five fields add up to the fleet."""

    controlled: Annotated[int, Field(description="Airborne, under this station's control.")]
    uncontrolled: Annotated[
        int, Field(description="Airborne, under a pilot's or its own autopilot's control.")
    ]
    unknown: Annotated[int, Field(description="Lost in flight or killed, and not confirmed on the ground.")]
    on_ground: int
    offline: int

    @computed_field  # type: ignore[prop-decorator]
    @property
    def airborne(self) -> int:
        """In the air, controlled or not."""
        return self.controlled + self.uncontrolled


def whereabouts(phase: Phase, landed: Landed, *, armed: bool, heartbeat_age_s: float) -> Whereabouts:
    """Where a vehicle is, from its phase and from what its autopilot reports.

    A vehicle that is armed on its pad stands on the ground whatever its phase is. A lost vehicle is unknown.
    A killed vehicle is unknown until it reports that it is on the ground. If it still reports running motors,
    the kill has not worked, and it flies.
    """
    if phase is Phase.OFFLINE:
        return Whereabouts.OFFLINE
    if phase is Phase.LOST:
        return Whereabouts.UNKNOWN
    if phase is Phase.STANDBY:
        return Whereabouts.ON_GROUND
    if phase is Phase.KILLED:
        if not heartbeat_age_s <= KILLED_RECEIVED_S:
            return Whereabouts.UNKNOWN
        if landed is Landed.ON_GROUND:
            return Whereabouts.ON_GROUND
        return Whereabouts.UNCONTROLLED if armed else Whereabouts.UNKNOWN
    if landed is Landed.ON_GROUND:
        return Whereabouts.ON_GROUND
    return Whereabouts.CONTROLLED if phase in AIRBORNE else Whereabouts.UNCONTROLLED


def counts_of(
    phases: Sequence[Phase],
    landed: Sequence[Landed],
    armed: Sequence[bool],
    heartbeat_age_s: Iterable[float],
) -> Counts:
    """Count a fleet; each argument has one entry for every vehicle."""
    counted = [
        whereabouts(phase, down, armed=is_armed, heartbeat_age_s=age_s)
        for phase, down, is_armed, age_s in zip(phases, landed, armed, heartbeat_age_s, strict=True)
    ]
    return Counts(**{where.name.lower(): counted.count(where) for where in Whereabouts})
