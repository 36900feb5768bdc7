"""The mathematics of `laws/slots`: the centre's motion, each vehicle's motion to its slot, spin and yaw.

No slot is assigned: the slots start in the vehicles' own directions, are moved on by their mutual repulsion,
and are kept from tick to tick. Gains are rates (1/s), independent of N and R. The article's terms are in
`repulsion`, `orbit` and `steering`; decision 0001 derives the gains.
"""

from collections.abc import Sequence
from functools import lru_cache
from hashlib import blake2b
from math import cos, pi, sin, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gcs.formation.article import ForceSettings
from gcs.formation.neighbours import NeighboursSettings
from gcs.formation.obstacles import AvoidanceSettings
from gcs.formation.orbit import Center, followed_target, orbit_velocity, within_ground_speed
from gcs.model.frames import wrap_rad
from gcs.model.jit import kernel
from gcs.model.plan import Plan, Yaw, YawPolicy
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import TINY, Array, Mask, VehicleId

KEPT_OFFSETS = 32_768
"""Number of vehicles of which the symmetry offset is cached."""


class LawSettings(Settings):
    """Rates and limits of the law; docs/decisions/law.md says how they were found."""

    speed_m_s: Positive = 4.0
    """Limit of the velocity towards the slot, and sideways of that towards a goal, in m/s."""
    slot_rate_per_s: Positive = 1.0
    """Rate at which a vehicle's distance from its slot decays, in 1/s."""
    sweeps: Annotated[int, Field(ge=1, le=100)] = 4
    """Steps of the slots' descent in every tick."""
    pull: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0005
    """Share of the way from the slots to their vehicles that each step takes."""
    symmetry_rad: NotNegative = 0.03
    """Largest angle between a new vehicle's slot and its own direction, in rad."""
    goal_rate_per_s: Positive = 0.8
    """Rate at which the distance from a goal, or from the height, decays, in 1/s."""
    center_speed_max_m_s: Positive = 4.0
    """Fastest that the centre flies over the ground, in m/s."""
    center_acceleration_max_m_s2: Positive = 1.0
    """Greatest acceleration of the centre, in m/s^2."""
    climb_max_m_s: Positive = 1.0
    """Fastest that the centre climbs or sinks, in m/s."""
    spin_acceleration_max_m_s2: Positive = 1.0
    """Along the sphere's equator while the spin changes, in m/s^2."""
    avoidance: AvoidanceSettings = AvoidanceSettings()
    """How vehicles and the centre fly around obstacles."""
    article: ForceSettings = ForceSettings()
    """Rates of the law `article`."""
    neighbours: NeighboursSettings = NeighboursSettings()
    """Rates of the law `neighbours`."""


@lru_cache(maxsize=KEPT_OFFSETS)
def symmetry_offset_of(name: VehicleId) -> tuple[float, float]:
    """Two numbers within the unit circle, always the same for the same id.

    A symmetric start is a saddle and would not change; these offsets break the symmetry.
    """
    digest = blake2b(name.encode(), digest_size=8).digest()
    size = sqrt(int.from_bytes(digest[:4], "big") / 2**32)
    angle_rad = 2.0 * pi * int.from_bytes(digest[4:], "big") / 2**32
    return size * cos(angle_rad), size * sin(angle_rad)


def symmetry_offsets(direction: Array, ids: Sequence[VehicleId], rows: NDArray[np.intp]) -> Array:
    """Each vehicle's small offset, no longer than 1 and at right angles to its direction.

    Sideways and up or down as seen from the centre, so that it turns with the formation about the vertical.

    Args:
        direction: (n, 3) unit vectors from the centre.
        ids: of the fleet.
        rows: (n,) rows of the fleet in `direction`.

    Returns: (n, 3).
    """
    level = np.hypot(direction[:, 0], direction[:, 1])[:, None]
    sideways = np.column_stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))])
    sideways = np.where(level > TINY, sideways / np.maximum(level, TINY), (0.0, 1.0, 0.0))
    along = np.array([symmetry_offset_of(ids[row]) for row in rows.tolist()]).reshape(-1, 2)
    pushed: Array = along[:, :1] * sideways + along[:, 1:] * np.cross(direction, sideways)
    return pushed


def begun(direction: Array, ids: Sequence[VehicleId], rows: NDArray[np.intp], settings: LawSettings) -> Array:
    """(n, 3) the first slots of joining vehicles: their own directions plus their symmetry offsets."""
    place: Array = direction + settings.symmetry_rad * symmetry_offsets(direction, ids, rows)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    return place


