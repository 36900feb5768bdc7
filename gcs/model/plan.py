"""The operator's plan: formation, target, orbit, obstacles, yaw. Immutable; a change is a new value.

Every constructor refuses what can never be flown, with the field's name and what is allowed. Whether a plan
fits the fleet and the moment (radius for N, height, limits) is checked in `gcs.planning.feasibility`.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from math import hypot, isfinite
from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

from gcs.model.errors import InvalidError
from gcs.model.settings import PUBLISHED

DEFAULT_LAW: Final = "slots"

MAX_OBSTACLES = 32
"""Limit, because every tick checks each obstacle, and every landing checks each for every landing site."""


class Direction(StrEnum):
    """Sense of the orbit, seen from above."""

    CLOCKWISE = "clockwise"
    COUNTERCLOCKWISE = "counterclockwise"


class YawPolicy(StrEnum):
    """Heading of the vehicles: as at engagement, a fixed yaw, or towards the target."""

    HELD = "held"
    FIXED = "fixed"
    TARGET = "target"


def require_finite(**values: float) -> None:
    """Raises: InvalidError naming the first of `values` that is NaN or infinite."""
    for field, value in values.items():
        if not isfinite(value):
            raise InvalidError(field, value, "a finite number")


def require_positive(**values: float) -> None:
    """Raises: InvalidError naming the first of `values` that is not finite and above zero."""
    for field, value in values.items():
        if not (isfinite(value) and value > 0):
            raise InvalidError(field, value, "greater than 0")


@dataclass(frozen=True, slots=True)
class Formation:
    """The virtual sphere: its radius, its centre's height above the show's origin, its rotation, its law.

    It rotates about the vertical; a positive `spin_rad_s` is clockwise seen from above. The law is one of
    `gcs.formation.laws.registry`, and changes on the ground only.
    """

    radius_m: float
    height_m: float
    spin_rad_s: float = 0.0
    law: str = DEFAULT_LAW

    def __post_init__(self) -> None:
        require_positive(radius_m=self.radius_m)
        require_finite(height_m=self.height_m, spin_rad_s=self.spin_rad_s)


@dataclass(frozen=True, slots=True)
class Orbit:
    """Orbit of the formation's centre around the target; with radius 0 the centre stays above the target."""

    __pydantic_config__ = PUBLISHED

    radius_m: float = 0.0
    speed_m_s: Annotated[float, Field(description="Relative to the target.")] = 2.0
    direction: Direction = Direction.COUNTERCLOCKWISE

    def __post_init__(self) -> None:
        require_finite(radius_m=self.radius_m)
        if self.radius_m < 0:
            raise InvalidError("radius_m", self.radius_m, "0 or more")
        require_positive(speed_m_s=self.speed_m_s)


MOTION: Final = ("x_m", "y_m", "velocity_x_m_s", "velocity_y_m_s", "time_s")


class _Moving:
    """What moves over the ground with a constant velocity."""

    __slots__ = ()

    x_m: float
    y_m: float
    velocity_x_m_s: float
    velocity_y_m_s: float
    time_s: float

    def require_finite_motion(self) -> None:
        require_finite(**{name: getattr(self, name) for name in MOTION})

    def position_m(self, time_s: float) -> tuple[float, float]:
        """(x, y) at `time_s`, by dead reckoning."""
        elapsed_s = time_s - self.time_s
        return self.x_m + self.velocity_x_m_s * elapsed_s, self.y_m + self.velocity_y_m_s * elapsed_s

    @property
    def velocity_m_s(self) -> tuple[float, float]:
        return self.velocity_x_m_s, self.velocity_y_m_s

    @property
    def speed_m_s(self) -> float:
        return hypot(self.velocity_x_m_s, self.velocity_y_m_s)


