"""Whether a change of the plan is feasible for the fleet now. Pure; refusals name a feasible value."""

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, floor, hypot, isfinite
from typing import Literal

import numpy as np

from gcs.control import ControlSettings
from gcs.formation.following import SPEED_SHARE
from gcs.formation.law import LawSettings
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.formation.orbit import CLEAR_OF_FENCE_M, followed_target, target_reach_m
from gcs.formation.repulsion import smallest_radius_m
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target
from gcs.model.state import Array, VehicleId
from gcs.planning.area_room import Space, area_name, ground_lack_m, lacking_m, space_of
from gcs.safety.constraints import Braking
from gcs.safety.surroundings import SafetySettings
from gcs.safety.target_clearance import clear_height_m, kept_clear_m
from gcs.safety.walls import Fence, obstacle_constraints

NEARLY_M = 1e-9
"""Tolerance for rounding errors."""


def _up(value: float) -> float:
    """Round up to a tenth: a limit in a refusal must itself be accepted."""
    tenths = value * 10.0 - NEARLY_M
    return ceil(tenths) / 10.0 if isfinite(tenths) else value


def _down(value: float) -> float:
    """Round down to a tenth."""
    tenths = value * 10.0 + NEARLY_M
    return floor(tenths) / 10.0 if isfinite(tenths) else value


def smallest_formation_radius_m(
    count: int, safety: SafetySettings, uncertainty_m: Array | None = None
) -> float:
    """Smallest radius that keeps separation and margin for `count`, rounded up to a tenth of a metre.

    Args:
        count: number of vehicles.
        safety: the floor and its margins.
        uncertainty_m: (n,) standard deviations of the fleet's positions; None: as configured.
    """
    return _up(smallest_radius_m(count, safety.floor.widest_m(uncertainty_m)))


def radius_allowed(count: int, safety: SafetySettings, uncertainty_m: Array | None = None) -> str:
    """The smallest radius in words; arguments as of `smallest_formation_radius_m`."""
    smallest_m = smallest_formation_radius_m(count, safety, uncertainty_m)
    text = (
        f"at least {smallest_m:.1f} m for {count} vehicles {safety.floor.widest_m(uncertainty_m):.1f} m apart"
    )
    if uncertainty_m is None or not len(uncertainty_m):
        return text
    worst_m, usual_m = float(uncertainty_m.max()), safety.floor.uncertainty_m
    if worst_m <= usual_m:
        return text
    usual_radius_m = smallest_formation_radius_m(count, safety)
    return (
        f"{text}, because the position of at least one is uncertain by {worst_m:.2f} m (1 sigma);"
        f" {usual_radius_m:.1f} m is enough at {usual_m:g} m, as with RTK"
    )


def check_formation(
    formation: Formation, count: int, safety: SafetySettings, uncertainty_m: Array | None = None
) -> None:
    """Check the sphere's size and height.

    Args:
        formation: to be flown.
        count: number of vehicles.
        safety: floor, margins and heights.
        uncertainty_m: (n,) standard deviations of the fleet's positions; None: as configured.

    Raises: InvalidError if too small for `count` vehicles that uncertain, or out of height.
    """
    if formation.radius_m < smallest_formation_radius_m(count, safety, uncertainty_m):
        raise InvalidError("radius_m", formation.radius_m, radius_allowed(count, safety, uncertainty_m))
    lowest_m, highest_m = safety.fence.height_min_m, safety.fence.height_max_m
    if formation.height_m < lowest_m + formation.radius_m - NEARLY_M:
        raise InvalidError(
            "height_m",
            formation.height_m,
            f"at least {_up(lowest_m + formation.radius_m):.1f} m, so that a sphere"
            f" of {formation.radius_m:g} m stays above the least height of {lowest_m:g} m",
        )
    if formation.height_m > highest_m - formation.radius_m + NEARLY_M:
        raise InvalidError(
            "height_m",
            formation.height_m,
            f"at most {_down(highest_m - formation.radius_m):.1f} m, so that a sphere"
            f" of {formation.radius_m:g} m stays below the greatest height of {highest_m:g} m",
        )


