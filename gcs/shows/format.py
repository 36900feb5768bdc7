"""Format of a show file: strict, frozen, every key with its unit. `gcs.shows.timeline` interprets it."""

import json
from collections.abc import Sequence
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np
from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    StrictInt,
    StrictStr,
    Tag,
    ValidationInfo,
    field_validator,
)

from gcs.config.sections import OrbitSettings, ShowFrameSettings
from gcs.control import ControlSettings
from gcs.formation.laws.registry import LawName
from gcs.formation.laws.settings import of_law
from gcs.model.errors import RefusedError
from gcs.model.plan import DEFAULT_LAW, MAX_OBSTACLES, Direction
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array
from gcs.safety.fenced_areas import FencedArea, too_many
from gcs.safety.surroundings import Limits
from gcs.safety.walls import Fence
from gcs.shows.drawn.trajectories import turned

Name: TypeAlias = Annotated[StrictStr, Field(min_length=1, max_length=60)]
Colour: TypeAlias = Annotated[StrictStr, Field(pattern=r"^#[0-9a-fA-F]{6}$"), AfterValidator(str.lower)]

MAX_VEHICLES = 1000
PLACED_MAX_M = 10_000.0
"""A drawing lies no farther from the show's origin, along either axis."""

MAX_CUES = 500
"""After expansion: a loop counts as often as it is played."""


class Origin(ShowFrameSettings):
    """Origin of the show frame, and heading of its x axis clockwise from north, which is never left out."""

    heading_deg: Annotated[float, Field(ge=-360, le=360)]


class Pads(Settings):
    """The start pattern: rows along the show's x axis, filled one after the other, about a middle."""

    columns: Annotated[StrictInt, Field(ge=1)]  # vehicles in a row, along y
    spacing_m: Positive
    x_m: float = 0.0  # the middle of the pattern
    y_m: float = 0.0


class Fleet(Settings):
    """Number of vehicles, their pads, and the endurance of a battery."""

    vehicles: Annotated[StrictInt, Field(ge=1, le=MAX_VEHICLES)]
    pads: Pads
    takeoff_height_m: Positive = 5.0
    takeoff_stagger_s: NotNegative = 1.0
    endurance_s: Positive  # in the air, from full to empty
    reserve: Annotated[float, Field(ge=0.1, lt=1.0)] = 0.25  # share of a battery that no plan uses


class ShowLimits(Settings):
    """Speed limits of vehicles and formation; never above the defaults of the law and the filter."""

    speed_max_m_s: Annotated[Positive, Field(le=8.0)] = 8.0  # of a vehicle, sideways
    climb_max_m_s: Annotated[Positive, Field(le=2.5)] = 2.5
    sink_max_m_s: Annotated[Positive, Field(le=1.4)] = 1.4
    separation_min_m: Annotated[float, Field(ge=2.0)] = 2.0  # sideways; half as much more up and down
    formation_speed_max_m_s: Annotated[Positive, Field(le=4.0)] = 4.0  # of its centre, over the ground
    formation_climb_max_m_s: Annotated[Positive, Field(le=1.0)] = 1.0
    formation_acceleration_max_m_s2: Annotated[Positive, Field(le=1.0)] = 1.0
    radius_rate_max_m_s: Annotated[Positive, Field(le=1.0)] = 1.0


class ShowFence(Settings):
    """Heights above the show's origin, and distance from it over the ground."""

    height_min_m: Positive
    height_max_m: Positive
    distance_max_m: Positive


class Place(Settings):
    """A position on the ground, show frame: x along the heading, y to its right."""

    x_m: float
    y_m: float


class Waypoint(Place):
    """Position of the target at a time after its cue."""

    after_s: NotNegative


class Path(Settings):
    """Path of a target: a smooth curve through the points, at rest at both ends."""

    path: Annotated[tuple[Waypoint, ...], Field(min_length=1, max_length=200)]


class CueOrbit(OrbitSettings):
    """How the formation's centre circles the target; radius 0: it stays above the target."""

    radius_m: NotNegative


class Spin(Settings):
    """Rotation of the formation about its own vertical, seen from above."""

    rate_deg_s: Annotated[float, Field(ge=0, le=90)]
    direction: Direction = Direction.CLOCKWISE


class StandingBox(Settings):
    """An obstacle at rest, edges along the show frame's axes."""

    x_m: float  # centre
    y_m: float
    half_length_x_m: Positive
    half_length_y_m: Positive
    height_m: Positive  # of its top


