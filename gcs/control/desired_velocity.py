"""Velocities that the law and the goals require of every vehicle, before the safety filter."""

from collections.abc import Mapping
from dataclasses import dataclass
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
from gcs.formation.obstacles import Ellipse
from gcs.formation.orbit import Center
from gcs.formation.repulsion import sweep, sweeps_for
from gcs.formation.response import scale_to_limits, shrink_relative
from gcs.formation.steering import avoid_all
from gcs.model.jit import kernel
from gcs.model.plan import LawName
from gcs.model.state import TINY, Array
from gcs.safety.walls import from_path_m

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
    center, law = lead.center, now.settings.law
    if center is None or len(now.rows) == 0:
        nowhere, still = np.full_like(now.position_m, np.nan), np.zeros_like(now.position_m)
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
        return _to_slots(now, lead, memory, formed)
    if now.plan.formation.law is LawName.ARTICLE:
        return _by_forces(now, lead, memory, formed)
    return _by_neighbours(now, lead, memory, formed, sight)


def slots_m(now: TickInputs, lead: Lead, places: Spread) -> Array:
    """(m, 3) slots of the m vehicles in formation, show frame; NaN by a law without slots."""
    if lead.center is None:
        return np.full((len(now.rows), 3), np.nan)
    slot_m: Array = lead.center.position_m + lead.radius_m * now.of_formed(places.place)
    return slot_m


def _flown(now: TickInputs, formed: Formed, own_m_s: Array) -> Array:
    """(m, 3) velocities over the ground for the law's own (m, 3): with centre and spin, within the limits."""
    limits, spin_rad_s = now.settings.safety.limits, formed.spin_rad_s
    if spin_rad_s:
        offset_m = formed.distance_m[:, None] * formed.direction
        late_s = now.settings.response_s + 2.0 * now.settings.safety.link_delay_s
        own_m_s += spin_velocity(offset_m, spin_rad_s, late_s)
    return shrink_relative(
        formed.center.velocity_m_s,
        own_m_s,
        limits.horizontal_m_s,
        limits.up_m_s,
        limits.down_m_s,
        now.of_formed(now.traits.speed_max_m_s),
    )


def _to_slots(now: TickInputs, lead: Lead, memory: Memory, formed: Formed) -> Spread:
    """Move the slots on; each vehicle flies to its own."""
    rows, law = now.rows, now.settings.law
    places, changes = now.of_formed(memory.place), now.of_formed(memory.change)
    joining = np.isnan(places[:, 0]).nonzero()[0]
    if len(joining):
        places[joining] = begun(formed.direction[joining], now.fleet.ids, rows[joining], law)
        changes[joining] = 0.0
    if formed.spin_rad_s:
        places, changes = (turned(each, formed.spin_rad_s * now.dt_s) for each in (places, changes))
    sweeps = sweeps_for(len(rows), law.sweeps)
    paths, before = _lost_paths(now, formed.center), places
    places, changes = sweep(places, changes, formed.direction, formed.charge, sweeps, law.pull)
    if paths and _move_out(places, lead.radius_m, *paths):  # again, gently: each sweep leads them back in
        pull, changes = max(law.pull, PULL_BESIDE_PATHS), np.zeros_like(changes)
        places, changes = sweep(before, changes, formed.direction, formed.charge, 1, pull)
        _move_out(places, lead.radius_m, *paths)
    unfollowed_s = np.zeros(len(now.formed)) if memory.unfollowed_s is None else memory.unfollowed_s.copy()
    _keep_with_vehicles(
        unfollowed_s,
        places,
        changes,
        now.rows,
        formed.direction,
        now.velocity_m_s,
        memory.expected_m_s,
        formed.center.velocity_m_s,
        lead.radius_m,
        now.dt_s,
    )
    own_m_s = slot_velocity(
        formed.direction, formed.distance_m, places, lead.radius_m, law.slot_rate_per_s, law.speed_m_s
    )
    return Spread(
        _flown(now, formed, own_m_s),
        now.for_all(places, np.nan),
        now.for_all(changes, 0.0),
        unfollowed_s,
        spin_rad_s=formed.spin_rad_s,
    )


SLOT_SPARE_M = 0.5
"""A slot is farther from the paths of lost vehicles than the filter keeps its vehicle, by this much."""

AHEAD_S = np.array([0.0, 0.6, 1.2])
"""Slots are clear of these paths now and where the centre takes them in these times."""

PULL_BESIDE_PATHS = 0.05
"""`LawSettings.pull` while slots would lie in these paths: they come to rest only with their vehicles."""

