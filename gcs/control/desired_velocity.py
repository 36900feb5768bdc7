"""Velocities that the law and the goals require of every vehicle, before the safety filter."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import hypot

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.inputs import Memory, TickInputs
from gcs.formation.article import ForceSettings, flown_velocity
from gcs.formation.law import (
    begun,
    directions_from,
    goal_velocity,
    ramped_spin,
    slot_velocity,
    spin_velocity,
    symmetry_offsets,
    turned,
)
from gcs.formation.neighbours import Belief, Sight, neighbours_velocity, range_m, sight_of
from gcs.formation.obstacles import Ellipse, Outlines
from gcs.formation.orbit import Center
from gcs.formation.repulsion import sweep, sweeps_for
from gcs.formation.response import scale_to_limits, shrink_relative
from gcs.formation.steering import avoid_all, level, steer_past
from gcs.model.plan import LawName
from gcs.model.state import TINY, Array

HELD_S, SLOT_STAYS_S = 1.0, 3.0
"""A vehicle that does not follow for the first time is held; its slot then stays with it for the second."""

SLOW_SHARE, OFF_M = 0.4, 1.5
"""A vehicle does not follow with less than this share of its expected speed, this far from its slot."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Velocities of the vehicles in formation, and what the law keeps for its next tick."""

    velocity_m_s: Array  # (m, 3) of the m vehicles in formation
    place: Array  # (n, 3) as in Memory
    change: Array  # (n, 3) as in Memory
    unfollowed_s: Array | None = None  # as in Memory
    belief: Belief | None = None  # as in Memory
    knows_center: bool = True  # False: the vehicles do not know the commanded centre's motion beforehand
    spin_rad_s: float = 0.0  # as in Memory


@dataclass(frozen=True, slots=True, eq=False)
class Formed:
    """The vehicles in formation, seen from the commanded centre."""

    center: Center
    position_m: Array  # (m, 3)
    direction: Array  # (m, 3) from the centre
    distance_m: Array  # (m,)
    charge: Array  # (m,)
    spin_rad_s: float


def spread(now: TickInputs, lead: Lead, memory: Memory, sight: Sight | None = None) -> Spread:
    """Velocities of the vehicles in formation by the law that the plan names.

    With `sight` the vehicles compute the law `neighbours` themselves, from the messages they received.
    """
    nowhere, still = np.full_like(now.position_m, np.nan), np.zeros_like(now.position_m)
    center, law, limits = lead.center, now.settings.law, now.settings.safety.limits
    if center is None or len(now.rows) == 0:
        return Spread(np.zeros((len(now.rows), 3)), nowhere, still)
    position_m = now.of_formed(now.position_m)
    direction, distance_m = directions_from(position_m, center.position_m)
    spin_rad_s = ramped_spin(
        memory.spin_rad_s,
        now.plan.formation.spin_rad_s,
        lead.radius_m,
        now.dt_s,
        law.spin_acceleration_max_m_s2,
    )
    formed = Formed(center, position_m, direction, distance_m, now.of_formed(now.traits.charge), spin_rad_s)
    if now.plan.formation.law is LawName.SLOTS:
        found = _to_slots(now, lead, memory, formed)
    elif now.plan.formation.law is LawName.ARTICLE:
        found = _by_forces(now, lead, memory, formed)
    else:
        found = _by_neighbours(now, lead, memory, formed, sight)
    own_m_s = found.velocity_m_s
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
    return replace(found, velocity_m_s=velocity_m_s, spin_rad_s=spin_rad_s)