class Box(StandingBox):
    """An obstacle of a show, with the name under which it goes again."""

    id: Name


class Obstacles(Settings):
    """Obstacles that appear and disappear with a cue."""

    appear: Annotated[tuple[Box, ...], Field(max_length=MAX_OBSTACLES)] = ()
    go: tuple[Name, ...] = ()


def _kind(value: object) -> str:
    if isinstance(value, str):
        return "live"
    return "path" if isinstance(value, Path) or (isinstance(value, dict) and "path" in value) else "place"


CueTarget: TypeAlias = Annotated[
    Annotated[Literal["live"], Tag("live")] | Annotated[Place, Tag("place")] | Annotated[Path, Tag("path")],
    Discriminator(_kind),
]


class DrawnPart(Settings):
    """Part of the drawing that is played from a cue on, at the drawing's own speed."""

    from_s: NotNegative = 0.0  # times of the drawing
    to_s: Positive


class Cue(Settings):
    """Changes at one time; all other values stay as they are.

    With `trajectories` the drawing leads, up to the next cue; else the law leads.
    """

    cue: Name
    at_s: NotNegative
    over_s: Positive | None = None  # of all its transitions; None: the shortest that the limits allow
    radius_m: Positive | None = None
    height_m: Positive | None = None  # of the centre, above the show's origin
    target: CueTarget | None = None
    orbit: CueOrbit | None = None
    spin: Spin | None = None
    obstacles: Obstacles = Obstacles()
    lights: Annotated[tuple[Colour, ...], Field(min_length=1)] | None = None
    trajectories: DrawnPart | None = None


class SpareVehicles(Settings):
    """Vehicles of a start that stay on the ground, to take the places of lost ones."""

    count: Annotated[StrictInt, Field(ge=1, le=20)]  # at most; they come last in the fleet's order
    before_cue: Name  # vehicles that are lost later are not replaced


class Placement(Settings):
    """Where the drawing and its pads lie: turned about the drawing's origin, then moved; show frame."""

    x_m: Annotated[float, Field(ge=-PLACED_MAX_M, le=PLACED_MAX_M)] = 0.0
    y_m: Annotated[float, Field(ge=-PLACED_MAX_M, le=PLACED_MAX_M)] = 0.0
    turn_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0  # clockwise from above

    def placed_m(self, place_m: Array) -> Array:
        """(n, 3) Places of the drawing (n, 3), as placed."""
        return np.asarray(place_m @ turned(self.turn_deg) + (self.x_m, self.y_m, 0.0))

    def unplaced_m(self, place_m: Array) -> Array:
        """(n, 3) Places (n, 3) in the drawing itself: the inverse of `placed_m`."""
        return np.asarray((place_m - (self.x_m, self.y_m, 0.0)) @ turned(self.turn_deg).T)


class Drawing(Settings):
    """The file of a drawn show, beside the show file."""

    source: Annotated[StrictStr, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,80}\.(skyc|zip|csv)$")]
    sha256: Annotated[StrictStr, Field(pattern=r"^[0-9a-f]{64}$")]  # of its bytes
    place: Placement = Placement()
    late: Literal["catch-up", "wait"] = "catch-up"  # what follows when a vehicle falls behind its trajectory
    waits_from_m: Annotated[float, Field(ge=0.5, le=50.0)] = 3.0  # `wait`: so far behind that the clock waits
    pads: Literal["nearest", "file"] = (
        "nearest"  # which vehicle flies which trajectory; `file`: in the fleet's order
    )
    lands: Literal["own", "nearest"] = "own"  # `nearest`: the pads are assigned anew where the return begins
    yaw: Literal["plan", "drawn"] = "plan"  # `drawn`: the drawing's yaw, where it has one
    spares: SpareVehicles | None = None


class Loop(Settings):
    """The cues from one up to another, excluded, are repeated this many times."""

    from_cue: Name
    to_cue: Name
    times: Annotated[StrictInt, Field(ge=2, le=100)]


