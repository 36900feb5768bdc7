"""JSON schemas of the REST API: request and response bodies.

Names end in their unit. Positions are in the show frame, with heights positive up (`height_m`, above the
show's origin); headings are in degrees clockwise from north. An unknown number is null, never NaN.
Requests are strict: an unknown field, a number in quotes, NaN and infinities are refused.
"""

from math import isfinite
from typing import Annotated, Any, Final

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from gcs.api.schemas.alarms import Alarm
from gcs.api.schemas.names import VehicleName
from gcs.api.schemas.recovery import InterruptedFlight
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Direction, YawPolicy
from gcs.model.state import Mode
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import OverallSeverity

LENGTH_MAX_M: Final = 100_000.0
"""Largest coordinate: beyond it a flat show frame and its conversion to and from WGS84 are invalid."""

SPEED_MAX_M_S: Final = 1_000.0
"""Largest plausible speed; the service decides which speeds can be flown."""


def _known(value: object) -> object:
    """Convert NaN and infinities to None (not known)."""
    return None if isinstance(value, float) and not isfinite(value) else value


def _whole_change(value: object) -> object:
    """Refuse a change without any field: it is a mistake of the client."""
    if isinstance(value, dict) and not value:
        raise PydanticCustomError("empty_change", "at least one field")
    return value


def without_defaults(schema: dict[str, Any]) -> None:
    """Remove defaults from the schema: they are internal placeholders of absent fields."""
    for field in schema.get("properties", {}).values():
        field.pop("default", None)


HASH_PATTERN: Final = r"^[0-9a-f]{64}$"
HASH_EXAMPLE: Final = "4f0c8dd7e2a6b1935c7e0f8a9b6d5c4e3f2a1b0c9d8e7f6a5b4c3d2e1f0a9b8c"


def _at_least_one(schema: dict[str, Any]) -> None:
    """Remove defaults, and demand at least one field."""
    without_defaults(schema)
    schema["minProperties"] = 1


ABSENT: Final[Any] = None
"""Placeholder of optional fields; never read, because only given fields count."""

Measured = Annotated[float | None, BeforeValidator(_known)]
Coordinate = Annotated[float, Field(ge=-LENGTH_MAX_M, le=LENGTH_MAX_M, examples=[12.5])]
Length = Annotated[float, Field(gt=0, le=LENGTH_MAX_M, examples=[10.0])]
Speed = Annotated[float, Field(gt=0, le=SPEED_MAX_M_S, examples=[2.0])]
Velocity = Annotated[float, Field(ge=-SPEED_MAX_M_S, le=SPEED_MAX_M_S, examples=[0.5])]
Heading = Annotated[
    float, Field(ge=-360, le=360, description="Degrees clockwise from north.", examples=[90.0])
]
ObstacleId = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$", examples=["tower"])]
Sense = Annotated[Direction, Field(strict=False, description="Seen from above.")]
Policy = Annotated[YawPolicy, Field(strict=False)]


class Inward(BaseModel):
    """Base of request bodies: strict, and validated as a whole before use."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Change(Inward):
    """Base of changes: absent fields stay as they are."""

    model_config = ConfigDict(json_schema_extra=_at_least_one)

    _something = model_validator(mode="before")(_whole_change)

    def given(self) -> dict[str, Any]:
        """Return the fields of the request, by name."""
        return self.model_dump(exclude_unset=True)


class Outward(BaseModel):
    """Base of response bodies. Clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True, extra="ignore")


# In


class FormationChange(Change):
    """New radius or height of the formation, which changes continuously."""

    radius_m: Length = Field(default=ABSENT, description="Radius of the virtual sphere.")
    height_m: Coordinate = Field(default=ABSENT, description="Height of the centre above the show's origin.")


class OrbitChange(Change):
    """New radius, speed or direction of the orbit of the formation's centre around the target."""

    radius_m: Annotated[float, Field(ge=0, le=LENGTH_MAX_M)] = Field(
        default=ABSENT,
        description="Radius of the orbit; 0: the formation stands above the target.",
        examples=[30.0],
    )
    speed_m_s: Speed = Field(default=ABSENT, description="Speed relative to the target.")
    direction: Sense = Field(default=ABSENT)


class YawChange(Change):
    """New yaw policy or heading of the vehicles; the heading applies to the policy `fixed`."""

    policy: Policy = Field(default=ABSENT)
    heading_deg: Heading = Field(default=ABSENT)


class ShowTarget(Inward):
    """The target's position and velocity in the show frame."""

    x_m: Coordinate
    y_m: Coordinate
    velocity_x_m_s: Velocity = 0.0
    velocity_y_m_s: Velocity = 0.0