def check_radius(
    radius_m: float, height_m: float, target: Target, orbit: Orbit, safety: SafetySettings
) -> None:
    """Check whether a sphere may grow to a radius at its present place, if only its radius changes.

    Raises: InvalidError with the greatest feasible radius there.
    """
    fence = safety.fence
    away_m = hypot(target.x_m, target.y_m)
    most_m = min(
        height_m - fence.height_min_m,
        fence.height_max_m - height_m,
        fence.distance_max_m - away_m - orbit.radius_m - CLEAR_OF_FENCE_M,
    )
    areas = ""
    if fence.areas:
        formation = Formation(radius_m=radius_m, height_m=height_m)
        space = space_of((target.x_m, target.y_m), orbit, formation)
        lack_m = float(lacking_m(fence.areas, space, CLEAR_OF_FENCE_M).lack_m[0])
        most_m, areas = min(most_m, radius_m - lack_m), " and its areas"
    if radius_m > most_m + NEARLY_M:
        raise InvalidError(
            "radius_m",
            radius_m,
            f"at most {_down(max(most_m, 0.0)):.1f} m at a height of {height_m:g} m, so that orbit and sphere"
            f" stay inside the fence ({fence.height_min_m:g} to {fence.height_max_m:g} m high,"
            f" {fence.distance_max_m:g} m from the origin){areas}",
        )


def check_orbit(orbit: Orbit, law: LawSettings) -> None:
    """Check the centre's circle. Raises: InvalidError if it exceeds the limits of the centre."""
    if orbit.speed_m_s > law.center_speed_max_m_s:
        raise InvalidError(
            "speed_m_s", orbit.speed_m_s, f"at most the centre's {law.center_speed_max_m_s:g} m/s"
        )
    tightest_m = orbit.speed_m_s**2 / law.center_acceleration_max_m_s2
    if 0.0 < orbit.radius_m < tightest_m - NEARLY_M:
        raise InvalidError(
            "radius_m",
            orbit.radius_m,
            f"0, or at least {_up(tightest_m):.1f} m at {orbit.speed_m_s:g} m/s,"
            f" so that the centre turns with no more than {law.center_acceleration_max_m_s2:g} m/s^2",
        )


def check_target(
    target: Target,
    orbit: Orbit,
    formation: Formation,
    control: ControlSettings,
    *,
    changed: Literal["target", "orbit", "formation"] = "target",
    instead_of: tuple[Orbit, Formation] | None = None,
) -> None:
    """Check that the target can be followed on that orbit with that sphere, from where it is.

    Args:
        target: at its `x_m` and `y_m`: see `followed` for one that moves.
        orbit: around the target.
        formation: that flies it.
        control: speeds, and the fence.
        changed: what the caller changes, which the refusal names.
        instead_of: what was accepted before: what the areas of the fence lack for it is no reason to refuse.

    Raises: InvalidError when the target is too fast, or the fence leaves no room round it.
    """
    law, safety = control.law, control.safety
    fastest_m_s = law.center_speed_max_m_s
    if target.followed:
        fastest_m_s = max(fastest_m_s, SPEED_SHARE * safety.limits.horizontal_m_s)
    if changed == "target" and target.speed_m_s > fastest_m_s:
        raise InvalidError("velocity", f"{target.speed_m_s:.2f} m/s", f"at most {fastest_m_s:g} m/s")
    too_low_m = without_room_m(target, orbit, formation, safety) if changed == "target" else 0.0
    if too_low_m > NEARLY_M:
        least_m = _up(safety.fence.height_max_m + too_low_m)
        allowed = f"less, or `fence.height_max_m` of {least_m:.1f} m, so that the sphere stays clear of it"
        raise InvalidError("clearance_m", target.clearance_m, allowed)
    _check_areas(target, orbit, formation, safety, changed, instead_of)
    fence_m, away_m = safety.fence.distance_max_m, hypot(target.x_m, target.y_m)
    if orbit.radius_m + formation.radius_m + away_m + CLEAR_OF_FENCE_M <= fence_m + NEARLY_M:
        return
    inside = f"so that orbit and sphere stay inside the fence at {fence_m:g} m"
    if changed == "target":
        place = f"({target.x_m:g}, {target.y_m:g}) m"
        reach_m = target_reach_m(fence_m, orbit.radius_m, formation.radius_m)
        raise InvalidError("position", place, f"within {_down(reach_m):.1f} m of the origin, {inside}")
    radius_m, other_m = (
        (orbit.radius_m, formation.radius_m) if changed == "orbit" else (formation.radius_m, orbit.radius_m)
    )
    most_m = max(0.0, fence_m - other_m - away_m - CLEAR_OF_FENCE_M)
    from_origin = f"round a target {away_m:.1f} m from the origin"
    raise InvalidError("radius_m", radius_m, f"at most {_down(most_m):.1f} m {from_origin}, {inside}")