def desired_center_velocity(
    center: Center,
    plan: Plan,
    time_s: float,
    settings: LawSettings,
    *,
    reach_m: float,
    pace: float,
    height_m: float,
) -> Array:
    """(3,) velocity that takes the centre to its orbit round the target, and to its height.

    Args:
        center: its present state.
        plan: target and orbit.
        time_s: time of the target's position.
        settings: speeds and rates.
        reach_m: the target is followed no farther than this from the show's origin (`gcs.formation.orbit`).
        pace: share of the orbit's speed that the vehicles can keep up with.
        height_m: at which it is to be.

    Source: article, section 3; the target's velocity is added (the printed law is relative to it), and the
        sum kept within the ground speed limit by shrinking the relative part.
    """
    target_m, target_velocity = followed_target(
        np.array(plan.target.position_m(time_s)), np.array(plan.target.velocity_m_s), reach_m
    )
    relative = orbit_velocity(
        center.position_m[:2] - target_m,
        radius_m=plan.orbit.radius_m,
        speed_m_s=plan.orbit.speed_m_s,
        direction=plan.orbit.direction,
        braking_m_s2=settings.center_acceleration_max_m_s2 / 2,
    )
    level_m_s = within_ground_speed(target_velocity, pace * relative, settings.center_speed_max_m_s)
    climb_m_s = settings.goal_rate_per_s * (-height_m - center.position_m[2])
    bounded_m_s = min(max(climb_m_s, -settings.climb_max_m_s), settings.climb_max_m_s)
    return np.array([level_m_s[0], level_m_s[1], bounded_m_s])


@kernel
def directions_from(position_m: Array, center_m: Array) -> tuple[Array, Array]:
    """(n, 3) unit vectors from the centre (3,) to the vehicles (n, 3), and (n,) their distances.

    A vehicle at the centre itself counts as straight above it.
    """
    direction, distance_m = np.empty_like(position_m), np.empty(len(position_m))
    for i in range(len(position_m)):
        square = 0.0
        for k in range(3):
            direction[i, k] = position_m[i, k] - center_m[k]
            square += direction[i, k] ** 2
        distance_m[i] = sqrt(square)
        if distance_m[i] > TINY:
            for k in range(3):
                direction[i, k] /= distance_m[i]
        else:
            direction[i, 0], direction[i, 1], direction[i, 2] = 0.0, 0.0, -1.0
    return direction, distance_m


@kernel
def slot_velocity(
    direction: Array,
    distance_m: Array,
    place: Array,
    radius_m: float,
    rate_per_s: float,
    speed_max_m_s: Array,
) -> Array:
    """Velocity of each vehicle towards its slot: along the sphere and onto it, at the same time.

    Along the sphere instead of straight, because straight paths lead through the sphere: they cross each
    other and pass through vehicles that have arrived.

    Args:
        direction: (n, 3) unit vectors from the centre.
        distance_m: (n,) from the centre.
        place: (n, 3) unit vectors to the slots.
        radius_m: of the sphere.
        rate_per_s: how fast a small error decays.
        speed_max_m_s: (n,) no row is faster.

    Returns: (n, 3) in m/s, relative to the centre.

    Source: article, section 2.1, divided by ``2 r r_d`` near the shell, so that the gain is a rate; 2.2.
    """
    velocity = np.empty_like(direction)
    for i in range(len(direction)):
        cosine = 0.0
        for k in range(3):
            cosine += direction[i, k] * place[i, k]
        square = 0.0
        for k in range(3):
            velocity[i, k] = place[i, k] - cosine * direction[i, k]
            square += velocity[i, k] ** 2
        sine = sqrt(square)
        along_m_s = rate_per_s * radius_m * np.arctan2(sine, cosine)
        inward_m_s = rate_per_s * (distance_m[i] ** 2 - radius_m**2) / (2.0 * radius_m)
        share = along_m_s / max(sine, TINY)
        square = 0.0
        for k in range(3):
            velocity[i, k] = share * velocity[i, k] - inward_m_s * direction[i, k]
            square += velocity[i, k] ** 2
        speed_m_s = sqrt(square)
        if speed_m_s > speed_max_m_s[i]:
            for k in range(3):
                velocity[i, k] *= speed_max_m_s[i] / speed_m_s
    return velocity


def goal_velocity(
    position_m: Array,
    goal_m: Array,
    *,
    settings: LawSettings,
    limits_m_s: tuple[float, float, float],
    speed_max_m_s: Array | float = np.inf,
) -> Array:
    """Straight to the goal, (n, 3) each: proportional near it, far from it as fast as the limits allow.

    Up and down the vehicle's own limits count, and the law's speed sideways only: as for a planned path, and
    in the times to which flights are compared. A bound of the speed alone is below both on a slope.

    Args:
        position_m: (n, 3), show frame.
        goal_m: (n, 3), show frame.
        settings: the law's speed, and the rate near the goal.
        limits_m_s: sideways, of climbing, of descending.
        speed_max_m_s: (n,) limits each vehicle besides, in any direction.
    """
    fastest_m_s = np.full(len(position_m), speed_max_m_s) if np.ndim(speed_max_m_s) == 0 else speed_max_m_s
    level_m_s, up_m_s, down_m_s = limits_m_s
    limits_m_s = min(settings.speed_m_s, level_m_s), up_m_s, down_m_s
    return _straight(
        np.array(position_m), np.array(goal_m), settings.goal_rate_per_s, limits_m_s, np.array(fastest_m_s)
    )


