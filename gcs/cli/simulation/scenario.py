"""What a scenario file says: the flight, the world it happens in, and what must come out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, ValidationError, model_validator

from gcs import config as configuration
from gcs.control import ControlSettings
from gcs.errors import ConfigError
from gcs.plan import Direction
from gcs.settings import NotNegative, Positive, Settings

Share: TypeAlias = Annotated[float, Field(ge=0.0, lt=1.0)]
VehicleCount: TypeAlias = Annotated[int, Field(ge=1, le=20_000)]

MOST_PARENTS = 3
"""A scenario may be like another that is like another; a longer chain is a loop or a riddle."""


class Wind(Settings):
    """The air over the ground: a mean, and gusts that every vehicle meets on its own."""

    mean_x_m_s: float = 0.0
    mean_y_m_s: float = 0.0
    gust_m_s: NotNegative = 0.0  # standard deviation along each axis
    gust_time_s: Positive = 2.0  # of their correlation


class World(Settings):
    """How vehicles and links really are, whatever the ground station believes."""

    response_spread: Share = 0.2  # each vehicle's gains, delay and drag differ by up to this, at random
    drag_per_s: NotNegative = 1.0  # PX4's own simulator; real quadrotors have 0.1 to 0.3
    noise: NotNegative = 0.0  # times the recorded error of the vehicles' own estimates
    telemetry_delay_s: NotNegative = 0.0  # one way
    setpoint_delay_s: NotNegative = 0.0  # one way
    loss: Share = 0.0  # of telemetry and of setpoints
    wind: Wind = Wind()
    tick_rate_hz: Annotated[float, Field(ge=1.0, le=50.0)] = 20.0


class TargetPath(Settings):
    """The ground target: where it begins, and how its velocity changes."""

    x_m: float = 0.0
    y_m: float = 0.0
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    turns: tuple["Turn", ...] = ()


class Turn(Settings):
    """For a while the target accelerates."""

    from_s: NotNegative
    to_s: NotNegative
    acceleration_x_m_s2: float = 0.0
    acceleration_y_m_s2: float = 0.0


class Circle(Settings):
    """The orbit of the formation's centre; radius 0: it sits above the target."""

    radius_m: NotNegative = 0.0
    speed_m_s: Positive = 2.0
    direction: Direction = Direction.COUNTERCLOCKWISE


class Box(Settings):
    """An obstacle, and how it moves."""

    x_m: float
    y_m: float
    half_length_x_m: Positive
    half_length_y_m: Positive
    height_m: Positive
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0


class FormationFlight(Settings):
    """Vehicles that hover at take-off height are engaged at time 0, all of them, and stay in formation."""

    kind: Literal["formation"]
    start: Literal["grid", "random", "square"] = "grid"
    spacing_m: Positive = 4.0
    takeoff_height_m: Positive = 5.0
    radius_m: Positive | None = None  # None: max(10, 1.4 sqrt(N))
    height_m: Positive | None = None  # None: the lowest point 5 m above the take-off height
    orbit: Circle = Circle()
    center_moves_from_s: NotNegative = 0.0
    target: TargetPath = TargetPath()
    boxes: tuple[Box, ...] = ()
    leave_share: Share = 0.0  # of the vehicles vanish at `change_s`
    join: Annotated[int, Field(ge=0)] = 0  # vehicles that hover beside the others join at `change_s`
    change_s: NotNegative = 0.0
    ending: Literal["none", "return", "descend", "hold", "land"] = "none"
    ending_s: NotNegative = 0.0
    charges: tuple[Positive, ...] = (1.0,)  # vehicle by vehicle, from the first again when they run out
    speeds_m_s: tuple[Positive, ...] = ()  # likewise each vehicle's own limit; none: only the fleet's


class GoalFlight(Settings):
    """Every vehicle flies to a place of its own, all at once."""

    kind: Literal["goals"]
    layout: Literal["opposite", "cube", "head-on", "crossing"]
    extent_m: Positive  # radius of the sphere; edge of the cube; length of the ways
    spacing_m: Positive = 6.0  # of the places, at least
    lowest_m: Positive = 10.0  # height of the lowest place
    arrived_m: Positive = 1.0


