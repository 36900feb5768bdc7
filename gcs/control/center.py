"""The formation's centre and radius: created with the first vehicle, moved, removed after the last."""

from dataclasses import dataclass
from functools import partial
from math import hypot
from typing import Final

import numpy as np

from gcs.control.center_within import within_areas
from gcs.control.detour import follow_detour
from gcs.control.inputs import FormationState, Task, TickInputs
from gcs.control.memory import Detour, Memory
from gcs.control.scene import Scene
from gcs.formation.following import (
    BESIDE_TRAFFIC,
    BRAKING_SHARE,
    CenterLimits,
    closing_velocity,
    fleet_limits,
    following_velocity,
)
from gcs.formation.law import desired_center_velocity
from gcs.formation.obstacles import Outlines
from gcs.formation.orbit import (
    CLEAR_OF_FENCE_M,
    SIDE_KEPT,
    Center,
    advance_center,
    followed_target,
    held_within,
    kept_sides,
    orbit_velocity,
    target_reach_m,
)
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.constraints import nearest
from gcs.safety.near_traffic import Evading, track_constraints

STANDS_M_S: Final = 0.1
"""A centre slower than this stands."""


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """What the formation follows from this tick on."""

    center: Center | None  # None: no vehicle is in formation or expected back
    radius_m: float
    engaged_time_s: Array  # (n,) when each vehicle joined, NaN outside the formation
    sides: dict[str, float]  # the side on which each obstacle is passed, LEFT or RIGHT, by obstacle id
    detour: Detour | None  # the way round obstacles, None without any

    @property
    def stands(self) -> bool:
        """Whether there is a centre, and it stands: its slots do too; what lies beyond is not in the way."""
        return self.center is not None and hypot(*self.center.velocity_m_s[:2]) <= STANDS_M_S

    @property
    def is_stuck(self) -> bool:
        """Whether the centre stands because no way leads anywhere: each vehicle then finds its own."""
        return self.stands and self.detour is not None and self.detour.active and not self.detour.reaches


def move_center(now: TickInputs, memory: Memory, shared: FormationState | None = None) -> Lead:
    """Create, move or remove the formation's centre and radius, and update the joining times.

    Where another station leads, centre and radius are those of `shared`.
    """
    engaged_s = _engaged(now.formed, memory.engaged_time_s, now.fleet.time_s)
    if shared is not None:
        return Lead(shared.center, shared.radius_m, engaged_s, shared.sides, None)
    if len(now.sphere) == 0:
        return _without_drones(now, memory, engaged_s)
    center, radius_m = memory.center, memory.radius_m
    if center is None:
        center, radius_m = _begun(now), now.plan.formation.radius_m
    ahead = center.later(now.dt_s)  # at the step's end
    sphere_m = max(radius_m, now.plan.formation.radius_m)
    limits = _limits(now, center, radius_m)
    desired_m_s, sides, detour = _around_obstacles(now, center, ahead, radius_m, memory, limits)
    desired_m_s, limits = _out_of_traffic(now, ahead, sphere_m, desired_m_s, limits)
    if not now.settings.safety.fence.is_plain:
        desired_m_s = within_areas(now, ahead, sphere_m, desired_m_s, limits)
    held_m_s = _inside_fence(now, ahead, sphere_m, desired_m_s, limits)
    moved = advance_center(center, held_m_s, now.dt_s, limits.acceleration_m_s2)
    change_m = now.settings.radius_rate_m_s * now.dt_s
    wider_m = min(max(now.plan.formation.radius_m - radius_m, -change_m), change_m)
    return Lead(moved, radius_m + wider_m, engaged_s, sides, detour)


