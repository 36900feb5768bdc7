"""JSON schemas of the console's stream beside its binary frames: data that changes seldom."""

from typing import Annotated

from pydantic import Field

from gcs.api.schemas.alarms import Alarm
from gcs.api.schemas.recovery import InterruptedFlight
from gcs.api.schemas.replay import Replay
from gcs.api.schemas.rest import (
    Counts,
    Estimates,
    Formation,
    Obstacle,
    Orbit,
    Origin,
    Outward,
    Show,
    Target,
    Yaw,
)
from gcs.service.access import Right
from gcs.service.alarms import OverallSeverity
from gcs.service.event_log import Severity


class Access(Outward):
    """The caller and its rights."""

    who: str = Field(description="The token's name; `local` without any.", examples=["local"])
    rights: list[Right] = Field(description="watch: read; emergency: also pause, land, kill; operate: all.")


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


class Home(Outward):
    """Take-off position of a vehicle, in the show frame."""

    x_m: float
    y_m: float
    height_m: float


class LogEvent(Outward):
    """One event of the service's log."""

    number: int = Field(description="Increases since the service began.")
    unix_time_s: float
    severity: Severity
    text: str
    vehicle: str | None = Field(description="The vehicle concerned; null: none in particular.")


class StatusVehicle(Outward):
    """Data of one vehicle that changes seldom. Its index in the list is its row in the frames' columns."""

    id: str
    system_id: int
    link: str
    reason: str = Field(description="Why it is in its phase.")
    limited_by: str = Field(description="Why the safety filter limits the vehicle; empty: it does not.")
    home: Home | None = Field(description="null: it has not taken off.")
    fix_type: Annotated[int, Field(ge=0, le=255)] | None = Field(
        description="GPS_FIX_TYPE of its receiver, 3 and more with a height; null: not known."
    )


class Status(Outward):
    """Data that changes seldom: the text messages of the console's stream."""

    revision: int = Field(
        description="Increases with every change; a frame names the revision it belongs to."
    )
    time_s: float = Field(description="The service's monotonic clock.")
    unix_time_s: float
    began_unix_time_s: float = Field(
        description="When this process began to serve; a restarted service has another time."
    )
    control_reason: str = Field(description="Why control is not alive, empty when it is.")
    show: Show
    counts: Counts
    timeline: list[CueTime] = Field(description="Cues of the selected show, loops written out.")
    shows_refused: str = Field(
        description="Why show files cannot be uploaded to this service, empty when they can."
    )
    origin: Origin
    map: Map | None = Field(description="null: none is configured.")
    formation: Formation
    target: Target = Field(description="Position of the target at `time_s`.")
    orbit: Orbit
    yaw: Yaw
    obstacles: list[Obstacle] = Field(description="Positions of the obstacles at `time_s`.")
    fence: Fence
    separation: Separation
    interrupted: InterruptedFlight | None = Field(
        description="An interrupted flight that is not settled yet; null: none."
    )
    severity: OverallSeverity = Field(description="The worst severity of the alarms that last.")
    alarms: list[Alarm] = Field(
        description="Most severe first, newest first within a severity; alarms that have ended come last."
    )
    estimates: Estimates | None = Field(
        description="Estimates at `time_s`; frames carry the present ones. null in a replay."
    )
    access: str = Field(description="Whether the service demands tokens, in words.")
    limits: list[str] = Field(
        description="Reasons for which the safety filter limits vehicles now, each once."
    )
    replay: Replay | None = Field(description="null: this is no replay.")
    events: list[LogEvent] = Field(description="The newest 100, the newest last.")
    vehicles: list[StatusVehicle]
