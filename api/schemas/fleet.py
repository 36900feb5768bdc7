"""JSON schemas of the fleet's state, for REST, the streams and `gcs status`, and of answers to commands.

Units and frames as in `gcs.api.schemas.requests`. An unknown number is null, never NaN.
"""

from math import isfinite
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Direction, LawName, YawPolicy
from gcs.model.state import Mode
from gcs.service import Outcome, ShowAction
from gcs.service.alarms import AlarmSeverity, OverallSeverity
from gcs.service.event_log import LogEvent


def _known(value: object) -> object:
    """Convert NaN and infinities to None (not known)."""
    return None if isinstance(value, float) and not isfinite(value) else value


Measured = Annotated[float | None, BeforeValidator(_known)]


class Outward(BaseModel):
    """Base of response bodies. Clients ignore fields that they do not know."""

    model_config = ConfigDict(frozen=True, extra="ignore")


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
    reason: str = Field(description="Why it is in its phase.")
    limited_by: str = Field(description="Why the safety filter limits the vehicle; empty: it does not.")
    home: Home | None = Field(description="null: it has not taken off.")
    fix_type: Annotated[int, Field(ge=0, le=255)] | None = Field(
        description="GPS_FIX_TYPE of its receiver, 3 and more with a height; null: not known."
    )


class Vehicle(VehicleRecord, Motion):
    """One vehicle, as the service estimates it. Its numbers have the names of a frame's columns."""

    phase: Phase
    mode: Mode
    armed: bool
    landed: str = Field(description="Landed state, as the autopilot reports it.", examples=["on_ground"])
    ready: bool
    heading_deg: Measured = Field(description="0 up to, without, 360.")
    setpoint_x_m_s: Measured = Field(description="Sent in the last tick; null: not commanded.")
    setpoint_y_m_s: Measured
    setpoint_up_m_s: Measured
    battery: Measured = Field(description="Remaining share of the battery, 0 to 1.")
    position_age_s: Measured
    heartbeat_age_s: Measured
    uncertainty_m: Measured = Field(
        description="Standard deviation sideways: as reported, at least what its kind of fix can mean."
    )
    link_quality: Measured = Field(
        description="Share of the requested positions that arrive, 0 to 1; null in a replay."
    )
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


class Formation(Outward):
    """Radius and height of the formation: desired, and commanded now; and its law."""

    radius_m: float
    height_m: float
    law: LawName
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


class Alarm(Outward):
    """One condition that an operator should know, with all vehicles that it concerns."""

    id: str = Field(examples=["vehicle-lost-7"])
    severity: AlarmSeverity = Field(
        description=(
            "emergency: act at once; warning: act soon; caution: be ready to act; information: nothing to do."
        )
    )
    cause: str = Field(
        description="One word for programs; docs/operations.md lists them.", examples=["vehicle-lost"]
    )
    text: str = Field(
        description="The cause first, its consequence after.",
        examples=["Vehicle d3 lost: no telemetry for 2.0 s. Formation closes the gap."],
    )
    advice: str = Field(description="What an operator can do.")
    vehicles: list[str] = Field(description="All that it concerns; empty: it concerns no vehicle.")
    since_unix_time_s: float = Field(description="When the cause began.")
    raised_unix_time_s: float = Field(
        description=(
            "When it began, or last concerned a further vehicle or became more severe: it then is no longer"
            " acknowledged. The newest of a severity is listed first."
        )
    )
    acknowledged_by: str | None = Field(description="Name of the token used; null: not acknowledged.")
    acknowledged_unix_time_s: float | None
    ended_unix_time_s: float | None = Field(
        description=(
            "null: the cause lasts. Emergencies and warnings stay listed after their cause has ended until"
            " they are acknowledged; they do not count for the state of the whole."
        )
    )
    command_id: str | None = Field(description="The command that the service gave because of it; null: none.")


class AlarmList(Outward):
    """All alarms, and the overall severity."""

    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Lasting alarms before ended ones; the most severe first, of one severity the newest."
    )


