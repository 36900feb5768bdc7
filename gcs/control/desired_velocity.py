"""Velocities that the law and the goals require of every vehicle, before the safety filter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.inputs import Memory, TickInputs
from gcs.formation.law import (
    begun,
    directions_from,
    goal_velocity,
    ramped_spin,
    slot_velocity,
    spin_velocity,
    turned,
)
from gcs.formation.obstacles import Ellipse
from gcs.formation.repulsion import sweep, sweeps_for
from gcs.formation.response import scale_to_limits, shrink_relative
from gcs.formation.steering import avoid_all
from gcs.model.state import Array


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Slots of the vehicles in formation, and the velocities towards them."""

    place: Array  # (n, 3) as in Memory
    change: Array  # (n, 3) as in Memory
    velocity_m_s: Array  # (m, 3) of the m vehicles in formation
    knows_center: bool = True  # False: the vehicles do not know the commanded centre's motion beforehand
    spin_rad_s: float = 0.0  # as in Memory


Law: TypeAlias = Callable[[TickInputs, Lead, Memory], Spread]
"""The law of the vehicles in formation."""


def spread(now: TickInputs, lead: Lead, memory: Memory) -> Spread:
    """Move the slots on, and compute the velocities of the vehicles in formation towards theirs."""
    center, rows, law, limits = lead.center, now.rows, now.settings.law, now.settings.safety.limits
    nothing = np.zeros((len(rows), 3))
    if center is None or len(rows) == 0:
        return Spread(np.full_like(now.position_m, np.nan), np.zeros_like(now.position_m), nothing)
    position_m = now.of_formed(now.position_m)
    direction, distance_m = directions_from(position_m, center.position_m)
    places, changes = now.of_formed(memory.place), now.of_formed(memory.change)
    joining = np.flatnonzero(np.isnan(places[:, 0]))
    if len(joining):
        places[joining] = begun(direction[joining], now.fleet.ids, rows[joining], law)
        changes[joining] = 0.0
    spin_rad_s = ramped_spin(
        memory.spin_rad_s,
        now.plan.formation.spin_rad_s,
        lead.radius_m,
        now.dt_s,
        law.spin_acceleration_max_m_s2,
    )
    if spin_rad_s:
        places, changes = (turned(each, spin_rad_s * now.dt_s) for each in (places, changes))
    charge, sweeps = now.of_formed(now.traits.charge), sweeps_for(len(rows), law.sweeps)
    places, changes = sweep(places, changes, direction, charge, sweeps, law.pull)
    own_m_s = slot_velocity(direction, distance_m, places, lead.radius_m, law.slot_rate_per_s, law.speed_m_s)
    if spin_rad_s:
        own_m_s += spin_velocity(distance_m[:, None] * direction, spin_rad_s, now.settings.response_s)
    velocity_m_s = shrink_relative(
        center.velocity_m_s,
        own_m_s,
        limits.horizontal_m_s,
        limits.up_m_s,
        limits.down_m_s,
        now.of_formed(now.traits.speed_max_m_s),
    )
    return Spread(now.for_all(places, np.nan), now.for_all(changes, 0.0), velocity_m_s, spin_rad_s=spin_rad_s)


def desired_velocity(now: TickInputs, lead: Lead, own_m_s: Array) -> Array:
    """(n, 3) velocities that law and goals require, with obstacles avoided, within the speed limits.

    Args:
        now: inputs of this tick.
        lead: what the formation follows.
        own_m_s: (m, 3) of the m vehicles in formation, without the centre's avoidance.
    """
    law, limits = now.settings.law, now.settings.safety.limits
    desired_m_s = np.zeros_like(now.position_m)
    if lead.center is not None and len(now.rows):
        along_m_s = hypot(lead.center.velocity_m_s[0], lead.center.velocity_m_s[1])
        sliding_m_s = np.full(len(own_m_s), along_m_s)
        desired_m_s = now.for_all(_avoiding(now, now.rows, own_m_s, lead.sides, sliding_m_s), 0.0)
    if now.to_goal.any():
        goers = np.flatnonzero(now.to_goal)
        to_goal_m_s = goal_velocity(now.position_m[goers], now.tasks.goal_m[goers], settings=law)
        half_m_s = 0.5 * np.hypot(to_goal_m_s[:, 0], to_goal_m_s[:, 1])
        desired_m_s[goers] = _avoiding(now, goers, to_goal_m_s, {}, half_m_s)
        if len(now.tasks.segments_m):
            free = ~now.tasks.descending[goers]  # these choose their way; a planned path is kept
            if now.tasks.follows_planned_path is not None:
                free &= ~now.tasks.follows_planned_path[goers]
            past_m_s = _avoiding(now, goers, to_goal_m_s, {}, half_m_s, now.columns)
            desired_m_s[goers[free]] = past_m_s[free]
    return scale_to_limits(desired_m_s, limits.horizontal_m_s, limits.up_m_s, limits.down_m_s)


def _avoiding(
    now: TickInputs,
    rows: NDArray[np.intp],
    desired_m_s: Array,
    sides: Mapping[str, float],
    sliding_m_s: Array,
    columns: Mapping[str, Ellipse] | None = None,
) -> Array:
    """(m, 3) velocities of those rows (m,) with obstacles avoided; the other arguments as in `avoid_all`."""
    ellipses = {**now.ellipses, **(columns or {})}
    if not ellipses:
        return desired_m_s
    avoidance = now.settings.law.avoidance
    return avoid_all(now.position_m[rows], desired_m_s, ellipses, sides, sliding_m_s, avoidance)