def _check_areas(
    target: Target,
    orbit: Orbit,
    formation: Formation,
    safety: SafetySettings,
    changed: Literal["target", "orbit", "formation"],
    instead_of: tuple[Orbit, Formation] | None,
) -> None:
    """Check that orbit and sphere have room among the areas of the fence. Raises: InvalidError."""
    at_m = target.x_m, target.y_m
    lack_m, area = _lack(space_of(at_m, orbit, formation), safety, _speed_m_s(target, orbit))
    before_m = 0.0
    if instead_of is not None:
        before_m, _ = _lack(space_of(at_m, *instead_of), safety, _speed_m_s(target, instead_of[0]))
    if lack_m <= max(before_m, 0.0) + NEARLY_M:
        return
    place, lacks = f"({target.x_m:g}, {target.y_m:g}) m", f"{_up(lack_m):.1f} m are missing to {area}"
    if changed == "target":
        raise InvalidError("position", place, f"{lacks}: move it, or take a smaller orbit or sphere")
    radius_m = orbit.radius_m if changed == "orbit" else formation.radius_m
    most_m = _down(radius_m - lack_m)
    room = f"at most {most_m:.1f} m" if most_m > 0.0 else "less does not help, move the target first"
    raise InvalidError("radius_m", radius_m, f"{room}: round a target at {place} {lacks}")


def lack_around(
    place_m: tuple[float, float], orbit: Orbit, formation: Formation, safety: SafetySettings
) -> str:
    """What orbit and sphere lack of room round a target at a place, in words; empty: nothing."""
    if safety.fence.is_plain:
        return ""
    orbit_m_s = orbit.speed_m_s if orbit.radius_m > 0.0 else 0.0
    lack_m, area = _lack(space_of(place_m, orbit, formation), safety, orbit_m_s)
    return f"{ceil(lack_m)} m are missing to {area}" if lack_m > NEARLY_M else ""


def _speed_m_s(target: Target, orbit: Orbit) -> float:
    """How fast a formation moves as a whole."""
    return target.speed_m_s + (orbit.speed_m_s if orbit.radius_m > 0.0 else 0.0)


def _lack(space: Space, safety: SafetySettings, speed_m_s: float) -> tuple[float, str]:
    """How many metres a formation lacks in the fence, and to what; not above 0: none."""
    fence, lacks = safety.fence, [(-np.inf, "")]
    if fence.areas:
        lack = lacking_m(fence.areas, space, CLEAR_OF_FENCE_M)
        lacks.append((float(lack.lack_m[0]), area_name(fence.areas, int(lack.area[0]))))
    if fence.controlled_ground is not None:
        lack_m = ground_lack_m(fence.controlled_ground, space, safety.impact, speed_m_s)
        lacks.append((float(lack_m[0]), "the edge of the controlled ground, on which vehicles may fall"))
    return max(lacks)


def without_room_m(target: Target, orbit: Orbit, formation: Formation, safety: SafetySettings) -> float:
    """By how much the fence is too low for a sphere that keeps its target's clearance; 0: there is room."""
    if not target.clearance_m:
        return 0.0
    kept_m = kept_clear_m(target, safety.floor, np.array([safety.floor.uncertainty_m]))[:, 0]
    least_m = clear_height_m(target, orbit.radius_m, formation.radius_m, kept_m)
    return max(least_m + formation.radius_m - safety.fence.height_max_m, 0.0)