def _limits(now: TickInputs, center: Center, radius_m: float) -> CenterLimits:
    """Limits of the centre: those of the law, or of what the vehicles can while a target is followed.

    Among obstacles those of the law count: ways past them are planned with these. A centre that is faster
    when one becomes known brakes with what the vehicles can.
    """
    law = now.settings.law
    limits = CenterLimits(law.center_speed_max_m_s, law.center_acceleration_max_m_s2)
    follows = now.plan.target.followed and not now.ellipses
    too_fast = hypot(*center.velocity_m_s[:2]) > law.center_speed_max_m_s + STANDS_M_S
    if not follows and not too_fast:
        return limits
    x_m, y_m = now.plan.target.position_m(now.fleet.time_s)
    behind_m = hypot(x_m - center.position_m[0], y_m - center.position_m[1])
    fleet = _fleet_limits(now, radius_m, 0.0 if now.plan.orbit.radius_m else behind_m)
    hardest_m_s2 = max(limits.acceleration_m_s2, fleet.acceleration_m_s2)
    return CenterLimits(max(limits.speed_m_s, fleet.speed_m_s) if follows else limits.speed_m_s, hardest_m_s2)


def _fleet_limits(now: TickInputs, radius_m: float, behind_m: float = 0.0) -> CenterLimits:
    """What the whole sphere can, so far from its target."""
    fastest_m_s = np.minimum(now.settings.safety.limits.horizontal_m_s, now.traits.speed_max_m_s)
    rim_m_s = abs(now.plan.formation.spin_rad_s) * radius_m
    hardest_m_s2 = now.acceleration_max_m_s2[now.sphere]
    return fleet_limits(fastest_m_s[now.sphere], hardest_m_s2, rim_m_s, behind_m=behind_m)


def _out_of_traffic(
    now: TickInputs, ahead: Center, sphere_m: float, desired_m_s: Array, limits: CenterLimits
) -> tuple[Array, CenterLimits]:
    """The velocity (3,) that leads the whole sphere out of the corridors of tracks, and its limits."""
    if now.tasks.near_traffic is None:
        return desired_m_s, limits
    safety, fleet = now.settings.safety, _fleet_limits(now, sphere_m)
    speed_m_s = max(limits.speed_m_s, fleet.speed_m_s)
    evading = Evading(
        ahead.position_m[None],
        np.ones(1, np.bool_),
        ahead.velocity_m_s[None],  # a side that was begun is kept
        np.array([sphere_m + now.settings.law.avoidance.near_m]),
        np.array([speed_m_s]),
        safety.braking.of_each(1),
        safety.fence.distance_max_m - sphere_m,
    )
    rows = track_constraints(evading, now.tasks.near_traffic)
    led_m_s = nearest(desired_m_s[None].copy(), rows.first, rows.second, rows.normal, rows.bound_m_s)[0]
    if np.abs(led_m_s - desired_m_s).max() <= STANDS_M_S:
        return led_m_s, limits
    led_m_s[:2] *= min(1.0, speed_m_s / max(hypot(*led_m_s[:2]), STANDS_M_S))
    return led_m_s, CenterLimits(speed_m_s, max(limits.acceleration_m_s2, fleet.acceleration_m_s2))


@kernel
def _engaged(formed: Mask, before_s: Array, time_s: float) -> Array:
    """(n,) time when each vehicle joined the formation: `before_s`, or `time_s` for those that join now."""
    engaged_s = np.full(len(formed), np.nan)
    for i in range(len(formed)):
        if formed[i]:
            engaged_s[i] = before_s[i] if np.isfinite(before_s[i]) else time_s
    return engaged_s


def _without_drones(now: TickInputs, memory: Memory, engaged_s: Array) -> Lead:
    """Stop the centre while vehicles are expected back: a tick without telemetry does not end a formation."""
    if memory.center is None:
        return Lead(None, memory.radius_m, engaged_s, {}, None)
    in_formation = (now.tasks.task == Task.FORMATION) | (now.tasks.task == Task.ELSEWHERE)
    if not (now.tasks.formation_waits or in_formation.any()):
        return Lead(None, memory.radius_m, engaged_s, {}, None)
    acceleration_m_s2 = now.settings.law.center_acceleration_max_m_s2
    stopped = advance_center(memory.center, np.zeros(3), now.dt_s, acceleration_m_s2)
    return Lead(stopped, memory.radius_m, memory.engaged_time_s, memory.sides, memory.detour)


def _begun(now: TickInputs) -> Center:
    """A centre at rest at the vehicles' mean position, at the plan's height."""
    above_m = now.position_m[now.sphere].mean(axis=0)
    return Center.at_rest(np.array([above_m[0], above_m[1], -now.plan.formation.height_m]))


