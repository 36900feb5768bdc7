"""Velocities that the law and the goals require of every vehicle, before the safety filter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.inputs import FormationState, TickInputs
from gcs.control.memory import Memory
from gcs.control.round_obstacles import left_behind
from gcs.control.slots import Formed, laid, moved_on
from gcs.formation.article import ForceSettings, flown_velocity
from gcs.formation.law import (
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
from gcs.formation.response import scale_to_limits, shrink_relative
from gcs.formation.steering import avoid_all
from gcs.formation.trajectory import trajectory_velocity
from gcs.model.jit import kernel
from gcs.model.plan import LawName
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import DECELERATION, ESCAPE, REACTION, allowed_speed_m_s


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Velocities of the vehicles in formation, and what the law keeps for its next tick."""

    velocity_m_s: Array  # (m, 3) of the m vehicles in formation
    place: Array  # (n, 3) slots to which the vehicles fly now
    change: Array  # (n, 3) as in Memory
    unfollowed_s: Array | None = None  # as in Memory
    belief: Belief | None = None  # as in Memory
    knows_center: bool = True  # False: the vehicles do not know the commanded centre's motion beforehand
    spin_rad_s: float = 0.0  # as in Memory
    move_on: Callable[[], tuple[Array, Array]] | None = (
        None  # returns (n, 3) `place` and `change` for the next tick; None: they stay
    )


def spread(
    now: TickInputs,
    lead: Lead,
    memory: Memory,
    sight: Sight | None = None,
    shared: FormationState | None = None,
) -> Spread:
    """Velocities of the vehicles in formation by the law that the plan names.

    With `sight` the vehicles compute the law `neighbours` themselves, from the messages they received.
    `shared` is what another station computes for the whole formation.
    """
    center, law = lead.center, now.settings.law
    if center is None or len(now.sphere) == 0:
        place = np.full_like(now.position_m, np.nan) if shared is None else shared.place
        return Spread(np.zeros((len(now.rows), 3)), place, np.zeros_like(now.position_m))
    position_m = now.of_sphere(now.position_m)
    direction, distance_m = directions_from(position_m, center.position_m)
    spin_rad_s = ramped_spin(
        memory.spin_rad_s,
        now.plan.formation.spin_rad_s,
        lead.radius_m,
        now.dt_s,
        law.spin_acceleration_max_m_s2,
    )
    if shared is not None:
        spin_rad_s = shared.spin_rad_s
    formed = Formed(center, position_m, direction, distance_m, now.of_sphere(now.traits.charge), spin_rad_s)
    if now.plan.formation.law is LawName.SLOTS:
        return _to_slots(now, lead, memory, formed, shared)
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
        offset_m = now.ours(formed.distance_m[:, None] * formed.direction)
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


def _to_slots(
    now: TickInputs, lead: Lead, memory: Memory, formed: Formed, shared: FormationState | None
) -> Spread:
    """Each vehicle flies to its own slot; the slots are moved on for the next tick."""
    law, radius_m = now.settings.law, lead.radius_m
    slots = laid(now, memory, formed, radius_m, None if shared is None else shared.place)
    place = now.for_sphere(slots.place, np.nan)
    if shared is not None:  # those of others, for the time when this station leads
        place = shared.place.copy()
        place[now.sphere] = slots.place
    direction, distance_m, goal = map(now.ours, (formed.direction, formed.distance_m, slots.place))
    offset_m = distance_m[:, None] * direction - radius_m * goal
    fastest_m_s = now.approach_max_m_s(now.rows, np.linalg.norm(offset_m, axis=1))
    own_m_s = slot_velocity(
        direction, distance_m, goal, radius_m, law.slot_rate_per_s, np.minimum(law.speed_m_s, fastest_m_s)
    )

    def move_on() -> tuple[Array, Array]:
        place, change = moved_on(now, formed, slots, radius_m, memory.number)
        return now.for_sphere(place, np.nan), now.for_sphere(change, 0.0)

    return Spread(
        _flown(now, formed, own_m_s),
        place,
        now.for_sphere(slots.change, 0.0),
        slots.unfollowed_s,
        spin_rad_s=formed.spin_rad_s,
        move_on=move_on if shared is None else None,
    )


def _off_symmetry(now: TickInputs, lead: Lead, formed: Formed, settings: ForceSettings) -> Array:
    """(s, 3) velocities that break the symmetry of vehicles that joined lately; NaN for other stations'."""
    engaged_s = now.fleet.time_s - lead.engaged_time_s[now.sphere]
    speed_m_s = settings.symmetry_speed_m_s * np.exp(-engaged_s / settings.symmetry_decay_s)
    offset_m_s: Array = speed_m_s[:, None] * symmetry_offsets(formed.direction, now.fleet.ids, now.sphere)
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
    own_m_s = _stoppable(now, own_m_s + _off_symmetry(now, lead, formed, law.article), law.article)
    return Spread(
        _flown(now, formed, now.ours(own_m_s)),
        np.full_like(now.position_m, np.nan),
        now.for_sphere(changes, 0.0),
        spin_rad_s=formed.spin_rad_s,
    )