def check_clearance(name: str, target: Target, pads_m: Mapping[VehicleId, Array]) -> None:
    """Check that no pad is nearer to the target than its clearance. Raises: RefusedError naming vehicles.

    Args:
        name: of the target; empty: it has none.
        target: at its `x_m` and `y_m`.
        pads_m: (3,) where each vehicle stands.
    """
    near = [
        vehicle
        for vehicle, pad_m in pads_m.items()
        if hypot(pad_m[0] - target.x_m, pad_m[1] - target.y_m) < target.clearance_m
    ]
    if near:
        raise RefusedError(
            f"target {name or 'of the plan'} is nearer than its clearance of {target.clearance_m:g} m to the"
            f" {'pad' if len(near) == 1 else 'pads'} of {', '.join(near)}"
        )


def followed(plan: Plan, time_s: float, fence: Fence) -> Target:
    """The target as followed at `time_s`: at its position then, or the nearest that can be followed.

    A target beyond the fence is moved to its limit. So changes that keep the size of orbit and sphere, or
    reduce it, remain possible.
    """
    reach_m = target_reach_m(fence.distance_max_m, plan.orbit.radius_m, plan.formation.radius_m)
    place_m, velocity_m_s = followed_target(
        np.array(plan.target.position_m(time_s)), np.array(plan.target.velocity_m_s), reach_m
    )
    (x_m, y_m), (x_m_s, y_m_s) = place_m.tolist(), velocity_m_s.tolist()
    return replace(plan.target, x_m=x_m, y_m=y_m, velocity_x_m_s=x_m_s, velocity_y_m_s=y_m_s, time_s=time_s)


def check_obstacle(
    obstacle: Obstacle,
    avoidance: AvoidanceSettings,
    airborne_m: Mapping[VehicleId, Array],
    homes_m: Mapping[VehicleId, Array],
    *,
    velocities_m_s: Mapping[VehicleId, Array] | None = None,
    braking: Braking | None = None,
) -> None:
    """Check that an obstacle hits no airborne vehicle, no stopping distance, and no landing position.

    Args:
        obstacle: in the show frame, where it is now.
        avoidance: margins beside and above it.
        airborne_m: (3,) position of every vehicle in the air.
        homes_m: (3,) landing position of every vehicle that flies.
        velocities_m_s: (3,) of those in the air; without it they count as being at rest.
        braking: deceleration and reaction; without it stopping distances are not checked.

    Raises: RefusedError naming the vehicles.
    """
    margin_m, headroom_m = avoidance.margin_m, avoidance.headroom_m
    ellipse = Ellipse.around(obstacle, margin_m=margin_m, headroom_m=headroom_m)

    def near(places_m: Mapping[VehicleId, Array], clear_m: float, highest_m: float) -> list[VehicleId]:
        return [
            name
            for name, place_m in places_m.items()
            if np.isfinite(place_m).all()
            and ellipse.distance_m(place_m[None])[0] < clear_m
            and -place_m[2] < highest_m
        ]

    def could_not_stop(name: VehicleId) -> bool:
        velocity_m_s = (velocities_m_s or {}).get(name, np.zeros(3))
        place_m = airborne_m[name]
        if braking is None or not np.isfinite([*place_m, *velocity_m_s]).all():
            return False
        wall = {obstacle.id: ellipse}
        slack_m_s = obstacle_constraints(place_m[None], np.ones(1, bool), wall, braking).slack_m_s(
            velocity_m_s[None]
        )
        return bool((slack_m_s < 0.0).any())

    hit = near(airborne_m, 0.0, ellipse.top_height_m)
    if hit:
        raise RefusedError(
            f"obstacle {obstacle.id} would stand on {', '.join(hit)} (margin {margin_m:g} m, headroom"
            f" {headroom_m:g} m included); move it, or the formation, away first"
        )
    late = [name for name in airborne_m if could_not_stop(name)]
    if late:
        raise RefusedError(
            f"obstacle {obstacle.id} would be too close ahead of {', '.join(late)} to stop (margin"
            f" {margin_m:g} m included); move it farther away, or pause first"
        )
    blocked = near(homes_m, avoidance.near_m, np.inf)  # nearer, the ellipse would push vehicles away
    if blocked:
        raise RefusedError(
            f"obstacle {obstacle.id} would stand on the landing place of {', '.join(blocked)}, or too near"
            f" (margin {margin_m:g} m and {avoidance.near_m:g} m to land beside it included)"
        )