class ArticleFlight(Settings):
    """Section 5 of the article, with its own parameters and virtual dynamics."""

    kind: Literal["article"]
    part: Literal["assembly", "tracking", "obstacle"]


Flight: TypeAlias = Annotated[FormationFlight | GoalFlight | ArticleFlight, Field(discriminator="kind")]


class Gate(Settings):
    """Between what a figure must lie."""

    least: float | None = None
    most: float | None = None


class Judged(Settings):
    """The runs on which the scenario is judged, and what every one of them must show."""

    vehicles: tuple[VehicleCount, ...]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 1  # that many, from `first_seed`
    first_seed: int = 1000
    must: dict[str, Gate] = Field(
        default_factory=dict
    )  # for instance separation.violations; every run
    mostly: dict[str, Gate] = Field(default_factory=dict)  # likewise, in 95 % of the runs of each fleet
    few: Annotated[int, Field(ge=0)] = 20  # up to so many vehicles `nearest_few` holds, above `nearest_many`
    nearest_few: float = 0.97
    nearest_many: float = 0.9


class Scenario(Settings):
    """One scenario file."""

    name: str
    about: str
    duration_s: Positive
    flight: Flight
    judged: Judged
    world: World = World()
    control: ControlSettings = ControlSettings()

    @model_validator(mode="after")
    def _check(self) -> "Scenario":
        flight = self.flight
        if isinstance(flight, FormationFlight):
            for what, when_s in (("change_s", flight.change_s), ("ending_s", flight.ending_s)):
                if when_s >= self.duration_s:
                    raise ValueError(f"flight.{what} = {when_s:g}: before duration_s = {self.duration_s:g}")
        return self


def folder() -> Path:
    """Where the scenarios lie that come with the package."""
    return configuration.shipped_folder() / "scenarios"


def shipped() -> list[Path]:
    """All of them, by name."""
    return sorted(folder().glob("*.yaml"))


def find(name: str) -> Path:
    """A scenario file: a path as it is, else a shipped one. Raises: ConfigError naming what there is."""
    path = Path(name)
    if path.is_file():
        return path
    inside = folder() / f"{path.name.removesuffix('.yaml')}.yaml"
    if path.parent in {Path(), Path("configs/scenarios")} and inside.is_file():
        return inside
    known = ", ".join(found.stem for found in shipped())
    raise ConfigError(f"{name}: there is no such file; scenarios that come with the package: {known}")


def load(path: Path) -> Scenario:
    """Read and check one. `like: NAME` takes everything from another file first.

    Raises: ConfigError that names the file, the key, its value and what would be right.
    """
    raw = _merged(path, MOST_PARENTS)
    raw["name"] = path.stem
    try:
        return Scenario.model_validate(raw)
    except ValidationError as error:
        raise configuration.explained(error, str(path)) from None


def _merged(path: Path, parents: int) -> dict[str, object]:
    raw = configuration.parse_mapping(
        configuration.read(path), str(path), "about, duration_s, flight and judged at least"
    )
    like = raw.pop("like", None)
    if like is None:
        return raw
    if not isinstance(like, str):
        raise ConfigError(f"{path}: like = {like!r}: the name of another scenario")
    if parents == 0:
        raise ConfigError(f"{path}: like: no longer chain than {MOST_PARENTS} scenarios")
    beside = path.with_name(f"{like}.yaml")
    return _over(_merged(beside if beside.is_file() else find(like), parents - 1), raw)


def _over(below: Mapping[str, object], above: Mapping[str, object]) -> dict[str, object]:
    """`above` laid over `below`, key by key, sections within sections; an empty value takes the key away."""
    merged = dict(below)
    for key, value in above.items():
        old = merged.pop(key, None)
        if isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _over(old, value)
        elif value is not None:
            merged[key] = value
    return merged
