"""JSON schemas of reports: errors, health, rights, preflight, checks of shows, flight report and marks."""

from typing import Literal

from pydantic import Field

from gcs.api.schemas.fleet import Measured, Outward
from gcs.model.preflight_report import State
from gcs.service import CheckState
from gcs.service.access import Right


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


class Access(Outward):
    """The caller and its rights."""

    name: str = Field(description="The token's name; `local` without any.", examples=["local"])
    rights: list[Right] = Field(description="watch: read; emergency: also pause, land, kill; operate: all.")


class Check(Outward):
    """One check before a start."""

    name: str
    state: State = Field(description="Result of the check; unknown counts as failed.")
    value: Measured = Field(description="The measured value; null: not known, or no number.")
    unit: str
    limit: str = Field(description="Values that pass.")
    problem: str = Field(description="What is wrong; empty when it passes.")
    to_do: str = Field(description="How to correct it.")


class VehicleChecks(Outward):
    """All checks of one vehicle before a start."""

    id: str
    passes: bool
    flies: bool = Field(description="Whether the vehicle takes part in a start when every check passes.")
    reason: str = Field(description="Why it does not fly.")
    checks: list[Check]


class Preflight(Outward):
    """All checks before a start."""

    passes: bool = Field(description="Whether a start would be accepted now.")
    unix_time_s: float = Field(description="Time of the check; in the air: before take-off.")
    show: str | None
    show_hash: str | None
    fleet: list[Check]
    vehicles: list[VehicleChecks]
    not_flying: dict[str, str] = Field(description="Vehicles that would stay on the ground, and why.")
    not_checked: list[str] = Field(description="What is not checked, and why.")


class ShowText(Outward):
    """A show file and its text."""

    name: str
    text: str = Field(description="YAML, as it was uploaded.")


class ShowProblem(Outward):
    """One problem of a show, and where to fix it."""

    line: int
    cue: str | None
    text: str


class CueFigures(Outward):
    """One pass through a cue, as flown in virtual time."""

    cue: str
    line: int
    at_s: float
    radius_m: float
    height_m: float
    separation_m: Measured = Field(description="Least separation, in the metric of the separation ellipsoid.")
    speed_m_s: Measured
    radius_error_m: Measured
    center_off_m: Measured
    held_back: int


class VerticalOverlap(Outward):
    """Two vehicles, one above the other during the check: they cannot both descend vertically."""

    upper: int = Field(description="Vehicle of the show, from 1.")
    lower: int
    sideways_m: float = Field(description="Least horizontal distance between the two vehicles.")
    cue: str = Field(description="Cue at that time.")


class ShowFigures(Outward):
    """Figures of a show flown in virtual time, from true positions."""

    vehicles: int
    show_s: float
    assembled_s: float
    home_s: Measured
    floor_m: float
    separation_min_m: float
    separation_min_at: str
    pairs_below_floor: int
    speed_max_m_s: float
    climb_max_m_s: float
    sink_max_m_s: float
    fence_distance_margin_m: float
    fence_height_margin_m: float
    battery_need: float = Field(description="Share of a full battery, reserve included.")
    vertical_overlaps: int = Field(description="Pairs whose columns overlap at some time of the show.")
    columns: list[VerticalOverlap] = Field(description="The nearest of these pairs.")
    cues: list[CueFigures]


class ShowCheck(Outward):
    """A running or finished check of a show; only a show that passed may be selected."""

    name: str
    state: CheckState
    reason: str = Field(description="Why the check itself failed; it says nothing of the show then.")
    hash: str | None
    good: bool = Field(description="It can be flown, and by this service as it is set now.")
    fits_service: bool = Field(
        description="false: other settings of the service would remove some of the problems."
    )
    problems: list[ShowProblem]
    figures: ShowFigures | None = Field(description="null: not flown.")


class ReportCheck(Outward):
    """One limit: whether it was kept, and the worst value."""

    name: str = Field(examples=["greatest height"])
    limit: Measured = Field(description="The limit that applied then: a written show has its own.")
    tolerated: Measured = Field(
        description="Kept up to here: an autopilot's own answer may pass the limit by a little."
    )
    worst: Measured = Field(description="null: there was nothing to judge.")
    unit: str = Field(description="Unit of limit, tolerated and worst.", examples=["m"])
    vehicle: str = Field(description="The vehicle with the worst value.")
    at_s: Measured = Field(description="Time since the beginning of the record.")
    kept: bool | None = Field(description="null: there was nothing to judge.")


class NearestPair(Outward):
    """Two vehicles at the time when they were nearest, in the metric of the minimum separation."""

    vehicles: list[str]
    distance_m: Measured
    floor_ratio: Measured = Field(description="Distance as a multiple of the floor: 1 is the floor.")
    floor_ratio_if_off: Measured = Field(
        description="The same if both positions were wrong by their margin, towards each other."
    )
    at_s: Measured


class ReportBody(Outward):
    """The flight report, as `gcs report --json` prints it."""

    source: str
    verdict: Literal["kept", "broken", "incomplete"] = Field(
        description="incomplete: nothing was found broken, but not all of the flight could be judged."
    )
    missing: list[str] = Field(description="What could not be judged, and why; with times and bytes.")
    based_on: str = Field(examples=["true positions", "estimated positions"])
    uncertainty: str = Field(description="Uncertainty of the positions, in words.")
    remarks: list[str] = Field(description="Remarks about the file.")
    vehicles: int
    flew: int
    duration_s: float
    checks: list[ReportCheck]
    nearest_pairs: list[NearestPair]


class FlightReport(Outward):
    """The flight report of the record, or its progress."""

    state: CheckState
    reason: str = Field(description="Why it failed, empty when it did not.")
    report: ReportBody | None = Field(description="null until it is done.")
