"""JSON schemas of show files and their checks."""

from typing import Annotated

from pydantic import Field

from gcs.api.schemas.rest import HASH_EXAMPLE, HASH_PATTERN, Inward, Measured, Outward
from gcs.service import CheckState

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,59}$"

ShowHash = Annotated[
    str,
    Field(
        pattern=HASH_PATTERN,
        description="Hash of everything that is flown, as the show's check reports it.",
        examples=[HASH_EXAMPLE],
    ),
]


# In


class SelectBody(Inward):
    """The hash of the checked show that is to be selected."""

    hash: ShowHash


class SeekBody(Inward):
    """The cue with which the show begins."""

    cue: Annotated[str, Field(min_length=1, max_length=60, examples=["walk round"])]


# Out


class StoredShow(Outward):
    """A stored show file."""

    name: str
    size_bytes: int
    sha256: str = Field(description="Hash of the file; what is flown has a hash of its own.")


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