@dataclass(frozen=True, slots=True)
class Target(_Moving):
    """The ground target in the show frame, as last received; it moves on with its velocity."""

    x_m: float = 0.0
    y_m: float = 0.0
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    time_s: float = 0.0  # loop clock: when it was there
    followed: bool = False  # as fast as the vehicles can; False: within the limits of the law, or of the show
    acceleration_x_m_s2: float = 0.0  # now; it moves on without
    acceleration_y_m_s2: float = 0.0
    deviation_m_s: float = 0.0  # of its velocity along an axis, by its newest report
    deviation_m: float = 0.0  # of its position along an axis
    height_m: float = 0.0  # above the show's origin; the formation flies above that
    climb_m_s: float = 0.0
    height_deviation_m: float = 0.0
    clearance_m: float = 0.0  # no vehicle comes nearer; 0: vehicles may

    def __post_init__(self) -> None:
        self.require_finite_motion()
        rest = (field.name for field in fields(self) if field.name not in MOTION)
        require_finite(**{name: getattr(self, name) for name in rest})
        if self.clearance_m < 0.0:
            raise InvalidError("clearance_m", self.clearance_m, "0 or more")

    def held(self, time_s: float) -> "Target":
        """The target if it stands from `time_s` on."""
        x_m, y_m = self.position_m(time_s)
        return replace(
            self,
            x_m=x_m,
            y_m=y_m,
            **dict.fromkeys(("velocity_x_m_s", "velocity_y_m_s", "climb_m_s", "deviation_m_s"), 0.0),
            **dict.fromkeys(("acceleration_x_m_s2", "acceleration_y_m_s2"), 0.0),
            time_s=time_s,
            followed=True,
        )


@dataclass(frozen=True, slots=True)
class Obstacle(_Moving):
    """A box on the ground, edges along the show frame's axes, at its position at `time_s`."""

    __pydantic_config__ = PUBLISHED

    id: str
    x_m: float  # centre
    y_m: float
    half_length_x_m: float
    half_length_y_m: float
    height_m: float  # of its top, above the show's origin
    velocity_x_m_s: float = 0.0
    velocity_y_m_s: float = 0.0
    time_s: Annotated[float, Field(exclude=True)] = 0.0  # loop clock: when it was there

    def __post_init__(self) -> None:
        if not self.id:
            raise InvalidError("id", self.id, "at least one character")
        self.require_finite_motion()
        require_positive(
            half_length_x_m=self.half_length_x_m,
            half_length_y_m=self.half_length_y_m,
            height_m=self.height_m,
        )


@dataclass(frozen=True, slots=True)
class Yaw:
    """Heading of every vehicle. `fixed_rad` counts for FIXED: from the show's x axis towards y."""

    policy: YawPolicy = YawPolicy.HELD
    fixed_rad: float = 0.0

    def __post_init__(self) -> None:
        require_finite(fixed_rad=self.fixed_rad)


@dataclass(frozen=True, slots=True)
class Plan:
    """Everything the operator may change while the show flies."""

    formation: Formation
    orbit: Orbit = Orbit()
    target: Target = Target()
    obstacles: tuple[Obstacle, ...] = ()
    yaw: Yaw = Yaw()

    def __post_init__(self) -> None:
        if len(self.obstacles) > MAX_OBSTACLES:
            raise InvalidError("obstacles", len(self.obstacles), f"at most {MAX_OBSTACLES}")

    def differs_in_time_only(self, other: "Plan") -> bool:
        """Whether the two are the same but for the times of target and obstacles; also where these agree."""

        def untimed(plan: Plan) -> Plan:
            boxes = tuple(replace(box, time_s=0.0) for box in plan.obstacles)
            return replace(plan, target=replace(plan.target, time_s=0.0), obstacles=boxes)

        return untimed(self) == untimed(other)

    def moved(self, shift_s: float) -> "Plan":
        """Return the same plan with its times moved by `shift_s`: for another clock."""
        target = replace(self.target, time_s=self.target.time_s + shift_s)
        boxes = (replace(box, time_s=box.time_s + shift_s) for box in self.obstacles)
        return replace(self, target=target, obstacles=tuple(boxes))


def plan_json(plan: Plan, **more: object) -> str:
    """The plan as JSON, with the fields `more` added; times are those of the loop's clock."""
    return json.dumps({**asdict(plan), **more}, separators=(",", ":"))


_PLAN: Final = TypeAdapter(Plan)


def plan_of(raw: Mapping[str, Any], shift_s: float) -> Plan:
    """A recorded plan, its times moved by `shift_s`. Raises: GcsError or ValueError when it is no plan."""
    return _PLAN.validate_python(raw).moved(shift_s)
