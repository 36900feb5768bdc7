"""JSON schemas of the fleet's state, for REST, the streams and `gcs status`, and of answers to commands.

Units and frames as in `gcs.api.schemas.requests`. An unknown number is null, never NaN.
"""

from typing import TYPE_CHECKING, Annotated

from pydantic import BaseModel, ConfigDict, Field, create_model

from gcs.api.map_tiles import GroundMap
from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle, Orbit, YawPolicy
from gcs.model.settings import Measured
from gcs.model.state import Counts, Mode
from gcs.model.vehicle_columns import COLUMNS, FRAME, REST_ONLY
from gcs.service import (
    CueMark,
    Features,
    FlightEnvelope,
    Playback,
    SelectedShow,
    ShowAction,
    StationView,
    TickView,
)
from gcs.service.alarms import Alarm, OverallSeverity
from gcs.service.event_log import LogEvent


class Outward(BaseModel):
    """Base of response bodies. Clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class KillArmed(Outward):
    """The vehicles that the code will kill; nothing has been sent to them yet."""

    code: str
    vehicles: list[str]
    valid_s: float = Field(description="Time for which the code is valid.")


class Motion(Outward):
    """Position in both frames, and velocity, as far as known. Heights and `vup_m_s` are positive up."""

    x_m: Measured
    y_m: Measured
    height_m: Measured
    latitude_deg: Measured
    longitude_deg: Measured
    altitude_amsl_m: Measured
    vx_m_s: Measured
    vy_m_s: Measured
    vup_m_s: Measured


class Home(Outward):
    """Take-off position of a vehicle, in the show frame."""

    x_m: float
    y_m: float
    height_m: float


class VehicleRecord(Outward):
    """Data of one vehicle that changes seldom."""

    id: str
    system_id: int
    link: str
    autopilot: str = Field(description="Name of its autopilot's profile, as configured.")
    station: str | None = Field(
        description="The station that flies it; null: one station flies all, or none is known to fly this.",
        examples=["north"],
    )
    reason: str = Field(description="Why it is in its phase.")
    limited_by: str = Field(description="Why the safety filter limits the vehicle; empty: it does not.")
    home: Home | None = Field(description="null: it has not taken off.")
    fix_type: Annotated[int, Field(ge=0, le=255)] | None = Field(
        description="GPS_FIX_TYPE of its receiver, 3 and more with a height; null: not known."
    )


class _Vehicle(VehicleRecord, Motion):
    """One vehicle, as the service estimates it. Its numbers have the names of a frame's columns."""

    phase: Phase
    mode: Mode
    armed: bool
    landed: str = Field(description="Landed state, as the autopilot reports it.", examples=["on_ground"])
    ready: bool
    colour: str | None = Field(
        description="Colour of the vehicle in the show now; null: it flies in no show.", examples=["#ff8000"]
    )
    # of `gcs.model.vehicle_columns`, named for typed code: the schema has all of them
    heading_deg: Measured
    setpoint_x_m_s: Measured
    setpoint_y_m_s: Measured
    setpoint_up_m_s: Measured
    battery: Measured
    position_age_s: Measured
    heartbeat_age_s: Measured
    uncertainty_m: Measured
    link_quality: Measured
    low_s: Measured
    empty_s: Measured


_NUMBERS = {**FRAME, **{COLUMNS[name].api: COLUMNS[name] for name in REST_ONLY}}

if TYPE_CHECKING:
    Vehicle = _Vehicle
else:
    Vehicle = create_model(
        "Vehicle",
        __base__=_Vehicle,
        __doc__=_Vehicle.__doc__,
        __module__=__name__,
        **{name: (Measured, Field(description=column.described)) for name, column in _NUMBERS.items()},
    )


class FrameColumn(Outward):
    """A column of single precision in a frame."""

    name: str = Field(description="As in `Vehicle`.", json_schema_extra={"enum": list(FRAME)})
    unit: str = Field(description="share: 0 to 1.")
    label: str = Field(description="On the console's page of a vehicle; empty: it has its own place there.")


FRAME_COLUMNS = [
    FrameColumn(name=name, unit=column.unit, label=column.label) for name, column in FRAME.items()
]


class Estimates(Outward):
    """Energy and times of the fleet, updated once a second. null: not known, or not in progress."""

    battery_least: Measured = Field(
        description="0 to 1, of the vehicles that fly; where none does, of those that report."
    )
    battery_least_vehicle: str | None
    battery_median: Measured
    low_s: Measured = Field(
        description=(
            "Until the first vehicle reaches the low-battery threshold, from what it has used since take-off."
        )
    )
    low_vehicle: str | None = Field(description="The vehicle with that battery.")
    empty_s: Measured = Field(description="Time until the first battery is empty.")
    assembled_s: Measured = Field(description="Time until the formation is complete, while it assembles.")
    home_s: Measured = Field(
        description="Time until all vehicles have landed at their pads, if the return began now or has begun."
    )