@kernel
def _straight(
    position_m: Array,
    goal_m: Array,
    rate_per_s: float,
    limits_m_s: tuple[float, float, float],
    own_m_s: Array,
) -> Array:
    """As `goal_velocity`, with each vehicle's own limit (n,)."""
    level_m_s, up_m_s, down_m_s = limits_m_s
    velocity_m_s = np.empty_like(position_m)
    for i in range(len(position_m)):
        for axis in range(3):
            velocity_m_s[i, axis] = rate_per_s * (goal_m[i, axis] - position_m[i, axis])
        x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        share = min(1.0, own_m_s[i] / max(sqrt(x * x + y * y + z * z), TINY))
        share = min(share, level_m_s / max(sqrt(x * x + y * y), TINY))
        share = min(share, (up_m_s if z < 0.0 else down_m_s) / max(abs(z), TINY))
        for axis in range(3):
            velocity_m_s[i, axis] *= share
    return velocity_m_s


def turned(vectors: Array, angle_rad: float) -> Array:
    """(n, 3) vectors of the show frame, turned about the vertical: clockwise from above (x towards y)."""
    c, s = cos(angle_rad), sin(angle_rad)
    x, y, z = vectors.T
    return np.column_stack([c * x - s * y, s * x + c * y, z])


def ramped_spin(
    spin_rad_s: float, desired_rad_s: float, radius_m: float, dt_s: float, most_m_s2: float
) -> float:
    """The spin after `dt_s`: towards the desired one, no faster than `most_m_s2` along the equator.

    Without the limit a reversed spin throws vehicles off the sphere.
    """
    change_rad_s = most_m_s2 / radius_m * dt_s
    return spin_rad_s + min(max(desired_rad_s - spin_rad_s, -change_rad_s), change_rad_s)


def spin_velocity(offset_m: Array, rate_rad_s: float, lead_s: float) -> Array:
    """(n, 3) velocities in m/s of points at (n, 3) from the centre that rotate with it.

    Args:
        offset_m: from the centre, show frame.
        rate_rad_s: positive is clockwise from above.
        lead_s: lead of the rotation: vehicles respond late, and one that turns late drifts outwards.
    """
    ahead_m = turned(offset_m, rate_rad_s * lead_s)
    return np.column_stack([-rate_rad_s * ahead_m[:, 1], rate_rad_s * ahead_m[:, 0], np.zeros(len(ahead_m))])


OVERHEAD_M = 2.0
"""Closer to the target than this, horizontally, its bearing means nothing: yaw is kept."""


def desired_yaw_rad(yaw: Yaw, held_rad: Array, position_m: Array, target_m: Array) -> Array:
    """The yaw each vehicle should have.

    Args:
        yaw: the policy.
        held_rad: (n,) yaw at engagement, or the last commanded.
        position_m: (n, 3), show frame.
        target_m: (2,), show frame.

    Returns: (n,) from the show's x axis towards y, within [-pi, pi).
    """
    if yaw.policy is YawPolicy.FIXED:
        return wrap_rad(np.full(len(position_m), yaw.fixed_rad))
    if yaw.policy is YawPolicy.HELD:
        return wrap_rad(held_rad)
    offset_m = target_m - position_m[:, :2]
    facing_rad = np.arctan2(offset_m[:, 1], offset_m[:, 0])
    overhead = np.hypot(offset_m[:, 0], offset_m[:, 1]) < OVERHEAD_M
    return wrap_rad(np.where(overhead, held_rad, facing_rad))


@kernel
def begun_yaw(commanded: Mask, yaw_rad: Array, held_rad: Array, measured_rad: Array) -> tuple[Array, Array]:
    """Yaw at the start of this tick and at engagement, of the commanded vehicles.

    Args:
        commanded: (n,).
        yaw_rad: (n,) commanded by the previous tick, NaN where not commanded.
        held_rad: (n,) at engagement, NaN where not commanded.
        measured_rad: (n,).

    Returns: (n,) yaw so far and (n,) yaw at engagement; NaN where not commanded. A vehicle that was not
        commanded before starts from its measured yaw.
    """
    so_far_rad, engaged_rad = np.full(len(yaw_rad), np.nan), np.full(len(yaw_rad), np.nan)
    for i in range(len(yaw_rad)):
        if commanded[i]:
            fresh = not np.isfinite(yaw_rad[i])
            so_far_rad[i] = measured_rad[i] if fresh else yaw_rad[i]
            engaged_rad[i] = measured_rad[i] if fresh else held_rad[i]
    return so_far_rad, engaged_rad


@kernel
def turn_towards(yaw_rad: Array, desired_rad: Array, rate_max_rad_s: float, dt_s: float) -> Array:
    """Turn from `yaw_rad` (n,) to `desired_rad` (n,) the short way round, no faster than the rate."""
    turned_rad, most_rad = np.empty_like(yaw_rad), rate_max_rad_s * dt_s
    for i in range(len(yaw_rad)):
        step_rad = (desired_rad[i] - yaw_rad[i] + np.pi) % (2.0 * np.pi) - np.pi
        later_rad = yaw_rad[i] + min(max(step_rad, -most_rad), most_rad)
        turned_rad[i] = (later_rad + np.pi) % (2.0 * np.pi) - np.pi
    return turned_rad