class Show(Settings):
    """A whole show file."""

    about: Annotated[StrictStr, Field(min_length=1)]
    kind: Literal["formation", "trajectories"] = "formation"
    drawing: Drawing | None = None  # of the kind `trajectories`; its cues may play parts of it
    origin: Origin
    fleet: Fleet
    limits: ShowLimits = ShowLimits()
    fence: ShowFence
    law: LawName = DEFAULT_LAW  # of the formation, for the whole show
    law_settings: dict[str, Any] = Field(default_factory=dict)  # of that law, by its own model
    timeline: Annotated[tuple[Cue, ...], Field(min_length=1, max_length=MAX_CUES)]
    loops: tuple[Loop, ...] = ()
    duration_s: Positive  # as written, loops played once

    @field_validator("law_settings")
    @classmethod
    def _of_the_law(cls, given: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if given and "law" in info.data:
            of_law(info.data["law"], given)
        return given

    @property
    def laws(self) -> dict[str, Settings]:
        """Settings of the show's law, as in `FlownLawSettings.laws`; empty: its defaults."""
        return {self.law: of_law(self.law, self.law_settings)} if self.law_settings else {}

    @cached_property
    def digest(self) -> str:
        """SHA-256, hexadecimal, of everything that is flown (docs/decisions/shows.md)."""
        unsaid = {"about"} if self.law_settings else {"about", "law_settings"}
        content = self.model_dump(mode="json", exclude=unsaid)
        return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @property
    def pads_m(self) -> Array:
        """(n, 3) Start positions of the vehicles, show frame, on the ground."""
        return self.start_places_m[: self.fleet.vehicles]

    @property
    def start_places_m(self) -> Array:
        """(n + s, 3) As `pads_m`, and the next places of the pattern, for the spares."""
        drawn_m = self._drawn_places_m
        return drawn_m if self.drawing is None else self.drawing.place.placed_m(drawn_m)

    @property
    def drawn_pads_m(self) -> Array:
        """(n, 3) Start positions before the placement of the drawing, on the ground."""
        return self._drawn_places_m[: self.fleet.vehicles]

    @property
    def _drawn_places_m(self) -> Array:
        """(n + s, 3) Pads and spares' places before the placement of the drawing."""
        pads, count = self.fleet.pads, self.fleet.vehicles
        spares = 0 if self.drawing is None or self.drawing.spares is None else self.drawing.spares.count
        index = np.arange(count + spares)
        cells = np.stack([index // pads.columns, index % pads.columns, np.zeros(len(index))], axis=1)
        place_m: Array = pads.spacing_m * cells.astype(np.float64)
        flown_m = place_m[:count, :2]
        place_m[:, :2] += (pads.x_m, pads.y_m) - (flown_m.min(axis=0) + flown_m.max(axis=0)) / 2.0
        return place_m

    @property
    def control(self) -> ControlSettings:
        """Control settings for this show: the defaults, within the show's limits and fence."""
        return control_of(self)


TOO_MANY: Final = "the service's fence and the drawing's have {}"


def control_of(
    show: Show,
    usual: ControlSettings | None = None,
    areas: Sequence[FencedArea] = (),
) -> ControlSettings:
    """Return `usual` law and safety, or their defaults, within the show's limits, its fence and these areas.

    Settings of a law by its own model are the show's: those with which it was checked.

    Raises: RefusedError for more areas or corners than a fence can have.
    """
    usual, limits, fence = usual or ControlSettings(), show.limits, show.fence
    within_areas = (*usual.safety.fence.areas, *areas)
    if why := too_many(within_areas):
        raise RefusedError(TOO_MANY.format(why))
    law, floor = usual.law, usual.safety.floor
    law_within = {
        "speed_m_s": min(law.speed_m_s, limits.speed_max_m_s),
        "center_speed_max_m_s": limits.formation_speed_max_m_s,
        "center_acceleration_max_m_s2": limits.formation_acceleration_max_m_s2,
        "climb_max_m_s": limits.formation_climb_max_m_s,
        "laws": {name: own for name, own in law.laws.items() if name != show.law} | show.laws,
    }
    least_m = limits.separation_min_m
    up_m = floor.vertical_m * (least_m / floor.horizontal_m)
    up_m_s, down_m_s = limits.climb_max_m_s, limits.sink_max_m_s
    safety_within = {
        "limits": Limits(horizontal_m_s=limits.speed_max_m_s, up_m_s=up_m_s, down_m_s=down_m_s),
        "floor": floor.model_copy(update={"horizontal_m": least_m, "vertical_m": up_m}),
        "fence": Fence(
            **fence.model_dump(),
            areas=within_areas,
            controlled_ground=usual.safety.fence.controlled_ground,
        ),
    }
    within = {
        "radius_rate_m_s": limits.radius_rate_max_m_s,
        "law": law.model_copy(update=law_within),
        "safety": usual.safety.model_copy(update=safety_within),
    }
    return usual.model_copy(update=within)