class Show(Outward):
    """The show's phase, and the commands that it accepts now."""

    phase: ShowPhase
    reason: str
    possible: list[ShowAction] = Field(
        description="Accepted now: `start` while a start of all vehicles that are not left out would be."
    )
    start_refused: str = Field(
        description="Why that start would be refused now, in short; empty: it would not."
        " Looked at every 2 s on the ground, seldom of large fleets; preflight has all of it.",
        examples=["checklist pads: 2 of 3 items are open (+1)"],
    )
    selected: SelectedShow | None = Field(description="null: manual control of formation, target and orbit.")
    start_unix_time_s: float | None = Field(
        description="Commanded start time that is not reached yet; null: none."
    )
    countdown_s: float | None


class Formation(Outward):
    """Radius and height of the formation: desired, and commanded now; and its law."""

    radius_m: float
    height_m: float
    law: str
    radius_now_m: Measured
    height_now_m: Measured


class Center(Motion):
    """The formation's centre as commanded now."""


class Target(Outward):
    """Position and velocity of the target now, in both frames."""

    x_m: Measured
    y_m: Measured
    velocity_x_m_s: float
    velocity_y_m_s: float
    latitude_deg: Measured
    longitude_deg: Measured
    velocity_north_m_s: float
    velocity_east_m_s: float
    height_m: float
    clearance_m: float


class Yaw(Outward):
    """Yaw policy and heading of the vehicles."""

    policy: YawPolicy
    heading_deg: float = Field(description="Heading of the policy `fixed`.")


class AlarmList(Outward):
    """All alarms, and the overall severity."""

    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Lasting alarms before ended ones; the most severe first, of one severity the newest."
    )


class FleetSummary(Outward):
    """The state at one instant, without the vehicles."""

    time_s: float = Field(description="The service's monotonic clock.")
    unix_time_s: float
    control_reason: str = Field(description="Why control is not alive, empty when it is.")
    show: Show
    stations: list[StationView] = Field(
        description="Of the site, with the values at `time_s`; empty: one station flies all vehicles."
    )
    counts: Counts
    origin: ShowFrame
    formation: Formation
    target: Target = Field(description="Position of the target at `time_s`.")
    orbit: Orbit
    yaw: Yaw
    obstacles: list[Obstacle] = Field(description="Positions of the obstacles at `time_s`.")
    interrupted: InterruptedFlight | None = Field(
        description="An interrupted flight that is not settled yet; null: none."
    )
    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Most severe first, newest first within a severity; alarms that have ended come last."
    )
    estimates: Estimates | None = Field(description="Estimates at `time_s`; null in a replay.")
    features: Features = Field(description="What each feature reports, with the values at `time_s`.")
    access: str = Field(description="Whether the service demands tokens, in words.")


class Fleet(FleetSummary):
    """The whole state at one instant."""

    control_alive: bool = Field(description="False also when this state is old; in a replay only then.")
    center: Center | None = Field(description="null while no formation flies.")
    minimum_separation_m: Measured
    setpoints_sent: int
    filter_interventions: int = Field(
        description="Setpoints that the safety filter has changed, counted per vehicle and tick."
    )
    tick: TickView
    vehicles: list[Vehicle]


class Status(FleetSummary):
    """Data that changes seldom: the text messages of the console's stream."""

    revision: int = Field(
        description="Increases with every change; a frame names the revision it belongs to."
    )
    began_unix_time_s: float = Field(
        description="When this process began to serve; a restarted service has another time."
    )
    timeline: list[CueMark] = Field(description="Cues of the selected show, loops written out.")
    shows_refused: str = Field(
        description="Why show files cannot be uploaded to this service, empty when they can."
    )
    map: GroundMap | None = Field(description="null: none is configured.")
    flight_envelope: FlightEnvelope
    limits: list[str] = Field(
        description="Reasons for which the safety filter limits vehicles now, each once."
    )
    replay: Playback | None = Field(description="null: this is no replay.")
    events: list[LogEvent] = Field(description="The newest 100, the newest last.")
    columns: list[FrameColumn] = Field(description="Of a frame, in their order.")
    vehicles: list[VehicleRecord] = Field(description="In the order of the rows of a frame's columns.")