class GeodeticTarget(Inward):
    """The target's position and velocity in WGS84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90, examples=[47.3977])]
    longitude_deg: Annotated[float, Field(ge=-180, le=180, examples=[8.5456])]
    velocity_north_m_s: Velocity = 0.0
    velocity_east_m_s: Velocity = 0.0


TARGET_FRAMES: Final[dict[str, type[Inward]]] = {"show frame": ShowTarget, "geodetic": GeodeticTarget}


def _target_frame(value: object) -> str | None:
    """Return the tag of the frame whose fields are given; None: of neither, or of both."""
    if not isinstance(value, dict):
        return None
    meant = [tag for tag, model in TARGET_FRAMES.items() if value.keys() & model.model_fields.keys()]
    return meant[0] if len(meant) == 1 else None


TargetPut = Annotated[
    Annotated[ShowTarget, Tag("show frame")] | Annotated[GeodeticTarget, Tag("geodetic")],
    Discriminator(
        _target_frame,
        custom_error_type="target_frame",
        custom_error_message=(
            "either x_m, y_m, velocity_x_m_s, velocity_y_m_s or latitude_deg, longitude_deg,"
            " velocity_north_m_s, velocity_east_m_s: one frame, not both"
        ),
    ),
]


class Box(Inward):
    """A box on the ground, edges along the show frame's axes, at its position now; it keeps its velocity."""

    x_m: Coordinate = Field(description="North coordinate of the centre in the show frame.")
    y_m: Coordinate
    half_length_x_m: Length
    half_length_y_m: Length
    height_m: Length = Field(description="Height of the top above the show's origin.")
    velocity_x_m_s: Velocity = 0.0
    velocity_y_m_s: Velocity = 0.0


class ObstaclePost(Box):
    """A new obstacle; without an id the service assigns one."""

    model_config = ConfigDict(json_schema_extra=without_defaults)

    id: ObstacleId = Field(default=ABSENT, description="Absent: the service assigns an id.")


class ObstaclePut(Box):
    """The new state of an obstacle; an id, if given, must be that of the path."""

    model_config = ConfigDict(json_schema_extra=without_defaults)

    id: ObstacleId = Field(default=ABSENT, description="May be left out: the path names it.")


class StartBody(Inward):
    """The vehicles, the selected show and the time of a start."""

    model_config = ConfigDict(json_schema_extra=without_defaults)

    vehicles: Annotated[
        list[VehicleName], Field(min_length=1, max_length=10_000, examples=[["d1", "d2"]])
    ] = Field(default=ABSENT, description="Absent: every vehicle that is online.")
    show_hash: Annotated[str, Field(pattern=HASH_PATTERN, examples=[HASH_EXAMPLE])] = Field(
        default=ABSENT,
        description="Hash of the selected show, as its check reports it. Absent: none is selected.",
    )
    at_unix_time_s: Annotated[float, Field(gt=0, le=1e11, examples=[1795000000.0])] = Field(
        default=ABSENT, description="Take-off time, in s since 1970. Absent: now."
    )


class GroupBody(Inward):
    """The vehicles of a command."""

    model_config = ConfigDict(json_schema_extra=without_defaults)

    vehicles: Annotated[list[str], Field(min_length=1, max_length=10_000, examples=[["d1", "d2"]])] = Field(
        default=ABSENT, description="Absent: every vehicle that the command can apply to."
    )


# Out


class Problem(Outward):
    """One invalid field."""

    field: str = Field(description="Dotted name; `body` for the whole.", examples=["radius_m"])
    value: str | int | float | bool | None = Field(
        description='The value received; text where JSON cannot hold it ("NaN").', examples=[1.0]
    )
    allowed: str = Field(description="What is allowed.", examples=["at least 6.2 m for 12 vehicles"])


class ErrorBody(Outward):
    """The common shape of every error."""

    detail: str = Field(
        description="The error in words, for a person.", examples=["radius_m = 1.0: at least 6.2 m"]
    )
    problems: list[Problem] = Field(
        description="The fields that are wrong, for a program; empty: no field is."
    )


class Health(Outward):
    """Whether the control loop runs and its newest state is fresh."""

    alive: bool
    view_age_s: float = Field(description="Age of the newest state.")
    tick_rate_hz: Measured
    access: str = Field(description="Whether the service demands tokens, in words.", examples=["tokens"])
    emergency_port: int | None = Field(description="Port of the emergency listener; null: there is none.")


class Readiness(Outward):
    """Whether at least one vehicle can be commanded."""

    ready: bool
    vehicles_ready: int = Field(description="Vehicles that could start now.")
    vehicles_airborne: int
    vehicles: int = Field(description="Configured vehicles.")


class Position(Outward):
    """A position in both frames, as far as known."""

    x_m: Measured
    y_m: Measured
    height_m: Measured
    latitude_deg: Measured
    longitude_deg: Measured
    altitude_amsl_m: Measured


class VelocityOut(Outward):
    """A velocity in the show frame, positive up."""

    x_m_s: Measured
    y_m_s: Measured
    up_m_s: Measured