def _by_neighbours(
    now: TickInputs, lead: Lead, memory: Memory, formed: Formed, sight: Sight | None
) -> Spread:
    """Each vehicle from what it knows within its range, with the centre on which the neighbours agree."""
    settings, center, count = now.settings.law.neighbours, formed.center, len(now.sphere)
    on_sphere = np.zeros(len(now.formed), np.bool_)
    on_sphere[now.sphere] = True
    if sight is None:
        before = Belief.nothing(len(now.formed)) if memory.belief is None else memory.belief
        seen = sight_of(
            formed.position_m,
            formed.charge,
            before.only(on_sphere),
            Belief.describe(center.position_m, center.velocity_m_s, count),
            range_m=range_m(settings.neighbours, count, lead.radius_m),
            dt_s=now.dt_s,
            sighting_rate_per_s=settings.sighting_rate_per_s,
        )
    else:
        seen = sight.only(on_sphere)
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
    own_m_s = _stoppable(now, own_m_s + _off_symmetry(now, lead, formed, settings), settings)
    own_m_s += np.where(np.isfinite(belief.velocity_m_s), belief.velocity_m_s, 0.0) - center.velocity_m_s
    kept = Belief(now.for_sphere(belief.center_m, np.nan), now.for_sphere(belief.velocity_m_s, np.nan))
    knows_center = sight is None or sight.belief is None
    return Spread(
        _flown(now, formed, now.ours(own_m_s)),
        np.full_like(now.position_m, np.nan),
        now.for_sphere(changes, 0.0),
        belief=kept,
        knows_center=knows_center,
        spin_rad_s=formed.spin_rad_s,
    )


def _stoppable(now: TickInputs, own_m_s: Array, settings: ForceSettings) -> Array:
    """(s, 3) velocities of a law of forces, none faster than its vehicle can stop from where it leads.

    The forces are proportional near the place where they vanish: `own_m_s` (s, 3) says how far away that is.
    """
    rate_per_s = max(settings.sphere_rate_per_s, settings.spreading_rate_per_s)
    speed_m_s = np.linalg.norm(own_m_s, axis=1)
    fastest_m_s = now.approach_max_m_s(now.sphere, speed_m_s / rate_per_s)
    slower: Array = own_m_s * np.minimum(1.0, fastest_m_s / np.maximum(speed_m_s, TINY))[:, None]
    return slower


def _momentum(now: TickInputs, memory: Memory, formed: Formed) -> Array:
    """(m, 3) virtual velocity of the previous tick, turned with the formation."""
    return turned(now.of_sphere(memory.change), formed.spin_rad_s * now.dt_s)


def desired_velocity(
    now: TickInputs,
    lead: Lead,
    places: Spread,
    slot_m: Array,
    aim_m: Array,
    aiming: NDArray[np.intp],
    straight: Mask,
) -> Array:
    """(n, 3) velocities that law and goals require, with obstacles avoided, within the speed limits.

    Args:
        now: inputs of this tick.
        lead: what the formation follows.
        places: velocities of the m vehicles in formation, without the centre's avoidance.
        slot_m: (m, 3) as of `slots_m`.
        aim_m: (n, 3) to where vehicles with goals of their own, or on routes to their slots, fly now.
        aiming: (k,) rows of these vehicles.
        straight: (n,) which of them fly straight there, whatever obstacles are near.
    """
    law, limits = now.settings.law, now.settings.safety.limits
    drawn, own_m_s = now.drawn_rows, places.velocity_m_s
    columns = now.columns if len(now.tasks.segments_m) and len(now.rows) + len(drawn) else {}
    if lead.center is not None and len(now.rows) and (now.ellipses or columns):
        along_m_s = hypot(lead.center.velocity_m_s[0], lead.center.velocity_m_s[1])
        off_m = _to_slot_m(now, slot_m)
        until_m = off_m if lead.stands and not places.spin_rad_s else None
        sliding_m_s = np.full(len(own_m_s), along_m_s)
        if lead.stands:
            left = left_behind(now, slot_m, off_m)
            sliding_m_s[left] = 0.5 * np.hypot(*own_m_s[left, :2].T)
        own_m_s = _avoiding(now, now.rows, own_m_s, lead.sides, sliding_m_s, columns, until_m)
    desired_m_s = now.for_all(own_m_s, 0.0)
    if len(aiming):
        away_m = np.linalg.norm(aim_m[aiming] - now.position_m[aiming], axis=1)
        fastest_m_s = now.approach_max_m_s(aiming, away_m)
        to_aim_m_s = goal_velocity(
            now.position_m[aiming], aim_m[aiming], settings=law, speed_max_m_s=fastest_m_s
        )
        half_m_s = 0.5 * np.hypot(to_aim_m_s[:, 0], to_aim_m_s[:, 1])
        round_m_s = _avoiding(now, aiming, to_aim_m_s, {}, half_m_s, {})
        desired_m_s[aiming] = np.where(straight[aiming, None], to_aim_m_s, round_m_s)
    if len(drawn):
        desired_m_s[drawn] = _as_drawn(now, drawn, columns)
    scaled_m_s = scale_to_limits(desired_m_s, limits.horizontal_m_s, limits.up_m_s, limits.down_m_s)
    return _stopping_inside(now, scaled_m_s)