LOOK_M, LOOK_STEP_M, DIRECTIONS = 15.0, 0.25, 12
"""How far along the sphere a slot's way out is searched, how finely, and in how many directions."""


def _lost_paths(now: TickInputs, center: Center) -> tuple[Array, Array, Array, Array] | None:
    """The paths of lost vehicles as `_move_out` needs them, from `centers_m` on; None: there is none."""
    tasks, floor = now.tasks, now.settings.safety.floor
    known = len(tasks.segments_m) - tasks.silent_segments
    if known == 0:
        return None
    uncertainty_m = np.array(now.traits.uncertainty_m)
    own_m = float(np.max(uncertainty_m, where=now.formed, initial=0.0))
    lost_m = uncertainty_m.max(initial=0.0) if tasks.segments_of is None else uncertainty_m[tasks.segments_of]
    kept_m = floor.horizontal_m + floor.margin_m + floor.reserve_m(own_m, lost_m) + SLOT_SPARE_M
    return (
        center.position_m + AHEAD_S[:, None] * center.velocity_m_s,
        np.ascontiguousarray(tasks.segments_m[:known] * floor.scale),
        np.broadcast_to(kept_m, len(tasks.segments_m))[:known].copy(),
        floor.scale,
    )


@kernel
def _move_out(
    places: Array,
    radius_m: float,
    centers_m: Array,
    segments_m: Array,
    kept_m: Array,
    scale: Array,
) -> bool:
    """Move slots out of the space of lost vehicles by the shortest way along the sphere.

    Args:
        places: (m, 3) slots, unit vectors, changed.
        radius_m: of the sphere.
        centers_m: (a, 3) of the sphere, now and later.
        segments_m: (k, 2, 3) paths, times `scale`.
        kept_m: (k,) distances to be kept from each, times `scale`.
        scale: (3,) as `Floor.scale`.

    Returns: whether one was not clear of it.
    """
    found, moved, off_m = np.empty(3), False, np.empty(3)
    reach_m, near = LOOK_M * scale.max(), np.empty(len(segments_m), np.int64)
    for i in range(len(places)):
        count = 0
        for k in range(len(segments_m)):
            for a in range(len(centers_m)):
                at_m = (centers_m[a] + radius_m * places[i]) * scale
                if from_path_m(at_m, segments_m[k], off_m) < kept_m[k] + reach_m:
                    near[count] = k
                    count += 1
                    break
        beside_m, beside_kept_m = segments_m[near[:count]], kept_m[near[:count]]
        if _is_clear(places[i], radius_m, centers_m, beside_m, beside_kept_m, scale):
            continue
        best_m, found[:], moved = LOOK_M, places[i], True
        level = max(np.hypot(places[i, 0], places[i, 1]), TINY)
        sideways = np.array([-places[i, 1] / level, places[i, 0] / level, 0.0])
        upwards = np.cross(places[i], sideways)
        for d in range(DIRECTIONS):
            turn_rad = 2.0 * np.pi * d / DIRECTIONS
            along = np.cos(turn_rad) * sideways + np.sin(turn_rad) * upwards
            gone_m = LOOK_STEP_M
            while gone_m < best_m:
                there = np.cos(gone_m / radius_m) * places[i] + np.sin(gone_m / radius_m) * along
                if _is_clear(there, radius_m, centers_m, beside_m, beside_kept_m, scale):
                    best_m, found[:] = gone_m, there
                gone_m += LOOK_STEP_M
        places[i] = found
    return moved


@kernel
def _is_clear(
    place: Array, radius_m: float, centers_m: Array, segments_m: Array, kept_m: Array, scale: Array
) -> bool:
    """Whether the slot (3,) is clear of all paths with every centre; arguments as of `_move_out`."""
    off_m = np.empty(3)
    for a in range(len(centers_m)):
        at_m = (centers_m[a] + radius_m * place) * scale
        for k in range(len(segments_m)):
            if from_path_m(at_m, segments_m[k], off_m) < kept_m[k]:
                return False
    return True