class Vehicle(Outward):
    """One vehicle, as the service estimates it."""

    id: str
    system_id: int
    link: str
    phase: Phase
    reason: str
    mode: Mode
    armed: bool
    landed: str = Field(description="Landed state, as the autopilot reports it.", examples=["on_ground"])
    ready: bool
    position: Position
    velocity: VelocityOut | None
    heading_deg: Measured
    battery_remaining: Measured = Field(description="Remaining share of the battery, 0 to 1.")
    position_age_s: Measured
    position_uncertainty_m: float = Field(
        description="Horizontal position uncertainty: as configured, more for a poor fix or after a jump."
    )
    heartbeat_age_s: Measured
    link_quality: float | None = Field(
        description="Share of the requested positions that arrive, 0 to 1; null in a replay."
    )
    setpoint: VelocityOut | None = Field(description="Sent in the last tick; null: not commanded.")
    limited_by: str = Field(description="Why the safety filter limited the vehicle; empty: it did not.")
    low_s: Measured = Field(
        description="Time until the battery reaches the low-battery threshold, 0 below it; null: unknown."
    )
    empty_s: Measured = Field(description="Time until the battery is empty; null: not known yet.")
    light: str | None = Field(
        description="Colour of the vehicle in the show now; null: it flies in no show.", examples=["#ff8000"]
    )


class Counts(Outward):
    """Numbers of vehicles by where they are and what controls them."""

    airborne: int = Field(description="controlled + uncontrolled.")
    controlled: int = Field(description="Airborne, under this station's control.")
    uncontrolled: int = Field(description="Airborne, under a pilot's or its own autopilot's control.")
    unknown: int = Field(description="Lost in flight or killed, and not confirmed on the ground.")
    on_ground: int
    offline: int


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


class SelectedShow(Outward):
    """The written show that is or will be flown, and its progress."""

    name: str
    hash: str
    cue: str = Field(description="The newest cue.")
    cues: list[str]
    clock_s: float = Field(description="The show's own time; 0 when the first sphere stands.")
    duration_s: float
    runs: bool = Field(
        description="Whether the show's clock runs; false before the show begins and while it is paused."
    )
    target_is_live: bool = Field(description="Whether PUT target moves the target now.")


class Show(Outward):
    """The show's phase, and the commands that it accepts now."""

    phase: ShowPhase
    reason: str
    possible: list[ShowAction]
    selected: SelectedShow | None = Field(description="null: manual control of formation, target and orbit.")
    start_unix_time_s: float | None = Field(
        description="Commanded start time that is not reached yet; null: none."
    )
    countdown_s: float | None


class CommandPart(Outward):
    """Outcome of a command for one vehicle."""

    outcome: Outcome
    reason: str


class Command(Outward):
    """An accepted command and its outcome."""

    id: str
    action: str
    by: str = Field(
        description="Name of the token; `local` without tokens, `service` for the service itself."
    )
    accepted_unix_time_s: float
    outcome: Outcome = Field(
        description="pending while any vehicle is pending, then failed if any vehicle failed, else done."
    )
    vehicles: dict[str, CommandPart]


class Formation(Outward):
    """Radius and height of the formation: desired, and commanded now."""

    radius_m: float
    height_m: float
    radius_now_m: Measured
    height_now_m: Measured


class Center(Outward):
    """The formation's centre as commanded now."""

    position: Position
    velocity: VelocityOut | None


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


class Orbit(Outward):
    """The orbit of the formation's centre around the target."""

    radius_m: float
    speed_m_s: float
    direction: Direction


class Yaw(Outward):
    """Yaw policy and heading of the vehicles."""

    policy: YawPolicy
    heading_deg: float = Field(description="Heading of the policy `fixed`.")


class Obstacle(Outward):
    """A box on the ground, at its position now."""

    id: str
    x_m: float
    y_m: float
    half_length_x_m: float
    half_length_y_m: float
    height_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float


class Origin(Outward):
    """The show frame: its origin, and the heading of its x axis."""

    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    heading_deg: float


class Tick(Outward):
    """Timing of the control loop."""

    rate_hz: Measured
    count: int
    missed: int
    duration_p50_ms: Measured
    duration_p99_ms: Measured
    lateness_p99_ms: Measured


class Fleet(Outward):
    """The whole state at one instant."""

    time_s: float = Field(description="The service's monotonic clock.")
    unix_time_s: float
    control_alive: bool = Field(description="False also when this state is old; in a replay only then.")
    control_reason: str = Field(description="Why it is not alive, empty when it is.")
    show: Show
    counts: Counts
    origin: Origin
    formation: Formation
    center: Center | None = Field(description="null while no formation flies.")
    target: Target
    orbit: Orbit
    yaw: Yaw
    obstacles: list[Obstacle]
    minimum_separation_m: Measured
    setpoints_sent: int
    filter_interventions: int = Field(
        description="Setpoints that the safety filter has changed, counted per vehicle and tick."
    )
    interrupted: InterruptedFlight | None = Field(
        description="An interrupted flight that is not settled yet; null: none."
    )
    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Most severe first, newest first within a severity; alarms that have ended come last."
    )
    estimates: Estimates | None = Field(description="null in a replay.")
    access: str = Field(description="Whether the service demands tokens, in words.")
    tick: Tick
    vehicles: list[Vehicle]
