"""JSON schemas of request bodies.

Names end in their unit. Positions are in the show frame, with heights positive up (`height_m`, above the
show's origin); headings are in degrees clockwise from north.
Requests are strict: an unknown field, a number in quotes, NaN and infinities are refused.
"""

from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from gcs.model.plan import Direction, YawPolicy

NAME_MAX: Final = 64
"""Most characters of a name; the configuration allows 32 for vehicles."""
VehicleName = Annotated[str, Field(max_length=NAME_MAX, examples=["d1"])]
Vehicles = Annotated[list[VehicleName], Field(min_length=1, max_length=10_000, examples=[["d1", "d2"]])]
BODY_MAX_BYTES: Final = 64 * 1024
"""Limit of a request body; the largest valid one, a start with thousands of names, is smaller."""
LENGTH_MAX_M: Final = 100_000.0
"""Largest coordinate: beyond it a flat show frame and its conversion to and from WGS84 are invalid."""
SPEED_MAX_M_S: Final = 1_000.0
"""Largest plausible speed; the service decides which speeds can be flown."""
HASH_PATTERN: Final = r"^[0-9a-f]{64}$"
HASH_EXAMPLE: Final = "4f0c8dd7e2a6b1935c7e0f8a9b6d5c4e3f2a1b0c9d8e7f6a5b4c3d2e1f0a9b8c"
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$"
CODE_PATTERN = r"^[0-9a-f]{6}$"
REASON_MAX = 200
SPEED_MAX: Final = 100.0
ABSENT: Final[Any] = None
"""Placeholder of optional fields; never read, because only given fields count."""
Coordinate = Annotated[float, Field(ge=-LENGTH_MAX_M, le=LENGTH_MAX_M, examples=[12.5])]
Length = Annotated[float, Field(gt=0, le=LENGTH_MAX_M, examples=[10.0])]
Speed = Annotated[float, Field(gt=0, le=SPEED_MAX_M_S, examples=[2.0])]
Velocity = Annotated[float, Field(ge=-SPEED_MAX_M_S, le=SPEED_MAX_M_S, examples=[0.5])]
Heading = Annotated[
    float, Field(ge=-360, le=360, description="Degrees clockwise from north.", examples=[90.0])
]
PLACED_MAX_M: Final = 10_000.0
"""Farthest place of a drawing from the show's origin, along either axis."""
PlacedAlong = Annotated[float, Field(ge=-PLACED_MAX_M, le=PLACED_MAX_M, examples=[12.5])]
PlacedTurn = Annotated[
    float, Field(ge=-360, le=360, description="Degrees clockwise seen from above.", examples=[21.5])
]
ObstacleId = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$", examples=["tower"])]
Sense = Annotated[Direction, Field(strict=False, description="Seen from above.")]
Law = Annotated[
    str,
    Field(
        min_length=1,
        max_length=64,
        description="Name of a law, as `gcs law list` has them. It changes on the ground only.",
        examples=["slots"],
    ),
]
Policy = Annotated[YawPolicy, Field(strict=False)]
ShowHash = Annotated[
    str,
    Field(
        pattern=HASH_PATTERN,
        description="Hash of everything that is flown, as the show's check reports it.",
        examples=[HASH_EXAMPLE],
    ),
]


def without_defaults(schema: dict[str, Any]) -> None:
    """Remove defaults from the schema: they are internal placeholders of absent fields."""
    for field in schema.get("properties", {}).values():
        field.pop("default", None)


def _at_least_one(schema: dict[str, Any]) -> None:
    """Remove defaults, and demand at least one field."""
    without_defaults(schema)
    schema["minProperties"] = 1


def _whole_change(value: object) -> object:
    """Refuse a change without any field: it is a mistake of the client."""
    if isinstance(value, dict) and not value:
        raise PydanticCustomError("empty_change", "at least one field")
    return value


class Inward(BaseModel):
    """Base of request bodies: strict, and validated as a whole before use."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Partial(Inward):
    """Base of bodies with fields that may be left out."""

    model_config = ConfigDict(json_schema_extra=without_defaults)


class Change(Inward):
    """Base of changes: absent fields stay as they are."""

    model_config = ConfigDict(json_schema_extra=_at_least_one)

    _something = model_validator(mode="before")(_whole_change)

    def given(self) -> dict[str, Any]:
        return self.model_dump(exclude_unset=True)


class FormationChange(Change):
    """New radius or height of the formation, which changes continuously, or its law."""

    radius_m: Length = Field(default=ABSENT, description="Radius of the virtual sphere.")
    height_m: Coordinate = Field(default=ABSENT, description="Height of the centre above the show's origin.")
    law: Law = Field(default=ABSENT)


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


TargetHeight = Annotated[
    float, Field(ge=-1000, le=10_000, description="Above the show's origin; the formation flies above that.")
]
TargetClearance = Annotated[
    float, Field(ge=0, le=500, description="No vehicle comes nearer to the target; 0: vehicles may.")
]


class ShowTarget(Inward):
    """The target's position and velocity in the show frame."""

    x_m: Coordinate
    y_m: Coordinate
    velocity_x_m_s: Velocity = 0.0
    velocity_y_m_s: Velocity = 0.0
    height_m: TargetHeight = 0.0
    clearance_m: TargetClearance = 0.0