@kernel
def _keep_with_vehicles(
    unfollowed_s: Array,
    places: Array,
    changes: Array,
    rows: NDArray[np.intp],
    direction: Array,
    velocity_m_s: Array,
    expected_m_s: Array,
    center_m_s: Array,
    radius_m: float,
    dt_s: float,
) -> None:
    """Update how long each vehicle has not moved as expected, and lay the slots of those held where they are.

    A vehicle that something holds or carries does not come to its slot, so its slot comes to it, and the
    others make room. After `SLOT_STAYS_S` the slot is free again: if the vehicle is, too, it follows.

    Args:
        unfollowed_s: (n,) as in Memory, changed.
        places: (m, 3) slots of the vehicles in formation, changed.
        changes: (m, 3) of the slots, changed.
        rows: (m,) of the vehicles in formation.
        direction: (m, 3) to the vehicles.
        velocity_m_s: (n, 3) measured.
        expected_m_s: (n, 3) relative to the centre, NaN: not commanded.
        center_m_s: (3,) velocity of the centre.
        radius_m: of the sphere.
        dt_s: since the previous tick.
    """
    slow = np.zeros(len(unfollowed_s), np.bool_)
    for a in range(len(rows)):
        i, off, along, enough = rows[a], 0.0, 0.0, 0.0
        for k in range(3):
            off += (places[a, k] - direction[a, k]) ** 2
            along += (velocity_m_s[i, k] - center_m_s[k]) * expected_m_s[i, k]
            enough += expected_m_s[i, k] ** 2
        slow[i] = radius_m * np.sqrt(off) > OFF_M and along < SLOW_SHARE * enough
    for i in range(len(unfollowed_s)):
        before_s = unfollowed_s[i]
        unfollowed_s[i] = min(before_s + dt_s, 0.0 if before_s < 0.0 else HELD_S)
        if before_s >= 0.0 and not slow[i]:
            unfollowed_s[i] = 0.0
        if unfollowed_s[i] >= HELD_S:
            unfollowed_s[i] = -SLOT_STAYS_S
    for a in range(len(rows)):
        if unfollowed_s[rows[a]] < 0.0:
            places[a], changes[a] = direction[a], 0.0


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
    return Spread(
        _flown(now, formed, own_m_s),
        np.full_like(now.position_m, np.nan),
        now.for_all(changes, 0.0),
        spin_rad_s=formed.spin_rad_s,
    )


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
    return Spread(
        _flown(now, formed, own_m_s),
        np.full_like(now.position_m, np.nan),
        now.for_all(changes, 0.0),
        belief=kept,
        knows_center=knows_center,
        spin_rad_s=formed.spin_rad_s,
    )


def _momentum(now: TickInputs, memory: Memory, formed: Formed) -> Array:
    """(m, 3) virtual velocity of the previous tick, turned with the formation."""
    return turned(now.of_formed(memory.change), formed.spin_rad_s * now.dt_s)


def desired_velocity(
    now: TickInputs, lead: Lead, own_m_s: Array, aim_m: Array, aiming: NDArray[np.intp]
) -> Array:
    """(n, 3) velocities that law and goals require, with obstacles avoided, within the speed limits.

    Args:
        now: inputs of this tick.
        lead: what the formation follows.
        own_m_s: (m, 3) of the m vehicles in formation, without the centre's avoidance.
        aim_m: (n, 3) to where vehicles with goals of their own, or on routes to their slots, fly now.
        aiming: (k,) rows of these vehicles.
    """
    law, limits = now.settings.law, now.settings.safety.limits
    columns = now.columns if len(now.tasks.segments_m) and len(now.rows) else {}
    if lead.center is not None and len(now.rows) and (now.ellipses or columns):
        along_m_s = hypot(lead.center.velocity_m_s[0], lead.center.velocity_m_s[1])
        sliding_m_s = np.full(len(own_m_s), along_m_s)
        own_m_s = _avoiding(now, now.rows, own_m_s, lead.sides, sliding_m_s, columns)
    desired_m_s = now.for_all(own_m_s, 0.0)
    if len(aiming):
        to_aim_m_s = goal_velocity(now.position_m[aiming], aim_m[aiming], settings=law)
        half_m_s = 0.5 * np.hypot(to_aim_m_s[:, 0], to_aim_m_s[:, 1])
        desired_m_s[aiming] = _avoiding(now, aiming, to_aim_m_s, {}, half_m_s, {})
    return scale_to_limits(desired_m_s, limits.horizontal_m_s, limits.up_m_s, limits.down_m_s)


def _avoiding(
    now: TickInputs,
    rows: NDArray[np.intp],
    desired_m_s: Array,
    sides: Mapping[str, float],
    sliding_m_s: Array,
    columns: Mapping[str, Ellipse],
) -> Array:
    """(m, 3) velocities of those rows (m,) with obstacles avoided; the other arguments as in `avoid_all`."""
    ellipses = {**now.ellipses, **columns}
    if not ellipses:
        return desired_m_s
    avoidance = now.settings.law.avoidance
    return avoid_all(now.position_m[rows], desired_m_s, ellipses, sides, sliding_m_s, avoidance)
