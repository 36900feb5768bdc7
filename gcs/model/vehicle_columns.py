"""The numbers of each vehicle: one row for each, with its name in every place that shows it.

The view of a tick, the REST schema, the console's frames and types, the record, metrics and the bus between
stations are made from these rows. A new number is one row of `VehicleNumbers`, and the line in
`gcs.flight.monitors.snapshots.measured` that measures it. `make schema` then adds it to the console's types.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple, get_type_hints

import numpy as np

from gcs.model.state import Array

SHARE: Final = "share"
"""Unit of a number from 0 to 1."""

STATION, AUTOPILOT = "station", "autopilot"
"""What measures a number."""


class ByteSteps(NamedTuple):
    """How one byte holds a number: 0 to 254 steps above the least; 255: not known."""

    step: float
    least: float = 0.0


@dataclass(frozen=True, slots=True)
class Column:
    """What a number is, and what it is called where. An empty name, or None: it is not there."""

    unit: str
    by: str  # STATION or AUTOPILOT
    meaning: str
    api: str = ""  # in the REST schema `Vehicle`, and in the console's frames
    in_frame: bool = True  # False: in REST only
    label: str = ""  # on the console's page of a vehicle; empty: that page has a place of its own for it
    record: str = ""  # in the flight data
    bus: ByteSteps | None = None  # how a station sends it to the others
    metric: str = ""

    @property
    def described(self) -> str:
        return f"{self.meaning}. Measured by the {self.by}."


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VehicleNumbers:
    """Columns (n,) of n vehicles. NaN (or inf): not known."""

    yaw_rad: Annotated[
        Array, Column("rad", AUTOPILOT, "Yaw in the show frame, from its x axis", record="yaw_rad")
    ]
    roll_rad: Annotated[Array, Column("rad", AUTOPILOT, "Roll, right side down positive", record="roll_rad")]
    pitch_rad: Annotated[Array, Column("rad", AUTOPILOT, "Pitch, nose up positive", record="pitch_rad")]
    latitude_deg: Annotated[
        Array, Column("deg", AUTOPILOT, "Latitude, WGS84", api="latitude_deg", in_frame=False)
    ]
    longitude_deg: Annotated[
        Array, Column("deg", AUTOPILOT, "Longitude, WGS84", api="longitude_deg", in_frame=False)
    ]
    altitude_amsl_m: Annotated[
        Array, Column("m", AUTOPILOT, "Above mean sea level", api="altitude_amsl_m", in_frame=False)
    ]
    battery_remaining: Annotated[
        Array,
        Column(
            SHARE,
            AUTOPILOT,
            "Remaining share of the battery, 0 to 1",
            api="battery",
            record="battery_remaining",
            bus=ByteSteps(0.01),
            metric="gcs_vehicle_battery_ratio",
        ),
    ]
    position_age_s: Annotated[
        Array,
        Column(
            "s",
            STATION,
            "Time since the newest position arrived",
            api="position_age_s",
            label="Position age",
            record="position_age_s",
            metric="gcs_vehicle_position_age_seconds",
        ),
    ]
    heartbeat_age_s: Annotated[
        Array,
        Column(
            "s",
            STATION,
            "Time since the newest heartbeat arrived",
            api="heartbeat_age_s",
            label="Heartbeat age",
            record="heartbeat_age_s",
            metric="gcs_vehicle_heartbeat_age_seconds",
        ),
    ]
    uncertainty_m: Annotated[
        Array,
        Column(
            "m",
            STATION,
            "Standard deviation sideways: as reported, at least what its kind of fix can mean",
            api="uncertainty_m",
            record="position_uncertainty_m",
            metric="gcs_vehicle_position_uncertainty_meters",
        ),
    ]
    link_quality: Annotated[
        Array,
        Column(
            SHARE,
            STATION,
            "Share of the requested positions that arrive, 0 to 1; null in a replay",
            api="link_quality",
            label="Link quality",
            bus=ByteSteps(0.01),
            metric="gcs_vehicle_link_quality",
        ),
    ]
    fix_type: Annotated[Array, Column("GPS_FIX_TYPE", AUTOPILOT, "Kind of its receiver's fix")]


COLUMNS: Final[Mapping[str, Column]] = {
    name: hint.__metadata__[0] for name, hint in get_type_hints(VehicleNumbers, include_extras=True).items()
}
"""The rows, by the names of their fields."""

COMPUTED: Final[Mapping[str, Column]] = {
    "x_m": Column("m", STATION, "Position along the show's heading, brought forward to the tick"),
    "y_m": Column("m", STATION, "Position to the right of the show's heading, brought forward to the tick"),
    "height_m": Column("m", STATION, "Height above the show's origin, brought forward to the tick"),
    "vx_m_s": Column("m/s", AUTOPILOT, "Velocity along the show's heading"),
    "vy_m_s": Column("m/s", AUTOPILOT, "Velocity to the right of the show's heading"),
    "vup_m_s": Column("m/s", AUTOPILOT, "Velocity upwards"),
    "heading_deg": Column("deg", AUTOPILOT, "Heading clockwise from north: 0 up to, without, 360"),
    "setpoint_x_m_s": Column("m/s", STATION, "Velocity sent in the last tick; null: not commanded"),
    "setpoint_y_m_s": Column("m/s", STATION, "Velocity sent in the last tick, to the right"),
    "setpoint_up_m_s": Column("m/s", STATION, "Velocity sent in the last tick, upwards"),
    "low_s": Column(
        "s", STATION, "Time until the battery reaches the low-battery threshold, 0 below it; null: unknown"
    ),
    "empty_s": Column("s", STATION, "Time until the battery is empty; null: not known yet"),
}
"""What the API and frames show of vectors and estimates, by its name there: `binary_frame` computes it."""

IN_FRAME: Final = tuple(name for name, column in COLUMNS.items() if column.api and column.in_frame)
"""Numbers of a frame, by the names of their fields."""

FRAME: Final[Mapping[str, Column]] = {**COMPUTED, **{COLUMNS[name].api: COLUMNS[name] for name in IN_FRAME}}
"""Columns of single precision in a frame, by their names there, in their order."""

REST_ONLY: Final = tuple(name for name, column in COLUMNS.items() if column.api and not column.in_frame)

RECORDED: Final = {name: column.record for name, column in COLUMNS.items() if column.record}
"""Names in the flight data."""

SENT: Final = {name: column.bus for name, column in COLUMNS.items() if column.bus is not None}
"""What stations send each other, in this order."""


def unknown(count: int) -> dict[str, Array]:
    """Every number of so many vehicles, not known."""
    return dict.fromkeys(COLUMNS, np.full(count, np.nan))
