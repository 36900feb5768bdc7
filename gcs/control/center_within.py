"""The formation's centre while its target is outside of where it may fly: the sphere waits within. Pure.

While the target is inside, the centre follows it anywhere: vehicles find their own ways past corners, and the
safety filter keeps them off walls. Outside, all slots would lie beyond a wall, and the vehicles flat upon it.
"""

from typing import Final

import numpy as np

from gcs.control.inputs import TickInputs
from gcs.formation.following import CenterLimits
from gcs.formation.orbit import CLEAR_OF_FENCE_M, Center
from gcs.model.state import Array
from gcs.safety.area_walls import area_constraints
from gcs.safety.constraints import Braking, Constraints, nearest, shortened
from gcs.safety.controlled_ground import falls_within, ground_constraints
from gcs.safety.fenced_areas import beyond_m

REACTION_S: Final = 0.1
"""Of the centre, a point that is only computed: two ticks."""

BACK_PER_S: Final = 0.5
"""Rate at which a centre that is too near to a wall goes back."""


def within_areas(
    now: TickInputs, ahead: Center, sphere_m: float, desired_m_s: Array, limits: CenterLimits
) -> Array:
    """The part of the velocity (3,) with which the sphere stays within areas and ground, off their edges.

    As it is while the target is inside. The speed up and down is kept: the
    height that is planned was checked.
    """
    target_m = np.array([[*now.plan.target.position_m(now.fleet.time_s), ahead.position_m[2]]])
    if not _is_outside(now, target_m):
        return desired_m_s
    walls = _walls(now, ahead, sphere_m, limits)
    rows = walls.first, walls.second, walls.normal, walls.bound_m_s
    held_m_s = shortened(nearest(desired_m_s[None].copy(), *rows), *rows, np.zeros(1, np.bool_))[0]
    return np.array([held_m_s[0], held_m_s[1], desired_m_s[2]])


def _is_outside(now: TickInputs, place_m: Array) -> bool:
    """Whether the formation may not fly at a place (1, 3)."""
    fence, impact = now.settings.safety.fence, now.settings.safety.impact
    if beyond_m(fence.areas, place_m)[0] > 0.0:
        return True
    ground = fence.controlled_ground
    return ground is not None and not falls_within(place_m, ground, impact)[0]


def _walls(now: TickInputs, ahead: Center, sphere_m: float, limits: CenterLimits) -> Constraints:
    safety, all_of_it = now.settings.safety, np.ones(1, np.bool_)
    braking = Braking(
        reaction_s=REACTION_S,
        lead_s=0.0,
        deceleration_m_s2=limits.acceleration_m_s2 / 2.0,
        escape_rate_per_s=BACK_PER_S,
    )
    place_m, velocity_m_s = ahead.position_m[None], ahead.velocity_m_s[None]
    standoff_m = np.array([sphere_m + CLEAR_OF_FENCE_M])
    fastest_m_s = max(limits.speed_m_s, safety.limits.fastest_m_s)
    walls = area_constraints(
        place_m,
        all_of_it,
        safety.fence.areas,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=standoff_m,
        fastest_m_s=fastest_m_s,
        heights_m=safety.fence.heights_m,
    )
    if (ground := safety.fence.controlled_ground) is None:
        return walls
    falls = ground_constraints(
        place_m,
        all_of_it,
        ground,
        safety.impact,
        braking,
        velocity_m_s=velocity_m_s,
        standoff_m=standoff_m,
        fastest_m_s=fastest_m_s,
    )
    return Constraints.joined(walls, falls)
