"""A drawn show as it was imported: trajectories, lights and yaw of each vehicle, and what the file claims."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import radians
from typing import Any

import numpy as np

from gcs.model.errors import ShapeError
from gcs.model.frames import ShowFrame
from gcs.model.state import Array, freeze
from gcs.safety.fenced_areas import FencedArea
from gcs.shows.drawn.light_programs import LightProgram, LightPrograms
from gcs.shows.drawn.trajectories import Trajectories, Trajectory, turned
from gcs.shows.drawn.yaw_programs import NO_YAW, YawProgram, YawPrograms


@dataclass(frozen=True, slots=True)
class Claims:
    """What the file says that the show keeps to. `gcs show check` measures it; None: the file is silent."""

    separation_min_m: float | None = None
    speed_max_m_s: float | None = None  # sideways
    climb_max_m_s: float | None = None
    sink_max_m_s: float | None = None
    height_max_m: float | None = None  # above the show's origin


@dataclass(frozen=True, slots=True)
class DrawnCue:
    """A name for a time of the show."""

    name: str
    at_s: float


@dataclass(frozen=True, slots=True, eq=False)
class FencePolygon:
    """A polygon of the file's fence, on the ground, show frame."""

    points_m: Array  # (k, 2) x and y
    inside: bool = True  # vehicles stay inside; False: outside

    def __post_init__(self) -> None:
        """Raises: ShapeError when the points are not (k, 2)."""
        freeze(self.points_m, (len(self.points_m), 2), "points_m")

    @property
    def area(self) -> FencedArea:
        """The polygon as the safety filter keeps it. Raises: pydantic's ValueError for too many corners."""
        return FencedArea(
            corners_m=tuple((x_m, y_m) for x_m, y_m in self.points_m.tolist()), inside=self.inside
        )


@dataclass(frozen=True, slots=True, eq=False)
class DrawnShow:
    """A drawn show of n vehicles; row i of every array belongs to `vehicles[i]`.

    Positions are metres in the show frame (x along the heading, y to its right, z down), whatever the file's
    axes. Times are seconds of the show's clock. Before its take-off time a vehicle stands at its home, from
    its landing time on where it ends; take-off and landing are part of a trajectory only if the drawing has
    them.
    """

    title: str
    vehicles: tuple[str, ...]  # n names, as the file has them
    trajectories: Trajectories
    lights: LightPrograms
    yaw: YawPrograms
    home_m: Array  # (n, 3) where the drawing puts each vehicle on the ground
    takeoff_s: Array  # (n,)
    landing_s: Array  # (n,)
    origin: ShowFrame | None = None  # None: the file names no place on Earth
    show_s: tuple[float, float] | None = (
        None  # from when to when the drawing is the show, between take-off and landing
    )
    cues: tuple[DrawnCue, ...] = ()
    claims: Claims = Claims()
    fence: tuple[FencePolygon, ...] = ()
    notes: tuple[str, ...] = ()  # what of the file is not used, in words for an operator

    def __post_init__(self) -> None:
        """Raises: ShapeError when a part has another number of vehicles."""
        count = len(self.vehicles)
        freeze(self.home_m, (count, 3), "home_m")
        freeze(self.takeoff_s, (count,), "takeoff_s")
        freeze(self.landing_s, (count,), "landing_s")
        if not len(self.trajectories) == len(self.lights) == len(self.yaw) == count:
            parts = f"{len(self.trajectories)} trajectories, {len(self.lights)} light programs"
            raise ShapeError(f"{parts} and {len(self.yaw)} yaw programs for {count} vehicles")

    def __len__(self) -> int:
        """Return the number of vehicles."""
        return len(self.vehicles)

    @classmethod
    def of_programs(
        cls,
        vehicles: tuple[str, ...],
        trajectories: Sequence[Trajectory],
        lights: Sequence[LightProgram],
        yaws: Sequence[YawProgram] | None = None,
        **more: Any,
    ) -> "DrawnShow":
        """Return the show of these vehicles, by default at home where their trajectories begin."""
        by_trajectory: dict[str, Any] = {
            "title": "",
            "home_m": np.stack([path.coefficients_m[0, 0] for path in trajectories]),
            "takeoff_s": np.array([path.times_s[0] for path in trajectories]),
            "landing_s": np.array([path.times_s[-1] for path in trajectories]),
        }
        return cls(
            vehicles=vehicles,
            trajectories=Trajectories.joined(trajectories),
            lights=LightPrograms.joined(lights),
            yaw=YawPrograms.joined(yaws or [NO_YAW] * len(vehicles)),
            **(by_trajectory | more),
        )

    @property
    def duration_s(self) -> float:
        """Time at which the last vehicle ends."""
        return float(self.trajectories.end_s.max())

    def placed(self, turn_deg: float, offset_m: Array) -> "DrawnShow":
        """Return the show turned about its origin, clockwise from above, then moved by `offset_m` (3,).

        Trajectories, homes, yaw and fence move together; the origin on Earth stays.
        """
        matrix = turned(turn_deg)
        polygons = [
            replace(polygon, points_m=polygon.points_m @ matrix[:2, :2] + offset_m[:2])
            for polygon in self.fence
        ]
        return replace(
            self,
            trajectories=self.trajectories.placed(turn_deg, offset_m),
            yaw=replace(self.yaw, yaw_rad=self.yaw.yaw_rad + radians(turn_deg)),
            home_m=self.home_m @ matrix + offset_m,
            fence=tuple(polygons),
        )

    def of_vehicles(self, rows: Sequence[int]) -> "DrawnShow":
        """Return the show of some vehicles, in that order: rows of another assignment to pads, or fewer."""
        at = list(rows)
        return replace(
            self,
            vehicles=tuple(self.vehicles[row] for row in at),
            trajectories=self.trajectories.of_vehicles(at),
            lights=self.lights.of_vehicles(at),
            yaw=self.yaw.of_vehicles(at),
            home_m=self.home_m[at],
            takeoff_s=self.takeoff_s[at],
            landing_s=self.landing_s[at],
        )
