"""The flown law: the sum of centre motion, sphere, spreading, symmetry breaking and avoidance.

Gains are rates (1/s), independent of N and R. The article's terms are in `sphere`, `repulsion`, `orbit` and
`obstacles`; what is fed back and forward here follows FACTS, section 1.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from gcs.formation.obstacles import AvoidanceSettings, Ellipse, avoid, choose_side, heads_into
from gcs.formation.orbit import Center, followed_target, orbit_velocity, within_ground_speed
from gcs.formation.repulsion import spreading_velocity
from gcs.formation.sphere import TINY, sphere_velocity
from gcs.plan import Plan
from gcs.settings import NotNegative, Positive, Settings
from gcs.state import Array


class LawSettings(Settings):
    """Rates and bounds of the law; docs/architecture.md says how they were found."""

    speed_m_s: Positive = 4.0  # bound of each term that draws a drone to its place
    sphere_rate_per_s: Positive = 0.8
    spreading_rate_per_s: Positive = 0.8
    spreading_steps: Annotated[int, Field(ge=1, le=100)] = 20
    centroid_rate_per_s: Positive = 0.8
    centroid_speed_max_m_s: Positive = 1.0
    goal_rate_per_s: Positive = 0.8
    center_speed_max_m_s: Positive = 4.0  # over the ground
    center_acceleration_max_m_s2: Positive = 1.0
    climb_max_m_s: Positive = 1.0  # of the centre, up and down
    symmetry_speed_m_s: NotNegative = 0.3  # of the kick that breaks symmetry
    symmetry_decay_s: Positive = 4.0
    avoidance: AvoidanceSettings = AvoidanceSettings()


def kick_directions(seeds: Array) -> Array:
    """One unit vector for each seed, (n,) to (n, 3): the same for the same drone every time.

    A symmetric start sits on a saddle and stays there; these, decaying, push it off.
    """
    return np.array(
        [vector / np.linalg.norm(vector) for vector in (_normal3(int(seed)) for seed in seeds)]
    ).reshape(-1, 3)


def _normal3(seed: int) -> Array:
    return np.random.default_rng(seed).normal(size=3)


def wanted_center_velocity(
    center: Center, plan: Plan, time_s: float, settings: LawSettings, *, reach_m: float
) -> Array:
    """(3,) velocity that takes the centre to its orbit round the target, and to its height.

    Args:
        center: where it is.
        plan: target, orbit and height.
        time_s: for which the target is reckoned.
        settings: speeds and rates.
        reach_m: the target is followed no farther than this from the show's origin (`gcs.formation.orbit`).

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
    climb_m_s = settings.goal_rate_per_s * (-plan.formation.height_m - center.position_m[2])
    return np.append(
        within_ground_speed(target_velocity, relative, settings.center_speed_max_m_s),
        np.clip(climb_m_s, -settings.climb_max_m_s, settings.climb_max_m_s),
    )


def update_sides(
    sides: dict[str, float],
    ellipses: dict[str, Ellipse],
    position_m: Array,
    center: Center,
    wanted_center_m_s: Array,
    settings: LawSettings,
) -> dict[str, float]:
    """Which obstacle is passed on which side: chosen once for the whole formation, then kept.

    A side is chosen when the first of the drones (n, 3) or the centre comes near and moves towards the
    obstacle, and forgotten when none of them is near any more.
    """
    everyone_m = np.vstack([position_m, center.position_m])
    motion_m_s = np.broadcast_to(wanted_center_m_s, everyone_m.shape)
    kept: dict[str, float] = {}
    for name, ellipse in ellipses.items():
        near = ellipse.distance_m(everyone_m) < settings.avoidance.lookahead_m * 1.5
        if not near.any():
            continue
        if name in sides:
            kept[name] = sides[name]
        elif (near & heads_into(ellipse, everyone_m, motion_m_s)).any():
            kept[name] = choose_side(ellipse, center.position_m, wanted_center_m_s)
    return kept


def avoid_all(
    position_m: Array,
    velocity_m_s: Array,
    ellipses: dict[str, Ellipse],
    sides: dict[str, float],
    sliding_m_s: Array,
    settings: LawSettings,
) -> Array:
    """Avoid every obstacle in turn, the nearest last so that it has the last word; (n, 3) in and out.

    Obstacles without an entry in `sides` are passed on whichever side costs less. Those to which everybody
    keeps the distance from which `avoid` begins are passed over: it would return what it is given.
    """
    reach_m = max(settings.avoidance.lookahead_m, settings.avoidance.near_m)
    nearest_m = {
        name: float(ellipse.distance_m(position_m).min(initial=np.inf)) for name, ellipse in ellipses.items()
    }
    concerned = [name for name, distance_m in nearest_m.items() if distance_m < reach_m]
    for name in sorted(concerned, key=lambda name: -nearest_m[name]):
        velocity_m_s = avoid(
            position_m,
            velocity_m_s,
            ellipses[name],
            settings.avoidance,
            side=np.full(len(position_m), sides.get(name, 0.0)),
            sliding_m_s=sliding_m_s,
        )
    return velocity_m_s


def formation_velocity(
    position_m: Array,
    charge: Array,
    kick: Array,
    engaged_s: Array,
    center: Center,
    *,
    radius_m: float,
    settings: LawSettings,
) -> Array:
    """Where the drones of the formation should go, before obstacles and safety.

    Args:
        position_m: (n, 3), show frame.
        charge: (n,) each drone's share of the sphere, 1 for equal ones.
        kick: (n, 3) unit vectors from `kick_directions`.
        engaged_s: (n,) seconds since each drone joined; its kick decays with them.
        center: its velocity is fed forward to every drone, and the true centroid's error fed back.
        radius_m: of the sphere now.
        settings: rates and bounds.

    Returns: (n, 3) in m/s.
    Source: article, sections 2 and 3, as corrected in FACTS, section 1.
    """
    velocity = sphere_velocity(
        position_m,
        center.position_m,
        radius_m=radius_m,
        rate_per_s=settings.sphere_rate_per_s,
        speed_max_m_s=settings.speed_m_s,
    )
    velocity = velocity + spreading_velocity(
        position_m,
        center.position_m,
        charge,
        radius_m=radius_m,
        rate_per_s=settings.spreading_rate_per_s,
        speed_max_m_s=settings.speed_m_s,
        steps=settings.spreading_steps,
    )
    decay = np.exp(-engaged_s / settings.symmetry_decay_s)[:, None]
    velocity = velocity + settings.symmetry_speed_m_s * decay * kick
    if len(position_m) >= 2:  # one drone alone is never at the centre
        error_m = center.position_m - position_m.mean(axis=0)
        pull_m_s = settings.centroid_rate_per_s * error_m
        size_m_s = float(np.linalg.norm(pull_m_s))
        velocity = velocity + pull_m_s * min(1.0, settings.centroid_speed_max_m_s / max(size_m_s, TINY))
    return velocity + center.velocity_m_s


def goal_velocity(position_m: Array, goal_m: Array, *, settings: LawSettings) -> Array:
    """Straight to the goal, (n, 3) each: proportional near it, at the law's speed from afar."""
    wanted_m_s = settings.goal_rate_per_s * (goal_m - position_m)
    size_m_s = np.linalg.norm(wanted_m_s, axis=1, keepdims=True)
    velocity: Array = wanted_m_s * np.minimum(1.0, settings.speed_m_s / np.maximum(size_m_s, TINY))
    return velocity