class GeodeticTarget(Inward):
    """The target's position and velocity in WGS84."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90, examples=[47.3977])]
    longitude_deg: Annotated[float, Field(ge=-180, le=180, examples=[8.5456])]
    velocity_north_m_s: Velocity = 0.0
    velocity_east_m_s: Velocity = 0.0
    height_m: TargetHeight = 0.0
    clearance_m: TargetClearance = 0.0


TARGET_FRAMES: Final[dict[str, type[Inward]]] = {"show frame": ShowTarget, "geodetic": GeodeticTarget}


def _target_frame(value: object) -> str | None:
    """Return the tag of the frame whose fields are given; None: of neither, or of both."""
    if not isinstance(value, dict):
        return None
    in_both = ShowTarget.model_fields.keys() & GeodeticTarget.model_fields.keys()
    given = value.keys() - in_both
    meant = [tag for tag, model in TARGET_FRAMES.items() if given & model.model_fields.keys()]
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


class GoConfirmation(Inward):
    """The start that is confirmed."""

    hash: Annotated[
        str,
        Field(
            pattern=r"^[0-9a-f]{12}$",
            description="Hash of what is proposed, as `GET /go` has it.",
            examples=["3f2a9c01b4de"],
        ),
    ]


class ChecklistItems(Inward):
    """Items of the checklist of one role."""

    role: Annotated[str, Field(max_length=32, examples=["pads"])]
    items: Annotated[
        list[Annotated[int, Field(ge=1, le=64)]],
        Field(min_length=1, max_length=64, description="Their numbers, from 1.", examples=[[1, 2]]),
    ]


class Weather(Change):
    """The weather now, as it was measured or looked up."""

    wind_m_s: Annotated[float, Field(ge=0, le=100)] = Field(default=ABSENT, examples=[4.0])
    gust_m_s: Annotated[float, Field(ge=0, le=100)] = Field(default=ABSENT, examples=[6.5])
    visibility_m: Annotated[float, Field(ge=0, le=100_000)] = Field(default=ABSENT, examples=[8000.0])
    kp: Annotated[float, Field(ge=0, le=9)] = Field(
        default=ABSENT, description="Planetary index of geomagnetic activity.", examples=[2.0]
    )


class TargetName(Inward):
    """A target of the configuration."""

    name: Annotated[str, Field(max_length=32, examples=["boat"])]


class TargetReport(Inward):
    """Where a target is, in WGS84; what is absent is not known."""

    latitude_deg: Annotated[float, Field(ge=-90, le=90, examples=[47.3977])]
    longitude_deg: Annotated[float, Field(ge=-180, le=180, examples=[8.5456])]
    altitude_amsl_m: Annotated[float, Field(ge=-1000, le=10_000)] | None = None
    north_m_s: Velocity | None = None
    east_m_s: Velocity | None = None
    deviation_m: Annotated[float, Field(gt=0, le=1000)] | None = Field(
        default=None, description="Standard deviation along each axis."
    )
    velocity_deviation_m_s: Annotated[float, Field(gt=0, le=100)] | None = None
    source_s: Annotated[float, Field(ge=0, le=1e11)] | None = Field(
        default=None, description="When it was there, by the sender's clock: s since 1970, or from any begin."
    )


class PlacementPut(Inward):
    """Where a drawn show lies: turned with its pads about the drawing's origin, then moved; show frame."""

    x_m: PlacedAlong
    y_m: PlacedAlong
    turn_deg: PlacedTurn


class Box(Partial):
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

    id: ObstacleId = Field(default=ABSENT, description="Absent: the service assigns an id.")


class ObstaclePut(Box):
    """The new state of an obstacle; an id, if given, must be that of the path."""

    id: ObstacleId = Field(default=ABSENT, description="May be left out: the path names it.")


class StartBody(Partial):
    """The vehicles, the selected show and the time of a start."""

    vehicles: Vehicles = Field(default=ABSENT, description="Absent: every vehicle that is not left out.")
    show_hash: Annotated[str, Field(pattern=HASH_PATTERN, examples=[HASH_EXAMPLE])] = Field(
        default=ABSENT,
        description="Hash of the selected show, as its check reports it. Absent: none is selected.",
    )
    at_unix_time_s: Annotated[float, Field(gt=0, le=1e11, examples=[1795000000.0])] = Field(
        default=ABSENT, description="Take-off time, in s since 1970. Absent: now."
    )


class GroupBody(Partial):
    """The vehicles of a command."""

    vehicles: Vehicles = Field(default=ABSENT, description="Absent: all that the command can apply to.")


class KillConfirmation(Inward):
    """The second step of a kill: its code."""

    code: Annotated[
        str,
        Field(
            pattern=CODE_PATTERN, description="The code that the first step returned.", examples=["a1b2c3"]
        ),
    ]


class ExcludeBody(Inward):
    """Why a vehicle is excluded from the show."""

    reason: Annotated[str, Field(max_length=REASON_MAX, examples=["a propeller is cracked"])] = ""


class SelectBody(Inward):
    """The hash of the checked show that is to be selected."""

    hash: ShowHash


class SeekBody(Inward):
    """The cue with which the show begins."""

    cue: Annotated[str, Field(min_length=1, max_length=60, examples=["walk round"])]


class BeginBody(Inward):
    """The time at which the selected show begins to move."""

    at_unix_time_s: Annotated[float, Field(gt=0, le=1e11, examples=[1795000000.0])]


class ClockBody(Inward):
    """Whether shows follow the external clock that is configured."""

    follow: bool


class ReplayChange(Change):
    """Changes of the playback; at least one field."""

    paused: bool = Field(default=ABSENT)
    speed: Annotated[float, Field(gt=0, le=SPEED_MAX, examples=[4.0])] = Field(
        default=ABSENT, description="Playback speed as a multiple of the flight's."
    )
    position_s: Annotated[float, Field(ge=0, examples=[12.5])] = Field(
        default=ABSENT, description="Time since the first recorded state, at most the record's duration."
    )
    skips_idle: bool = Field(
        default=ABSENT, description="Jump over time in which nothing flies, while it plays."
    )
