"""Motion of the formation's centre: around a moving ground target, and past obstacles, for the whole sphere.

Past obstacles it looks farther ahead than the vehicles do, and at ellipses grown by the sphere, so that no
vehicle has to leave the shape. The side on which it passes counts for all vehicles.
Source: article, section 3, corrected.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from gcs.formation.obstacles import Outlines
from gcs.formation.steering import LEFT, RIGHT
from gcs.model.plan import Direction
from gcs.model.state import Array, Mask

NEAR_M = 1e-3
"""Closer to the target than this the field has no direction of its own and points along x."""

PACE_LEAST = 0.2
PACE_REGAINED_PER_S = 0.01
PACE_LOST_PER_M = 1.0
GUST_M_S = 0.1  # a smaller lack of speed does not count
PACE_LOST_MAX_PER_S = 0.15
"""See `next_pace`: 5 m/s round 30 m leave half of 1 m/s2 for braking."""

CLEAR_OF_FENCE_M = 2.0
"""Distance kept between the fence and the farthest point of the sphere on the orbit's farthest point."""


def target_reach_m(distance_max_m: float, orbit_radius_m: float, sphere_radius_m: float) -> float:
    """How far from the show's origin a target can be followed, 0 or more: orbit and sphere stay inside."""
    return max(0.0, distance_max_m - orbit_radius_m - sphere_radius_m - CLEAR_OF_FENCE_M)


def followed_target(target_m: Array, velocity_m_s: Array, reach_m: float) -> tuple[Array, Array]:
    """The target itself, or its projection on the circle within which it can be followed.

    Dead reckoning ignores the fence: a target that is not updated moves on without end; the formation must
    not.

    Args:
        target_m: (2,) from the show's origin.
        velocity_m_s: (2,) of the target.
        reach_m: radius of that circle, 0 or more.

    Returns: (2,) position and (2,) velocity of what is followed. Beyond the circle that is the velocity of
        the projection: without the target's outward motion, and with its motion round the origin scaled to
        the smaller circle.
    """
    distance_m = hypot(target_m[0], target_m[1])
    if distance_m <= reach_m:
        return target_m, velocity_m_s
    outward = target_m / distance_m
    across_m_s = velocity_m_s - (velocity_m_s @ outward) * outward
    return outward * reach_m, across_m_s * (reach_m / distance_m)


def held_within(velocity_m_s: Array, position_m: Array, reach_m: float, braking_m_s2: float) -> Array:
    """The part of the velocity with which a point can still stop within `reach_m` of the origin, (2,) each.

    Only the outward part is shortened. Beyond `reach_m` nothing leads farther out.
    """
    distance_m = max(hypot(position_m[0], position_m[1]), NEAR_M)
    outward = position_m / distance_m
    possible_m_s = sqrt(2.0 * braking_m_s2 * max(reach_m - distance_m, 0.0))
    excess_m_s = max(float(velocity_m_s @ outward) - possible_m_s, 0.0)
    held_m_s: Array = velocity_m_s - excess_m_s * outward
    return held_m_s


def orbit_velocity(
    offset_m: Array, *, radius_m: float, speed_m_s: float, direction: Direction, braking_m_s2: float
) -> Array:
    """Velocity of the centre relative to the target that leads onto the orbit and round it.

    The article prints the factor ``v_d / (rho^2 + r^2)``, whose speed is ``v_d rho``; the field that it comes
    from also divides by rho and has the speed v_d everywhere. This function returns the latter.

    Args:
        offset_m: (2,) centre minus target, show frame (x ahead, y right).
        radius_m: of the orbit; 0 leads to the target itself and stops there.
        speed_m_s: v_d, kept everywhere for a radius above 0.
        direction: seen from above. The article's signs are counter-clockwise in this frame.
        braking_m_s2: for radius 0: deceleration of the approach.

    Returns: (2,) in m/s.

    Source: article, section 3; Lawrence, Frew and Pisano 2008, "Lyapunov vector fields for autonomous
        unmanned aircraft flight control".
    """
    x, y = float(offset_m[0]), float(offset_m[1])
    rho_m = hypot(x, y)
    if radius_m == 0.0:
        approach_m_s = min(speed_m_s, rho_m * braking_m_s2 / max(speed_m_s, NEAR_M))
        return -offset_m / max(rho_m, NEAR_M) * approach_m_s
    x, y = (x, y) if rho_m > NEAR_M else (NEAR_M, 0.0)
    rho_m = max(rho_m, NEAR_M)
    turn = 1.0 if direction is Direction.COUNTERCLOCKWISE else -1.0
    inward = rho_m**2 - radius_m**2
    around = turn * 2.0 * rho_m * radius_m
    factor = speed_m_s / (rho_m * (rho_m**2 + radius_m**2))
    return np.array([factor * (-x * inward + y * around), factor * (-y * inward - x * around)])