def _to_slots(now: TickInputs, lead: Lead, memory: Memory, formed: Formed) -> Spread:
    """Move the slots on; each vehicle flies to its own."""
    rows, law = now.rows, now.settings.law
    places, changes = now.of_formed(memory.place), now.of_formed(memory.change)
    joining = np.flatnonzero(np.isnan(places[:, 0]))
    if len(joining):
        places[joining] = begun(formed.direction[joining], now.fleet.ids, rows[joining], law)
        changes[joining] = 0.0
    if formed.spin_rad_s:
        places, changes = (turned(each, formed.spin_rad_s * now.dt_s) for each in (places, changes))
    sweeps = sweeps_for(len(rows), law.sweeps)
    places, changes = sweep(places, changes, formed.direction, formed.charge, sweeps, law.pull)
    off_m = lead.radius_m * np.linalg.norm(places - formed.direction, axis=1)
    unfollowed_s = _unfollowed_s(now, memory, formed, off_m)
    held = now.of_formed(unfollowed_s) < 0.0
    places[held], changes[held] = formed.direction[held], 0.0
    own_m_s = slot_velocity(
        formed.direction, formed.distance_m, places, lead.radius_m, law.slot_rate_per_s, law.speed_m_s
    )
    return Spread(own_m_s, now.for_all(places, np.nan), now.for_all(changes, 0.0), unfollowed_s)


def _unfollowed_s(now: TickInputs, memory: Memory, formed: Formed, off_m: Array) -> Array:
    """(n,) as in Memory: how long each vehicle, (m,) `off_m` from its slot, has not moved as expected.

    A vehicle that something holds or carries does not come to its slot, so its slot comes to it, and the
    others make room. After `SLOT_STAYS_S` the slot is free again: if the vehicle is, too, it follows.
    """
    count = len(now.formed)
    before_s = np.zeros(count) if memory.unfollowed_s is None else memory.unfollowed_s
    unfollowed_s = np.minimum(before_s + now.dt_s, np.where(before_s < 0.0, 0.0, HELD_S))
    expected_m_s = now.of_formed(memory.expected_m_s)
    moving_m_s = now.of_formed(now.velocity_m_s) - formed.center.velocity_m_s
    along, enough = (moving_m_s * expected_m_s).sum(axis=1), SLOW_SHARE * (expected_m_s**2).sum(axis=1)
    slow = np.zeros(count, dtype=np.bool_)
    slow[now.rows] = (off_m > OFF_M) & (along < enough)
    unfollowed_s[(before_s >= 0.0) & ~slow] = 0.0
    unfollowed_s[unfollowed_s >= HELD_S] = -SLOT_STAYS_S
    return unfollowed_s


def _off_symmetry(now: TickInputs, lead: Lead, formed: Formed, settings: ForceSettings) -> Array:
    """(m, 3) velocities that break the symmetry of vehicles that joined lately."""
    engaged_s = now.fleet.time_s - lead.engaged_time_s[now.rows]
    speed_m_s = settings.symmetry_speed_m_s * np.exp(-engaged_s / settings.symmetry_decay_s)
    offset_m_s: Array = speed_m_s[:, None] * symmetry_offsets(formed.direction, now.fleet.ids, now.rows)
    return offset_m_s


def _by_forces(now: TickInputs, lead: Lead, memory: Memory, formed: Formed) -> Spread:
    """The article's forces on the vehicles' positions."""
    law = now.settings.law
    own_m_s, changes = flown_velocity(
        formed.position_m,
        formed.center.position_m,
        formed.charge,
        _momentum(now, memory, formed),
        radius_m=lead.radius_m,
        dt_s=now.dt_s,
        speed_max_m_s=law.speed_m_s,
        settings=law.article,
    )
    own_m_s += _off_symmetry(now, lead, formed, law.article)
    return Spread(own_m_s, np.full_like(now.position_m, np.nan), now.for_all(changes, 0.0))