def _around_obstacles(
    now: TickInputs, center: Center, ahead: Center, radius_m: float, memory: Memory, limits: CenterLimits
) -> tuple[Array, dict[str, float], Detour | None]:
    """The velocity (3,) for target, orbit and height, led around the obstacles; sides taken; the detour."""
    fleet, plan, law, moves = now.fleet, now.plan, now.settings.law, now.tasks.center_moves
    fence_m, sphere_m = now.settings.safety.fence.distance_max_m, max(radius_m, plan.formation.radius_m)
    reach_m = target_reach_m(fence_m, plan.orbit.radius_m, sphere_m)
    pace = min(memory.pace, now.pace)
    desired_m_s = desired_center_velocity(
        ahead,
        plan,
        fleet.time_s + now.dt_s,
        law,
        reach_m=reach_m,
        pace=pace,
        height_m=now.center_height_m(sphere_m),
    )
    if plan.target.followed and not now.ellipses:
        desired_m_s[:2] = _following(now, ahead, reach_m, pace, limits)
    if not moves:
        desired_m_s[:2] = 0.0
    if not now.ellipses:
        return desired_m_s, {}, None
    scene = Scene(now, center, sphere_m, reach_m, Outlines.of(now.ellipses))
    led_m_s, detour = follow_detour(scene, desired_m_s, memory.detour)
    drones_m = now.position_m[now.sphere]  # those that were left behind pass on the side that suits them
    behind_m = np.linalg.norm(drones_m - center.position_m, axis=1) - sphere_m
    sides = kept_sides(
        scene.outlines,
        center.position_m,
        led_m_s,
        drones_m[behind_m < law.avoidance.lookahead_m],
        memory.sides,
        near_m=SIDE_KEPT * law.avoidance.lookahead_m,
        tall=-center.position_m[2] - sphere_m < scene.outlines.top_height_m,
    )
    return led_m_s, sides, detour


def _following(now: TickInputs, ahead: Center, reach_m: float, pace: float, limits: CenterLimits) -> Array:
    """(2,) the velocity that follows a target, or circles it, as fast as `limits` allow."""
    target, orbit, then_s = now.plan.target, now.plan.orbit, now.fleet.time_s
    target_m_s2 = np.array([target.acceleration_x_m_s2, target.acceleration_y_m_s2])
    asked_m = np.array(target.position_m(then_s))
    target_m, target_m_s = followed_target(asked_m, np.array(target.velocity_m_s), reach_m)
    if target_m is not asked_m:
        target_m_s2 = np.zeros(2)  # it is followed along the fence
    off_m = ahead.position_m[:2] - target_m
    if orbit.radius_m == 0.0:
        share = BRAKING_SHARE if now.tasks.near_traffic is None else BESIDE_TRAFFIC
        relative_m_s = closing_velocity(-off_m, share * limits.acceleration_m_s2, target.deviation_m_s)
    else:
        field = partial(
            orbit_velocity,
            radius_m=orbit.radius_m,
            speed_m_s=pace * orbit.speed_m_s,
            direction=orbit.direction,
            braking_m_s2=limits.acceleration_m_s2 / 2,
        )
        relative_m_s = field(off_m)
        target_m_s2 = target_m_s2 + (field(off_m + now.dt_s * relative_m_s) - relative_m_s) / now.dt_s
    return following_velocity(
        ahead.velocity_m_s[:2],
        ahead.acceleration_m_s2[:2],
        target_m_s,
        target_m_s2,
        relative_m_s,
        limits,
        deviation_m_s=target.deviation_m_s,
        dt_s=now.dt_s,
    )


def _inside_fence(
    now: TickInputs, ahead: Center, sphere_m: float, desired_m_s: Array, limits: CenterLimits
) -> Array:
    """The part of the velocity (3,) with which the whole sphere can still stop inside the fence."""
    reach_m = now.settings.safety.fence.distance_max_m - sphere_m
    level_m_s = held_within(
        desired_m_s[:2],
        ahead.position_m[:2],
        reach_m - CLEAR_OF_FENCE_M / 2,  # the orbit itself ends farther inside
        limits.acceleration_m_s2 / 2,
    )
    return np.array([level_m_s[0], level_m_s[1], desired_m_s[2]])
