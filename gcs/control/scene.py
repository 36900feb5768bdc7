"""What the centre's way past obstacles is planned in: the tick, the sphere, the boxes grown by it."""

from dataclasses import dataclass, field

import numpy as np

from gcs.control.inputs import TickInputs
from gcs.formation.obstacles import Outlines
from gcs.formation.orbit import CLEAR_OF_FENCE_M, Center, orbit_velocity, within_ground_speed
from gcs.formation.route import Boxes, Goal
from gcs.formation.route_search import gaps_m
from gcs.model.state import Array

ALOFT_M = 1.0
"""A centre this far above the plan's height flies over obstacles."""

SLOWEST_M_S = 0.3
"""Routes are planned at least this fast."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """What a detour is planned in."""

    now: TickInputs
    center: Center
    sphere_m: float
    reach_m: float  # how far from the show's origin the target is followed
    outlines: Outlines  # all obstacles, margin and headroom included
    known: dict[tuple[float, float | None, bytes], Boxes] = field(default_factory=dict)  # in this tick

    @property
    def place_m(self) -> Array:
        """(2,) of the centre."""
        return self.center.position_m[:2]

    @property
    def height_m(self) -> float:
        """Of the centre."""
        return float(-self.center.position_m[2])

    @property
    def plan_height_m(self) -> float:
        """At which the centre is to fly."""
        return self.now.center_height_m(self.sphere_m)

    @property
    def speed_m_s(self) -> float:
        """Speed of the detour: the plan's, or twice that of the fastest box, within the centre's limit."""
        plan, law = self.now.plan, self.now.settings.law
        fastest_m_s = float(np.hypot(*self.outlines.velocity_m_s.T).max(initial=0.0))
        own_m_s = plan.orbit.speed_m_s + plan.target.speed_m_s
        return max(min(law.center_speed_max_m_s, max(own_m_s, 2.0 * fastest_m_s)), SLOWEST_M_S)

    @property
    def lowest_level_m(self) -> float:
        """The lower of the centre's height and the plan's."""
        return min(self.plan_height_m, self.height_m)

    def speed_to_m_s(self, goal: Goal) -> float:
        """Speed on the way to that goal: all that the centre has where it flees."""
        return self.now.settings.law.center_speed_max_m_s if goal.flees else self.speed_m_s

    @property
    def on_orbit(self) -> bool:
        """Whether the law leads round the target, not to it."""
        return self.now.tasks.center_moves and self.now.plan.orbit.radius_m > 0.0

    @property
    def fence_m(self) -> float:
        """How far from the show's origin the centre may be."""
        return self.now.settings.safety.fence.distance_max_m - self.sphere_m - CLEAR_OF_FENCE_M / 2

    def towards(self, goal: Goal) -> Array:
        """(2,) velocity with which the law leads the centre to a goal, as to a target without an orbit."""
        plan, law, dt_s = self.now.plan, self.now.settings.law, self.now.dt_s
        relative_m_s = orbit_velocity(
            self.center.later(dt_s).position_m[:2] - goal.later(dt_s).place_m,
            radius_m=0.0,
            speed_m_s=self.speed_to_m_s(goal) if goal.flees else plan.orbit.speed_m_s,
            direction=plan.orbit.direction,
            braking_m_s2=law.center_acceleration_max_m_s2 / 2,
        )
        return within_ground_speed(goal.velocity_m_s, relative_m_s, law.center_speed_max_m_s)

    def boxes(self, clear: float, height_m: float | None, goal_m: Array | None) -> Boxes:
        """The boxes in the way at that height, grown by that share of the sphere, but not over the goal.

        Moving boxes, and all boxes that only a part of the sphere passes, count as the ellipses that vehicles
        fly round: else vehicles are driven ahead of a box, or left behind where the centre passes a gap. At
        the plan's height a centre above it may not descend into a box.
        """
        key = (clear, height_m, b"" if goal_m is None else goal_m[:2].tobytes())
        if key not in self.known:
            self.known[key] = self._grown(clear, height_m, goal_m)
        return self.known[key]

    def outlines_at(self, level_m: float) -> Outlines:
        """The obstacles as high as the lowest point of the sphere, with its centre at that height."""
        return self.outlines.only(level_m - self.sphere_m < self.outlines.top_height_m)

    def room(self, outlines: Outlines) -> Boxes:
        """The ellipses grown by the whole sphere at the plan's height: no slot lies in one."""
        grown_m = self.clearance_m(outlines, self.lowest_level_m)
        return Boxes.grown(outlines, grown_m, self.place_m, as_ellipse=np.ones(len(outlines), np.bool_))

    def clearance_m(self, outlines: Outlines, level_m: float) -> Array:
        """(m,) by how much boxes are grown so that the whole sphere, at that height, passes clear of them."""
        settings = self.now.settings.law.avoidance
        above_m = np.maximum(level_m - outlines.top_height_m, 0.0)
        section_m = np.sqrt(np.maximum(self.sphere_m**2 - above_m**2, 0.0))
        return settings.center_clearance * section_m + settings.near_m

    def _grown(self, clear: float, height_m: float | None, goal_m: Array | None) -> Boxes:
        near_m = self.now.settings.law.avoidance.near_m
        level_m = self.lowest_level_m if height_m is None else height_m
        outlines = self.outlines_at(level_m)
        grown_m = near_m + clear * (self.clearance_m(outlines, level_m) - near_m)
        as_ellipse = ~outlines.stand | (clear < 1.0)
        if goal_m is not None:
            gap_m = gaps_m(outlines.center_m, outlines.half_length_m, goal_m[:2])
            grown_m = np.where(outlines.stand, np.clip(gap_m - 0.05, 0.0, grown_m), grown_m)
            off_goal = (((goal_m[:2] - outlines.center_m) / outlines.semi_m) ** 2).sum(axis=1) > 1.0
            as_ellipse &= off_goal | ~outlines.stand
        strict = height_m is None and self.height_m > self.plan_height_m + ALOFT_M
        return Boxes.grown(outlines, grown_m, self.place_m, as_ellipse=as_ellipse, strict=strict)