def _by_neighbours(
    now: TickInputs, lead: Lead, memory: Memory, formed: Formed, sight: Sight | None
) -> Spread:
    """Each vehicle from what it knows within its range, with the centre on which the neighbours agree."""
    settings, center, count = now.settings.law.neighbours, formed.center, len(now.rows)
    if sight is None:
        before = Belief.nothing(len(now.formed)) if memory.belief is None else memory.belief
        seen = sight_of(
            formed.position_m,
            formed.charge,
            before.only(now.formed),
            Belief.describe(center.position_m, center.velocity_m_s, count),
            range_m=range_m(settings.neighbours, count, lead.radius_m),
            dt_s=now.dt_s,
            sighting_rate_per_s=settings.sighting_rate_per_s,
        )
    else:
        seen = sight.only(now.formed)
    belief = seen.belief or Belief.describe(center.position_m, center.velocity_m_s, count)
    own_m_s, changes = neighbours_velocity(
        formed.position_m,
        _momentum(now, memory, formed),
        seen,
        belief,
        radius_m=lead.radius_m,
        dt_s=now.dt_s,
        speed_max_m_s=now.settings.law.speed_m_s,
        settings=settings,
    )
    own_m_s += _off_symmetry(now, lead, formed, settings)
    own_m_s += np.where(np.isfinite(belief.velocity_m_s), belief.velocity_m_s, 0.0) - center.velocity_m_s
    kept = Belief(now.for_all(belief.center_m, np.nan), now.for_all(belief.velocity_m_s, np.nan))
    knows_center = sight is None or sight.belief is None
    nowhere = np.full_like(now.position_m, np.nan)
    return Spread(own_m_s, nowhere, now.for_all(changes, 0.0), belief=kept, knows_center=knows_center)


def _momentum(now: TickInputs, memory: Memory, formed: Formed) -> Array:
    """(m, 3) virtual velocity of the previous tick, turned with the formation."""
    return turned(now.of_formed(memory.change), formed.spin_rad_s * now.dt_s)


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
        columns = now.columns if len(now.tasks.segments_m) else None
        own_m_s = _avoiding(now, now.rows, own_m_s, lead.sides, sliding_m_s, columns)
        desired_m_s = now.for_all(own_m_s, 0.0)
    if now.to_goal.any():
        goers = np.flatnonzero(now.to_goal)
        to_goal_m_s = goal_velocity(now.position_m[goers], now.tasks.goal_m[goers], settings=law)
        half_m_s = 0.5 * np.hypot(to_goal_m_s[:, 0], to_goal_m_s[:, 1])
        desired_m_s[goers] = _avoiding(now, goers, to_goal_m_s, {}, half_m_s)
        if len(now.tasks.segments_m):
            free = ~now.tasks.descending[goers]  # these choose their way; a planned path is kept
            if now.tasks.follows_planned_path is not None:
                free &= ~now.tasks.follows_planned_path[goers]
            columns = now.columns
            past_m_s = _avoiding(now, goers, to_goal_m_s, {}, half_m_s, columns)
            past_m_s[:, 2] += _hindered(now, goers, to_goal_m_s, columns) * (-limits.up_m_s - past_m_s[:, 2])
            desired_m_s[goers[free]] = past_m_s[free]
    return scale_to_limits(desired_m_s, limits.horizontal_m_s, limits.up_m_s, limits.down_m_s)


HEADWAY_SHARE = 0.3
"""Of the desired speed: a vehicle that gains less on its goal behind the columns of lost vehicles climbs."""


def _hindered(
    now: TickInputs, rows: NDArray[np.intp], to_goal_m_s: Array, columns: Mapping[str, Ellipse]
) -> Array:
    """(m,) how much columns keep those rows (m,) from gaining on their goals: 1 if they gain nothing.

    Several columns may surround a vehicle on three sides, where no tangent leads out. Above them it is free.
    """
    if not columns:
        return np.zeros(len(rows))
    outlines, place_m = Outlines.of(columns), now.position_m[rows]
    way_m = now.tasks.goal_m[rows, :2] - place_m[:, :2]
    left_m, speed_m_s = np.hypot(way_m[:, 0], way_m[:, 1]), np.hypot(to_goal_m_s[:, 0], to_goal_m_s[:, 1])
    reach_m = np.full(len(outlines), now.settings.law.avoidance.lookahead_m)
    lower = -place_m[:, 2:] < outlines.top_height_m
    met_m = steer_past(outlines, {}, level(place_m), level(to_goal_m_s), speed_m_s, lower, reach_m)[1]
    gained_m_s = (now.velocity_m_s[rows, :2] * way_m).sum(axis=1) / np.maximum(left_m, TINY)
    share = 1.0 - gained_m_s / np.maximum(HEADWAY_SHARE * speed_m_s, TINY)
    hindered: Array = np.where(met_m < left_m, np.clip(share, 0.0, 1.0), 0.0)
    return hindered


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
