"""Velocities that the law and the goals require of every vehicle, before the safety filter."""

from collections.abc import Mapping
from math import hypot

import numpy as np
from numpy.typing import NDArray

from gcs.control.center import Lead
from gcs.control.inputs import TickInputs
from gcs.control.law_step import Spread
from gcs.control.round_obstacles import left_behind
from gcs.formation.law import goal_velocity
from gcs.formation.obstacles import Ellipse
from gcs.formation.response import scale_to_limits
from gcs.formation.steering import avoid_all
from gcs.formation.trajectory import trajectory_velocity
from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import DECELERATION, ESCAPE, REACTION, allowed_speed_m_s


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
        here_m, there_m = now.position_m, aim_m
        if len(aiming) == len(aim_m):
            aiming = np.arange(len(aiming))
        else:
            here_m, there_m = here_m[aiming], there_m[aiming]
        to_aim_m_s = goal_velocity(
            here_m,
            there_m,
            settings=law,
            limits_m_s=limits.each_m_s,
            speed_max_m_s=now.approach_to_m_s(aiming, here_m, there_m),
        )
        desired_m_s[aiming] = to_aim_m_s
        if now.ellipses:
            half_m_s = 0.5 * np.hypot(to_aim_m_s[:, 0], to_aim_m_s[:, 1])
            round_m_s = _avoiding(now, aiming, to_aim_m_s, {}, half_m_s, {})
            desired_m_s[aiming] = np.where(straight[aiming, None], to_aim_m_s, round_m_s)
    if len(drawn):
        desired_m_s[drawn] = _as_drawn(now, drawn, columns)
    scaled_m_s = scale_to_limits(desired_m_s, *limits.each_m_s)
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
    late_s = now.settings.safety.link_delay_s  # positions are so old, and setpoints arrive so much later
    then_m = goals.position_m[rows] - late_s * goals.velocity_m_s[rows]
    soon_m_s = goals.velocity_m_s[rows] + late_s * goals.acceleration_m_s2[rows]
    off_m = np.linalg.norm(now.position_m[rows] - then_m, axis=1)
    along_m_s = trajectory_velocity(
        now.position_m[rows],
        then_m,
        soon_m_s,
        rate_per_s=law.slot_rate_per_s,
        correction_max_m_s=np.minimum(law.speed_m_s, now.approach_max_m_s(rows, off_m)),
        limits_m_s=limits.each_m_s,
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