def next_pace(pace: float, behind_m_s: float, dt_s: float) -> float:
    """Slow the orbit down while a vehicle at its limits falls behind; return slowly to full speed.

    In wind the airspeed of an orbit changes along it, and may be more than a vehicle can fly. The centre then
    waits for the slowest. The pace falls no faster than the centre can brake, so that it stays on its circle.

    Args:
        pace: share of the orbit's speed until now.
        behind_m_s: speed that the slowest vehicle at its limits lacks along the path, 0 when none lacks any.
        dt_s: of one tick.

    Returns: from 0.2 to 1.
    """
    rate_per_s = max(
        PACE_REGAINED_PER_S - PACE_LOST_PER_M * max(behind_m_s - GUST_M_S, 0.0), -PACE_LOST_MAX_PER_S
    )
    return min(1.0, max(PACE_LEAST, pace + dt_s * rate_per_s))


def within_ground_speed(target_m_s: Array, relative_m_s: Array, limit_m_s: float) -> Array:
    """The target's velocity plus as much of the relative velocity as keeps the sum within the limit.

    Args:
        target_m_s: (2,).
        relative_m_s: (2,).
        limit_m_s: of the sum's length. A faster target cannot be followed: its velocity is then scaled to the
            limit.

    Returns: (2,) in m/s.
    """
    target_speed_m_s = hypot(target_m_s[0], target_m_s[1])
    if target_speed_m_s >= limit_m_s:
        return target_m_s * (limit_m_s / target_speed_m_s)
    a = float(relative_m_s @ relative_m_s)
    b = float(target_m_s @ relative_m_s)
    c = target_speed_m_s**2 - limit_m_s**2
    share = 1.0 if a == 0.0 else (-b + sqrt(b * b - a * c)) / a
    return target_m_s + min(1.0, share) * relative_m_s


@dataclass(frozen=True, slots=True, eq=False)
class Center:
    """The formation's commanded centre: a point that moves within its own limits. Show frame, (3,) each."""

    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array

    @staticmethod
    def at_rest(position_m: Array) -> "Center":
        """A centre at rest at `position_m`, (3,)."""
        return Center(np.array(position_m, dtype=np.float64), np.zeros(3), np.zeros(3))

    def later(self, dt_s: float) -> "Center":
        """A centre that has moved on for `dt_s` with its velocity."""
        return Center(self.position_m + dt_s * self.velocity_m_s, self.velocity_m_s, self.acceleration_m_s2)


def advance_center(center: Center, desired_m_s: Array, dt_s: float, acceleration_max_m_s2: float) -> Center:
    """Move the centre for `dt_s` towards the desired velocity, (3,), within the acceleration limit.

    The resulting acceleration is fed forward to every vehicle, so it must be one that they can follow.
    """
    change_m_s = desired_m_s - center.velocity_m_s
    size_m_s = hypot(*change_m_s.tolist())
    possible_m_s = acceleration_max_m_s2 * dt_s
    if size_m_s > possible_m_s:
        change_m_s = change_m_s * (possible_m_s / size_m_s)
    velocity_m_s = center.velocity_m_s + change_m_s
    return Center(
        center.position_m + dt_s * (center.velocity_m_s + velocity_m_s) / 2, velocity_m_s, change_m_s / dt_s
    )


SLOWEST_M_S = 0.1
"""The centre's time of arrival is computed with at least this speed."""

SIDE_KEPT = 1.5
"""A side is kept within this many lookaheads of an obstacle."""


def kept_sides(
    outlines: Outlines,
    center_m: Array,
    velocity_m_s: Array,
    drones_m: Array,
    sides: Mapping[str, float],
    *,
    near_m: float,
    tall: Mask,
) -> dict[str, float]:
    """Sides (LEFT, RIGHT by name) on which a centre at (3,) passes the `tall` (m,) outlines near its drones.

    A side is kept while one of the drones (n, 3) is within `near_m` of the outline.
    """
    near = tall & (outlines.nearest_m(drones_m) < near_m)
    passing_m_s = np.hypot(*(velocity_m_s[:2] - outlines.velocity_m_s).T) > SLOWEST_M_S
    taken = sides_taken(outlines, center_m, velocity_m_s[:2], near & passing_m_s)
    counts = {name for name, counting in zip(outlines.names, near, strict=True) if counting}
    return {name: side for name, side in (taken | dict(sides)).items() if name in counts}


def sides_taken(outlines: Outlines, center_m: Array, velocity_m_s: Array, ahead: Mask) -> dict[str, float]:
    """The side on which a centre at (3,) passes the ellipses `ahead` (m,), with that velocity (2,)."""
    offset_m, passing_m_s = center_m[:2] - outlines.center_m, velocity_m_s - outlines.velocity_m_s
    on_right = offset_m[:, 0] * passing_m_s[:, 1] > offset_m[:, 1] * passing_m_s[:, 0]
    return {outlines.names[j]: LEFT if on_right[j] else RIGHT for j in np.flatnonzero(ahead)}