class Remaining(Outward):
    """One vehicle that was airborne, and its state now."""

    before: Phase = Field(description="Phase at the end of the record.")
    pad_known: bool = Field(description="Whether it can be brought home.")
    waits: bool = Field(description="Waits for a command: take-over or bring-home would reach it.")
    text: str


class WrittenShow(Outward):
    """The written show that was flown, and its position."""

    name: str
    hash: str
    cue: str
    clock_s: float


class InterruptedFlight(Outward):
    """A flight that was interrupted when the service ended or stalled. An operator must resume or end it."""

    session: str
    unix_time_s: float = Field(description="When the flight was interrupted.")
    cause: str = Field(
        description="What interrupted the flight, in words.", examples=["the service stalled for 4.4 s"]
    )
    show: ShowPhase
    selected: WrittenShow | None
    vehicles: dict[str, Remaining]
    offers: list[Offer] = Field(
        description="Commands that are accepted: POST /api/v1/show/take-over and others."
    )
    problems: list[str] = Field(description="Why the other commands are refused.")


class Replay(Outward):
    """A recorded flight that is played back as if live."""

    file: str
    began_unix_time_s: float = Field(description="Time of the first recorded state.")
    duration_s: float
    position_s: float = Field(description="Time from the first recorded state to this one.")
    speed: float = Field(description="Playback speed as a multiple of the flight's.")
    paused: bool
    ended: bool = Field(description="The last recorded state is shown.")
    skips_idle: bool = Field(description="Time in which nothing flies is jumped over while it plays.")


class CueTime(Outward):
    """A cue as it is played; a cue in a loop occurs several times."""

    cue: str
    at_s: float = Field(description="Time on the show's clock.")


class Fence(Outward):
    """The volume that no vehicle may leave: heights above the show's origin, horizontal distance from it."""

    height_min_m: float = Field(description="Least height of vehicles in the formation.")
    height_max_m: float
    distance_max_m: float


class Map(Outward):
    """The map of the ground, as tiles in web mercator."""

    tiles: str = Field(
        description=(
            "Address of a tile: `{z}` is the zoom, `{x}` the column from the west, `{y}` the row from the"
            " north. One that begins with `/` is this service's own, and asks for the token."
        ),
        examples=["/api/v1/map/{z}/{x}/{y}"],
    )
    attribution: str = Field(description="Text to show with the map.")
    zoom_min: int
    zoom_max: int


class Separation(Outward):
    """The minimum separation: semi-axes of the ellipsoid around a vehicle that no other may enter."""

    horizontal_m: float
    vertical_m: float = Field(description="Vertical half-axis; greater, because a vehicle's air goes down.")
    margin_m: float = Field(description="Margin added sideways, and in proportion up and down.")


class FleetSummary(Outward):
    """The state at one instant, without the vehicles."""

    time_s: float = Field(description="The service's monotonic clock.")
    unix_time_s: float
    control_reason: str = Field(description="Why control is not alive, empty when it is.")
    show: Show
    counts: Counts
    origin: Origin
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
    tick: Tick
    vehicles: list[Vehicle]


class Status(FleetSummary):
    """Data that changes seldom: the text messages of the console's stream."""

    revision: int = Field(
        description="Increases with every change; a frame names the revision it belongs to."
    )
    began_unix_time_s: float = Field(
        description="When this process began to serve; a restarted service has another time."
    )
    timeline: list[CueTime] = Field(description="Cues of the selected show, loops written out.")
    shows_refused: str = Field(
        description="Why show files cannot be uploaded to this service, empty when they can."
    )
    map: Map | None = Field(description="null: none is configured.")
    fence: Fence
    separation: Separation
    limits: list[str] = Field(
        description="Reasons for which the safety filter limits vehicles now, each once."
    )
    replay: Replay | None = Field(description="null: this is no replay.")
    events: list[LogEvent] = Field(description="The newest 100, the newest last.")
    vehicles: list[VehicleRecord] = Field(description="In the order of the rows of a frame's columns.")
