"""Scenario files: the flight, its simulated world, and the required results."""

from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BaseModel, Field, StrictStr, ValidationError, field_validator, model_validator

from gcs.config import yaml_files as documents
from gcs.config.sections import InitialTarget, OrbitSettings
from gcs.config.setting_errors import explained
from gcs.config.yaml_files import Source
from gcs.control import ControlSettings
from gcs.failsafe.policy import FailsafePolicy
from gcs.formation.article import ArticleParameters
from gcs.formation.laws.registry import LawName, law_of
from gcs.formation.obstacles import AvoidanceSettings
from gcs.links.autopilots import AUTOPILOTS, DEFAULT
from gcs.model.errors import ConfigError, quoted
from gcs.model.plan import DEFAULT_LAW, MAX_OBSTACLES
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.traffic import Cylinder
from gcs.shows.format import StandingBox
from gcs.sim.targets.motions import KINDS
from gcs.simulation import ROWS
from gcs.simulation.lies import Lies

VEHICLES_MAX: Final = 20_000

Share: TypeAlias = Annotated[float, Field(ge=0.0, lt=1.0)]
VehicleCount: TypeAlias = Annotated[int, Field(ge=1, le=VEHICLES_MAX)]

MOST_PARENTS = 3
"""Longest chain of `like`; a longer one is a loop, or too hard to follow."""


class Wind(Settings):
    """Wind: a mean, and independent gusts at every vehicle."""

    mean_x_m_s: float = 0.0
    mean_y_m_s: float = 0.0
    gust_m_s: NotNegative = 0.0  # standard deviation along each axis
    gust_time_s: Positive = 2.0  # correlation time
    rise_s: NotNegative = 0.0  # from calm to all of it, from the engagement on


