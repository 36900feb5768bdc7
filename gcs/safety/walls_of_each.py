"""All constraints on single vehicles: lost paths, fence, ground, obstacles, targets, traffic, reach."""

from dataclasses import replace

import numpy as np

from gcs.model.state import Array, Mask
from gcs.safety.area_walls import area_constraints
from gcs.safety.authority import reach_constraints
from gcs.safety.constraints import Braking, Constraints
from gcs.safety.controlled_ground import ground_constraints
from gcs.safety.lost_paths import keepout_constraints
from gcs.safety.near_traffic import Evading, track_constraints
from gcs.safety.surroundings import SafetySettings, Surroundings
from gcs.safety.target_clearance import clearance_constraints
from gcs.safety.walls import fence_constraints, obstacle_constraints

SPARE_M_S = 0.5
"""Pairs are searched as if every velocity could change by this much."""


def walls_of_each(
    position_m: Array,
    desired_m_s: Array,
    here: Surroundings,
    settings: SafetySettings,
    braking: Braking,
    speed_m_s: Array | None,
    only: Mask | None = None,
) -> Constraints:
    """All constraints on single vehicles: paths of lost ones, fence, ground, obstacles, target, traffic.

    Areas and ground are left out where no velocity breaks them that is by `SPARE_M_S` faster than `speed_m_s`
    (n,); None: no limit of the vehicles is. With `only` (n,) there are areas and ground alone, of these rows.
    """
    course_m_s = None if speed_m_s is None else speed_m_s + SPARE_M_S
    if only is not None:
        confined = replace(here, commanded=here.commanded & only)
        return _site(position_m, confined, settings, braking, course_m_s)
    fastest_m_s = settings.limits.fastest_m_s
    fence = fence_constraints(
        position_m,
        here.commanded,
        here.descending if here.low is None else here.descending | here.low,
        settings.fence,
        braking,
        velocity_m_s=here.velocity_m_s,
        standoff_m=settings.floor.standoff_m(np.array(here.uncertainty_m)),
        response=here.response,
        fastest_m_s=fastest_m_s,
    )
    site = _site(position_m, here, settings, braking, course_m_s)
    clear_of_targets = (
        clearance_constraints(
            position_m,
            here.velocity_m_s,
            here.commanded,
            target,
            here.time_s + settings.link_delay_s,
            floor=settings.floor,
            braking=braking,
            uncertainty_m=here.uncertainty_m,
            response=here.response,
            fastest_m_s=fastest_m_s,
        )
        for target in here.targets
        if target.clearance_m
    )
    walls = Constraints.joined(
        _lost(position_m, here, settings, braking),
        fence,
        site,
        *obstacles_around(position_m, here, braking, fastest_m_s),
        *clear_of_targets,
    )
    if here.near_traffic is None:
        return walls
    evading = Evading(
        position_m,
        here.commanded & ~here.descending,
        desired_m_s,
        settings.floor.standoff_m(np.array(here.uncertainty_m)),
        np.minimum(here.speed_max_m_s, settings.limits.horizontal_m_s),
        braking.of_each(len(position_m), here.response),
        settings.fence.distance_max_m,
    )
    return Constraints.joined(walls, track_constraints(evading, here.near_traffic))


def _lost(position_m: Array, here: Surroundings, settings: SafetySettings, braking: Braking) -> Constraints:
    """Constraints of the paths that lost vehicles may take."""
    if not len(here.segments_m):
        return Constraints.none()
    return keepout_constraints(
        position_m,
        here.commanded if here.pressed is None else here.commanded & ~here.pressed,
        here.segments_m,
        floor=settings.floor,
        braking=braking,
        uncertainty_m=np.hypot(here.uncertainty_m, here.wander_m),
        segments_uncertainty_m=None if here.segments_of is None else here.uncertainty_m[here.segments_of],
        segments_of=here.segments_of,
        drift=here.drift,
        passage=here.passage,
        response=here.response,
        fastest_m_s=settings.limits.fastest_m_s,
    )


def obstacles_around(
    position_m: Array, here: Surroundings, braking: Braking, fastest_m_s: float
) -> tuple[Constraints, Constraints]:
    """Constraints of obstacles, and of slow traffic, which holds up no vehicle that lands."""
    if not here.ellipses:
        return Constraints.none(), Constraints.none()
    slow = set() if here.near_traffic is None else {box.id for box in here.near_traffic.boxes}

    def around(is_slow: bool, commanded: Mask) -> Constraints:
        ellipses = {name: here.ellipses[name] for name in here.ellipses if (name in slow) is is_slow}
        return obstacle_constraints(
            position_m, commanded, ellipses, braking, response=here.response, fastest_m_s=fastest_m_s
        )

    return around(False, here.commanded), around(True, here.commanded & ~here.descending)


def _site(
    position_m: Array,
    here: Surroundings,
    settings: SafetySettings,
    braking: Braking,
    course_m_s: Array | None,
) -> Constraints:
    """Constraints of the fence's areas, and of where vehicles would fall."""
    fence, ground = settings.fence, settings.fence.controlled_ground
    if fence.is_plain:
        return Constraints.none()
    velocity_m_s = np.nan_to_num(here.velocity_m_s)
    uncertainty_m = np.array(here.uncertainty_m)
    fastest_m_s = settings.limits.fastest_m_s
    walls = area_constraints(
        position_m,
        here.commanded,
        fence.areas,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=settings.floor.off_walls_m(uncertainty_m),
        response=here.response,
        fastest_m_s=fastest_m_s,
        descending=here.descending,
        heights_m=fence.heights_m,
        course_m_s=course_m_s,
    )
    if ground is None:
        return walls
    falls = ground_constraints(
        position_m,
        here.commanded,
        ground,
        settings.impact,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=settings.floor.standoff_m(uncertainty_m),
        response=here.response,
        fastest_m_s=fastest_m_s,
        course_m_s=course_m_s,
    )
    return Constraints.joined(walls, falls)


def reach_of_each(here: Surroundings, walls: Constraints, settings: SafetySettings) -> Constraints:
    """Constraints on what vehicles short of authority cannot do."""
    least = settings.authority
    return reach_constraints(
        np.array(here.velocity_m_s),
        np.array(here.commanded),
        here.lack_m_s,
        walls,
        least.lack_m_s,
        least.reserve_m_s,
    )