def _to_slot_m(now: TickInputs, slot_m: Array) -> Array:
    """(m,) distances to the slots (m, 3), sideways; inf by a law without slots."""
    off_m = slot_m - now.of_formed(now.position_m)
    return np.nan_to_num(np.hypot(off_m[:, 0], off_m[:, 1]), nan=np.inf)


def _stopping_inside(now: TickInputs, desired_m_s: Array) -> Array:
    """(n, 3) velocities from which the vehicles stop inside the fence, straight ahead; the rows are changed.

    The fence is a circle, and the safety filter bounds the speed towards it. A vehicle that flies along it,
    and turns later than the circle does, would leave it.
    """
    safety, own = now.settings.safety, now.own
    delay_s, response = safety.link_delay_s, now.stops.rows(own)
    each = safety.braking.over_link(delay_s).of_each(len(response), response.over_link(delay_s))
    _slow_down_inside(now.position_m, desired_m_s, each, safety.fence.distance_max_m)
    return desired_m_s


@kernel
def _slow_down_inside(position_m: Array, desired_m_s: Array, each: Array, distance_max_m: float) -> None:
    """As `_stopping_inside`, of the first rows: those of `each` (4, n), see `Braking.of_each`."""
    for i in range(each.shape[1]):
        x_m, y_m, x_m_s, y_m_s = position_m[i, 0], position_m[i, 1], desired_m_s[i, 0], desired_m_s[i, 1]
        speed_m_s = np.sqrt(x_m_s * x_m_s + y_m_s * y_m_s)
        along_m = (x_m * x_m_s + y_m * y_m_s) / max(speed_m_s, TINY)
        room_m2 = distance_max_m**2 - (x_m**2 + y_m**2)
        ahead_m = np.maximum(np.sqrt(np.maximum(along_m**2 + room_m2, 0.0)) - along_m, 0.0)
        most_m_s = allowed_speed_m_s(ahead_m, each[REACTION, i], each[DECELERATION, i], each[ESCAPE, i])
        if speed_m_s > most_m_s:
            desired_m_s[i, 0] *= most_m_s / speed_m_s
            desired_m_s[i, 1] *= most_m_s / speed_m_s


def _as_drawn(now: TickInputs, rows: NDArray[np.intp], columns: Mapping[str, Ellipse]) -> Array:
    """(d, 3) velocities of the vehicles of a drawn show in those rows (d,), with obstacles avoided."""
    goals, law, limits = now.tasks.drawn, now.settings.law, now.settings.safety.limits
    if goals is None:
        return np.zeros((len(rows), 3))
    off_m = np.linalg.norm(now.position_m[rows] - goals.position_m[rows], axis=1)
    along_m_s = trajectory_velocity(
        now.position_m[rows],
        goals.position_m[rows],
        goals.velocity_m_s[rows],
        rate_per_s=law.slot_rate_per_s,
        correction_max_m_s=np.minimum(law.speed_m_s, now.approach_max_m_s(rows, off_m)),
        limits_m_s=(limits.horizontal_m_s, limits.up_m_s, limits.down_m_s),
    )
    half_m_s = 0.5 * np.hypot(along_m_s[:, 0], along_m_s[:, 1])
    return _avoiding(now, rows, along_m_s, {}, half_m_s, columns)


def _avoiding(
    now: TickInputs,
    rows: NDArray[np.intp],
    desired_m_s: Array,
    sides: Mapping[str, float],
    sliding_m_s: Array,
    columns: Mapping[str, Ellipse],
    until_m: Array | None = None,
) -> Array:
    """(m, 3) velocities of those rows (m,) with obstacles avoided; the other arguments as in `avoid_all`."""
    ellipses = {**now.ellipses, **columns}
    if not ellipses:
        return desired_m_s
    avoidance = now.settings.law.avoidance
    place_m = now.position_m[rows]
    return avoid_all(place_m, desired_m_s, ellipses, sides, sliding_m_s, avoidance, until_m)