class World(Settings):
    """True properties of vehicles and links, which the ground station does not know."""

    vehicle: Literal["fitted", "cascade"] = "fitted"  # PX4: to its recordings, or made of its own gains
    autopilots: tuple[StrictStr, ...] = (DEFAULT.name,)  # by turns, from the first vehicle on
    ramp_m_s2: Positive = 2.5  # WP_ACC of vehicles that have it
    upright_ramp_m_s2: Positive = 2.5  # WP_ACC_Z of these
    ramp_share: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  # that they fly of it; less: their profile errs
    response_spread: Share = 0.2  # each vehicle's gains, delay and drag differ by up to this, at random
    drag_per_s: NotNegative = 1.0  # as in PX4's simulator; real quadrotors have 0.1 to 0.3
    noise: NotNegative = 0.0  # times the recorded error of the vehicles' own estimates
    bias_m: NotNegative = 0.0  # standard deviation of a slow error of each position, along each axis
    bias_time_s: Positive = 60.0  # its correlation time (first-order Gauss-Markov)
    reported_share: Positive = 1.0  # of the true standard deviation that receivers report; below 1 they lie
    telemetry_delay_s: NotNegative = 0.0  # one way
    setpoint_delay_s: NotNegative = 0.0  # one way
    telemetry_hz: Annotated[float, Field(ge=1.0, le=50.0)] = 50.0  # at most once a tick; vehicles by turns
    loss: Share = 0.0  # of telemetry and of setpoints
    slow_share: Share = 0.0  # of the vehicles, at random, fly no faster than `slow_m_s`
    slow_m_s: Positive = 2.0  # over the ground, as by MPC_XY_VEL_MAX
    slow_until_s: Positive = 1e9
    wind: Wind = Wind()
    lies: Lies | None = None  # of vehicles that report what is not so; None: all report truly
    tick_rate_hz: Annotated[float, Field(ge=1.0, le=50.0)] = 20.0

    def autopilot_of(self, row: int) -> str:
        """The name of that vehicle's autopilot."""
        return self.autopilots[row % len(self.autopilots)]

    @field_validator("autopilots")
    @classmethod
    def _are_known(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if not names or not AUTOPILOTS.keys() >= set(names):
            raise ValueError(f"at least one of {', '.join(AUTOPILOTS)}")
        return names


class SteadyTarget(InitialTarget):
    """A ground target with constant velocity."""

    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0


class TargetPath(SteadyTarget):
    """A ground target: its start, and the changes of its velocity."""

    turns: tuple["ScenarioTurn", ...] = ()


class ScenarioTurn(Settings):
    """A period in which the target accelerates."""

    from_s: NotNegative
    to_s: NotNegative
    acceleration_x_m_s2: float = 0.0
    acceleration_y_m_s2: float = 0.0


class TrackedTarget(Settings):
    """A target that moves as those of `gcs sim --target`, and is estimated from what it reports."""

    motion: StrictStr
    speed_m_s: Positive | None = None  # None: as is usual for such a target
    rate_hz: Annotated[float, Field(gt=0.0, le=50.0)] = 5.0
    noise_m: Positive = 1.0  # one sigma along each axis
    correlated_s: NotNegative = 0.0  # for how long an error stays alike
    delay_s: NotNegative = 0.3
    velocity: bool = True  # whether it is reported too
    drop_out: tuple[Share, NotNegative] = (0.0, 0.0)  # probability that one begins with a report; its length
    jump: tuple[NotNegative, Positive] = (0.0, 1e9)  # length of a jump of one report, every so many s
    freeze: tuple[NotNegative, NotNegative] = (1e9, 0.0)  # from when on it repeats one place, and how long
    doubled: Share = 0.0  # of the reports
    coast_s: Positive = 5.0
    clearance_m: NotNegative = 0.0
    ahead_m: NotNegative = 0.0  # where it begins
    from_s: NotNegative = 20.0  # errors count from then on

    @field_validator("motion")
    @classmethod
    def _is_known(cls, name: str) -> str:
        if name not in KINDS:
            raise ValueError(f"one of {', '.join(KINDS)}")
        return name


class CrossingTraffic(Cylinder):
    """Tracks that cross the formation one after the other, each reported from some distance on."""

    count: Annotated[int, Field(ge=1)] = 10
    from_m: Positive = 300.0  # from here on a track is reported
    speed_min_m_s: Positive = 5.0
    speed_max_m_s: Positive = 30.0
    aside_m: NotNegative = 10.0  # most by which it misses the centre of the formation as it is then
    above_m: NotNegative = 5.0  # likewise above or below
    rate_hz: Positive = 1.0
    noise_m: Positive = 3.0  # one sigma along each axis
    noise_m_s: Positive = 0.5
    delay_s: NotNegative = 1.0
    velocity: bool = True  # whether it is reported too
    height: bool = True
    motions: tuple[Literal["straight", "turn", "circle", "back", "hover"], ...] = ("straight",)  # at random
    together: Annotated[int, Field(ge=1)] = 1  # more: 2 to so many at once, from all sides
    silent_share: Share = 0.0  # of the tracks are not reported any more from a place on


class RandomSite(Settings):
    """A random concave site for every seed: areas of the fence, the controlled ground, or both."""

    kinds: tuple[Literal["star", "u", "ell", "slalom"], ...] = ("star", "u", "ell", "slalom")  # at random
    extent_min_m: Positive = 60.0  # from the middle to the farthest corners
    extent_max_m: Positive = 110.0
    areas: bool = True  # the shape is an area that vehicles stay inside of
    ground: bool = False  # the shape is the controlled ground; with `areas` it is that, grown
    beyond_m: Positive = 30.0  # by so much the ground is then wider
    towers_max: Annotated[int, Field(ge=0, le=6)] = 3  # closed spaces with heights
    outside_share: Share = 0.0  # of the vehicles begin outside, and are led in
    height_min_m: Positive = 8.0  # of starts and goals
    height_max_m: Positive = 35.0


class ScenarioSpin(Settings):
    """The formation's spin from a time on."""

    from_s: NotNegative
    rate_rad_s: float  # positive: clockwise seen from above


class ScenarioBox(StandingBox):
    """An obstacle with a velocity."""

    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0


class RandomObstacles(Settings):
    """Random boxes for every seed, in the way of a formation that starts at once."""

    kind: Literal[
        "one",
        "many",
        "on-orbit",
        "closing",
        "surround",
        "walls",
        "closed",
        "held",
        "sliding",
        "home",
        "home-closed",
    ]
    half_length_min_m: Positive = 1.5
    half_length_max_m: Positive = 8.0
    height_min_m: Positive = 8.0
    height_max_m: Positive = 45.0
    speed_min_m_s: Positive = 2.0  # of the formation's centre
    speed_max_m_s: Positive = 4.0
    length_m: Positive = 120.0  # from start to target, among many boxes
    orbit_radius_m: Positive = 30.0
    boxes_max: Annotated[int, Field(ge=1, le=MAX_OBSTACLES)] = 10
    moving_share: Share = 0.3  # at most half as fast as the formation
    sudden_share: Share = 0.3  # of the boxes become known in flight, never within a stopping distance
    sudden_until_s: NotNegative = 15.0
    passage_m: Positive = 6.0  # between boxes that do not overlap: twice floor, margin and uncertainty
    stopping_m: Positive = 12.0  # free around the start; a stop from 5 m/s takes 10.3 m
    beyond_m: Positive = 5.0  # free around the sphere at the target
    closing_from_m: Positive = 60.0  # from where boxes drive at a standing formation
    closing_max_m_s: Positive = 1.5

    @property
    def arrives(self) -> bool:
        """Whether the formation is to arrive somewhere, where the flight ends."""
        return self.kind in {"one", "many", "on-orbit", "walls"}

    @property
    def parts(self) -> bool:
        """Whether the boxes are between the formation and its pads."""
        return self.kind in {"home", "home-closed"}


class Radio(Settings):
    """Messages between neighbours carry the law `neighbours`: their positions and estimates of the centre."""

    delay_s: NotNegative = 0.1
    loss: Share = 0.1  # of the messages, independently for each pair
    silence_max_s: Positive = 0.5  # messages older than this are ignored
    center: Literal["given", "agreed"] = "given"  # agreed: by consensus between neighbours, from sightings
    sighting_share: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0  # of the vehicles observe the centre
    sighting_error_m: NotNegative = 0.0  # standard deviation along each axis, constant for each vehicle


class Divided(Settings):
    """Several flights, each with its share of the vehicles in their order, and the bus between them."""

    count: Annotated[int, Field(ge=1, le=100)] = 1
    delay_s: NotNegative = 0.02  # one way
    spread_s: NotNegative = 0.01  # each message is later or earlier by up to this
    loss: Share = 0.01  # of the messages


class ScenarioLoss(Settings):
    """Vehicles that lose their links for good, and do what their autopilots are configured to do."""

    share: Share = 0.0
    at_s: NotNegative = 12.0
    action: Literal["hold", "descend", "land", "return"] = "hold"


class Carried(Settings):
    """A vehicle that something carries along the sphere, holds there, and lets go."""

    from_s: Positive = 25.0
    off_m: Positive = 8.0
    speed_m_s: Positive = 2.0
    held_s: Positive = 20.0


class FormationFlight(Settings):
    """A flight in formation: all vehicles hover at take-off height and are engaged at time 0."""

    kind: Literal["formation"]
    start: Literal["grid", "random", "square", "sphere"] = "grid"
    pads: Literal["below", "shuffled"] = "below"  # below the start, or a random permutation of a grid
    spacing_m: Positive = 4.0  # or as far as the service needs, if more
    takeoff_height_m: Positive = 5.0
    radius_m: Positive | Literal["least"] | None = None  # None: max(10, 1.4 sqrt(N)), or the least if more
    height_m: Positive | None = None  # None: the lowest point 5 m above the take-off height
    orbit: OrbitSettings = OrbitSettings()  # of the centre; radius 0: it stays above the target
    center_moves_from_s: NotNegative = 0.0
    target: TargetPath = TargetPath()
    tracked: TrackedTarget | None = None  # instead of `target`
    traffic: CrossingTraffic | None = None
    spins: tuple[ScenarioSpin, ...] = ()
    boxes: tuple[ScenarioBox, ...] = ()
    site: RandomSite | None = (
        None  # its target is then at random within it, if `center_moves_from_s` is reached
    )
    random_obstacles: RandomObstacles | None = (
        None  # also set target, orbit and speed; only with start: sphere
    )
    leave_share: Share = 0.0  # of the vehicles disappear at `change_s`
    join: Annotated[int, Field(ge=0)] = 0  # vehicles that hover beside the others join at `change_s`
    change_s: NotNegative = 0.0
    loss: ScenarioLoss = ScenarioLoss()
    carried: Carried | None = None
    ending: Literal["none", "return", "return-one", "come-down", "descend", "hold", "land"] = "none"
    ending_s: NotNegative = 0.0
    law: LawName = DEFAULT_LAW
    radio: Radio | None = None  # None: the law is computed on the ground
    charges: tuple[Positive, ...] = (1.0,)  # vehicle by vehicle, repeated from the first
    speeds_m_s: tuple[Positive, ...] = ()  # likewise each vehicle's own limit; empty: only the fleet's


class GoalFlight(Settings):
    """A flight of all vehicles at once, each to a goal of its own."""

    kind: Literal["goals"]
    layout: Literal["opposite", "cube", "head-on", "crossing"]
    extent_m: Positive  # radius of the sphere; edge of the cube; length of the paths
    spacing_m: Positive = 6.0  # least distance between positions
    lowest_m: Positive = 10.0  # height of the lowest position
    arrived_m: Positive = 1.0
    site: RandomSite | None = None  # instead of the layout: starts and goals anywhere within it
    boxes: tuple[ScenarioBox, ...] = ()  # known from the beginning
    loss: ScenarioLoss = ScenarioLoss()


class ArticleFlight(Settings):
    """Section 5 of the article, with its own parameters and virtual dynamics."""

    kind: Literal["article"]
    parameters: ArticleParameters = ArticleParameters()
    charge: Positive = 1.0  # of every vehicle; the article gives none
    start_half_m: Positive = 2.0  # vehicles start at random in a cube with this half edge about the target
    spacing_m: Positive = 1.0
    height_m: Positive = 10.0
    orbit: OrbitSettings = OrbitSettings(radius_m=15.0, speed_m_s=12.0)
    center_moves_from_s: NotNegative = 0.0
    center_acceleration_max_m_s2: Positive = 20.0  # the article's centre has no limit
    target: SteadyTarget = SteadyTarget()
    boxes: tuple[StandingBox, ...] = ()
    avoidance: AvoidanceSettings = AvoidanceSettings()


class Adversity(Settings):
    """What a show does not know of: vehicles that are lost, and obstacles that stand from the beginning."""

    loss: ScenarioLoss = ScenarioLoss()  # its time counts from the beginning of the assembly
    boxes: tuple[ScenarioBox, ...] = ()
    site: RandomSite | None = None


class DrawnTraffic(Settings):
    """A drawn show for every seed, in which vehicles pass each other: on opposing lanes, or crossing."""

    spacing_m: Positive = 3.0  # sideways; one and a half times as much up and down
    speed_min_m_s: Positive = 2.5  # of the fastest vehicle
    speed_max_m_s: Positive = 4.0


class ShowFlight(Adversity):
    """A written show, as `gcs show check` flies it, in the scenario's world."""

    kind: Literal["show"]
    show: StrictStr = ""  # a file, or the name of one that is shipped
    traffic: DrawnTraffic | None = None  # instead of `show`

    @model_validator(mode="after")
    def _is_one(self) -> "ShowFlight":
        if bool(self.show) == bool(self.traffic):
            raise ValueError("show or traffic: one of them")
        return self


Flight: TypeAlias = Annotated[
    FormationFlight | GoalFlight | ArticleFlight | ShowFlight, Field(discriminator="kind")
]

KINDS_OF_FLIGHT: Final[dict[str, type[Settings]]] = {
    "formation": FormationFlight,
    "goals": GoalFlight,
    "article": ArticleFlight,
    "show": ShowFlight,
}


class FigureGate(Settings):
    """Limits of a figure."""

    least: float | None = None
    most: float | None = None


class Judged(Settings):
    """The runs by which a scenario is judged, and the limits of their figures."""

    vehicles: tuple[VehicleCount, ...]
    seeds: Annotated[int, Field(ge=1, le=1000)] = 1  # that many, from `first_seed`
    first_seed: int = 6000
    must: dict[str, FigureGate] = Field(default_factory=dict)  # for instance separation.violations; every run
    mostly: dict[str, FigureGate] = Field(default_factory=dict)  # likewise, in 95 % of the runs of each fleet
    few: Annotated[int, Field(ge=0)] = 20  # up to this many vehicles: `nearest_few`; above: `nearest_many`
    nearest_few: float = 0.97
    nearest_many: float = 0.9


class Scenario(Settings):
    """One scenario: the flight, its simulated world, and the required results. Immutable."""

    name: str
    about: str
    row: Literal[ROWS] | None = None  # type: ignore[valid-type]  # one of a tuple
    duration_s: Positive
    flight: Flight
    judged: Judged
    world: World = World()
    worlds: tuple[World, ...] = ()  # instead of `world`, seed by seed in turn; the file has what differs
    control: ControlSettings = ControlSettings()
    failsafes: FailsafePolicy | None = None  # of the service, for a formation; None: they are off
    divided: Divided = Divided()

    @classmethod
    def load(cls, name: str | Path) -> "Scenario":
        """Read a scenario that is shipped, by its name, or a file by its path.

        Raises: ConfigError when there is none, with the names near it, or when it cannot be flown.
        """
        return load(find(str(name)))

    @classmethod
    def build(
        cls, duration_s: float, kind: str = "formation", *, name: str = "built", **keys: Any
    ) -> "Scenario":
        """A scenario without a file: its kind of flight, and keys as of `with_`; all others have defaults.

        Raises: ConfigError as of `with_`.
        """
        raw = {"name": name, "about": "", "duration_s": duration_s, "judged": {"vehicles": [20]}}
        return _checked(_changed(raw | {"flight": {"kind": kind}}, keys, name), name)

    def with_(self, **keys: Any) -> "Scenario":
        """The same scenario with other values: keys of a scenario, of its `flight` or of its `world`.

        A section (a dict, or the settings themselves) changes what it has, as `like` does in a file, and None
        gives a key its default. What changes the world changes each of `worlds`.

        Raises: ConfigError that names a key that is not known, or its value and what is allowed.
        """
        return _checked(_changed(self.model_dump(exclude_unset=True), keys, self.name), self.name)

    def in_world_of(self, seed: int) -> "Scenario":
        worlds = self.worlds
        return self.model_copy(update={"world": worlds[seed % len(worlds)]}) if worlds else self

    @model_validator(mode="after")
    def _check(self) -> "Scenario":
        flight = self.flight
        if isinstance(flight, FormationFlight):
            for what, when_s in (("change_s", flight.change_s), ("ending_s", flight.ending_s)):
                if when_s >= self.duration_s:
                    raise ValueError(f"flight.{what} = {when_s:g}: before duration_s = {self.duration_s:g}")
            if flight.radio is not None and not law_of(flight.law).takes_sight:
                raise ValueError("flight.radio: its messages are for law: neighbours")
            if self.failsafes is None and any(world.lies for world in (self.world, *self.worlds)):
                raise ValueError("failsafes: needed with world.lies: they name the vehicles that lie")
            if flight.random_obstacles is not None and flight.start != "sphere":
                raise ValueError("flight.random_obstacles: the formation flies at once, so start: sphere")
        return self


NEEDED: Final = "about, duration_s, flight and judged at least"

find, shipped = documents.SCENARIOS.find, documents.SCENARIOS.shipped


def load(path: Path) -> Scenario:
    """Read and check a scenario. `like: NAME` first takes all keys from another file.

    Raises: ConfigError that names the file, the key, its value and what is allowed.
    """
    source = Source(documents.read(path), str(path))
    alone = "like" not in source.mapping(NEEDED)  # with `like` a key may be in another file
    raw = _merged(path, MOST_PARENTS)
    raw["name"] = path.stem
    world, worlds = raw.get("world", {}), raw.get("worlds")
    if isinstance(world, dict) and isinstance(worlds, list):
        raw["worlds"] = [_over(world, own) if isinstance(own, dict) else own for own in worlds]
    return _checked(raw, str(path), source if alone else None)


def _checked(raw: dict[str, Any], file: str, source: Source | None = None) -> Scenario:
    try:
        return Scenario.model_validate(raw)
    except ValidationError as error:
        raise explained(error, file, Scenario, source) from None


def _changed(raw: Mapping[str, Any], keys: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Merge keys of a scenario, of its flight and of its world. Raises: ConfigError for one not known."""
    flight = KINDS_OF_FLIGHT.get(str(raw["flight"]["kind"]), FormationFlight)
    sections: dict[str, type[Settings]] = {"": Scenario, "flight": flight, "world": World}
    merged = dict(raw)
    for key, value in keys.items():
        places = [section for section, settings in sections.items() if key in settings.model_fields]
        if not places:
            names = [each for settings in sections.values() for each in settings.model_fields]
            near = " or ".join(get_close_matches(key, names, 3)) or "a key of Scenario, its flight or World"
            raise ConfigError(f"{name}: {key}: unknown keyword; did you mean {near}?")
        if len(places) > 1:
            ways = " or ".join(f"{place}={{'{key}': ...}}" for place in places)
            raise ConfigError(f"{name}: {key}: there are several; say {ways}")
        plain = value.model_dump(exclude_unset=True) if isinstance(value, BaseModel) else value
        change = {places[0]: {key: plain}} if places[0] else {key: plain}
        merged = _over(merged, change)
        world, worlds = change.get("world"), merged.get("worlds")
        if isinstance(world, dict) and isinstance(worlds, list | tuple):
            merged["worlds"] = [_over(each, world) if isinstance(each, dict) else each for each in worlds]
    return merged


def _merged(path: Path, parents: int) -> dict[str, object]:
    raw = Source(documents.read(path), str(path)).mapping(NEEDED)
    like = raw.pop("like", None)
    if like is None:
        return raw
    if not isinstance(like, str):
        raise ConfigError(f"{path}: like = {quoted(like)}: the name of another scenario")
    if parents == 0:
        raise ConfigError(f"{path}: like: no longer chain than {MOST_PARENTS} scenarios")
    beside = path.with_name(f"{like}.yaml")
    return _over(_merged(beside if beside.is_file() else find(like), parents - 1), raw)


def _over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Merge `above` over `below` recursively; an empty value removes the key."""
    merged = dict(below)
    for key, value in above.items():
        old = merged.pop(key, None)
        if isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _over(old, value)
        elif value is not None:
            merged[key] = value
    return merged
