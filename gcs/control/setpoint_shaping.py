"""Setpoints that make the vehicles fly the allowed velocities; the trim is learned from their response."""

from collections.abc import Callable
from dataclasses import dataclass
from math import hypot

import numpy as np

from gcs.control.inputs import TickInputs
from gcs.control.memory import Memory
from gcs.formation.orbit import Center, next_pace
from gcs.formation.response import compensate, correct_trim, most_lacking_m_s, shared
from gcs.formation.trajectory import led_share
from gcs.model.jit import kernel
from gcs.model.state import Array, Mask
from gcs.safety.filter import cap

PRESSED = 0.65
"""Share of the speed limit from which a setpoint has little reserve left."""

STANDING_M_S = 0.5
"""A centre slower than this does not reduce its pace for vehicles that fall behind."""

HALVES_S = 0.1
"""Delay of the links, one way, at which the inner loop has half its gain: with all of it, the loop that the
filter closes on the measured velocities swings between neighbours on all sides (decision 0043).
"""


@dataclass(frozen=True, slots=True, eq=False)
class ShapedSetpoints:
    """The setpoints, and what the next tick needs to know of them."""

    setpoint_m_s: Array  # (n, 3) within the limits
    learn: Callable[[], tuple[Array, Array, float]]  # returns trim and expected velocity (n, 3), and the pace


def shape_setpoints(
    now: TickInputs,
    allowed_m_s: Array,
    center: Center | None,
    memory: Memory,
    *,
    knows_center: bool,
    yields: Mask,
) -> ShapedSetpoints:
    """Apply inner loop, lead and trim to the velocities (n, 3) that the safety filter allows.

    With `knows_center` the vehicles in formation know the centre's motion beforehand. The trim of those in
    `yields` (n,) does not grow: it would ask for what they do not reach.
    """
    settings, limits, response = now.settings, now.settings.safety.limits, now.traits.response
    stable = 1.0 / (1.0 + settings.safety.link_delay_s / HALVES_S)
    base_m_s, lead_m_s2 = _known_beforehand(now, center if knows_center else None)
    _lead_along_drawing(now, allowed_m_s, base_m_s, lead_m_s2)
    requested_m_s = compensate(
        allowed_m_s,
        now.velocity_m_s,
        lead_m_s2,
        stable * settings.loop_gain * response.loop_share,
        stable * settings.vertical_loop_gain * response.loop_share,
        settings.lead_s * response.lead_share,
    )
    requested_m_s += memory.trim_m_s
    setpoint_m_s = cap(requested_m_s, limits, now.traits.speed_max_m_s)

    def learn() -> tuple[Array, Array, float]:
        trim_m_s, expected_m_s = correct_trim(
            memory.trim_m_s,
            memory.expected_m_s,
            allowed_m_s,
            now.velocity_m_s,
            base_m_s,
            now.commanded,
            yields,
            _at_limit(
                requested_m_s,
                np.array(now.traits.speed_max_m_s),
                limits.horizontal_m_s,
                limits.up_m_s,
                limits.down_m_s,
            ),
            now.dt_s,
            settings.response_s,
            settings.trim_rate_per_s * response.trim_share,
            settings.vertical_trim_rate_per_s * response.trim_share,
            settings.trim_max_m_s,
        )
        pace = _pace(now, center, base_m_s, expected_m_s, requested_m_s, memory)
        return trim_m_s, expected_m_s, pace

    return ShapedSetpoints(setpoint_m_s, learn)


@kernel
def _at_limit(
    requested_m_s: Array, own_m_s: Array, horizontal_m_s: float, up_m_s: float, down_m_s: float
) -> Mask:
    """(n, 2) whether the setpoints (n, 3) ask for more than a limit, sideways and up or down.

    Apart, so that a vehicle that climbs as fast as it may still learns the wind.
    """
    at_limit = np.empty((len(requested_m_s), 2), np.bool_)
    for i in range(len(requested_m_s)):
        square_m2_s2, climb_m_s = requested_m_s[i, 0] ** 2 + requested_m_s[i, 1] ** 2, -requested_m_s[i, 2]
        beyond = square_m2_s2 + climb_m_s**2 > own_m_s[i] ** 2
        at_limit[i, 0] = beyond or square_m2_s2 > horizontal_m_s**2
        at_limit[i, 1] = beyond or climb_m_s > up_m_s or climb_m_s < -down_m_s
    return at_limit


def _known_beforehand(now: TickInputs, center: Center | None) -> tuple[Array, Array]:
    """(n, 3) velocity and acceleration that the vehicles in formation share with the centre."""
    if center is None:
        return np.zeros_like(now.position_m), np.zeros_like(now.position_m)
    return shared(now.formed, center.velocity_m_s), shared(now.formed, center.acceleration_m_s2)


def _lead_along_drawing(now: TickInputs, allowed_m_s: Array, base_m_s: Array, lead_m_s2: Array) -> None:
    """Set velocity and acceleration (n, 3) that vehicles of a drawn show know beforehand."""
    goals, rows = now.tasks.drawn, now.drawn_rows
    if goals is None or len(rows) == 0:
        return
    rows = rows[np.isfinite(goals.position_m[rows]).all(axis=1)]
    share = led_share(allowed_m_s[rows], goals.velocity_m_s[rows])
    base_m_s[rows] = goals.velocity_m_s[rows]
    lead_m_s2[rows] = share * goals.acceleration_m_s2[rows]


def _pace(
    now: TickInputs,
    center: Center | None,
    base_m_s: Array,
    expected_m_s: Array,
    requested_m_s: Array,
    memory: Memory,
) -> float:
    """Share of the orbit's speed that all vehicles can keep up with; not reduced while the centre stands."""
    if center is None:
        return 1.0
    behind_m_s = 0.0
    if hypot(*center.velocity_m_s.tolist()) >= STANDING_M_S:
        behind_m_s = most_lacking_m_s(
            center.velocity_m_s,
            base_m_s,
            expected_m_s,
            now.velocity_m_s,
            now.formed,
            requested_m_s,
            np.array(now.traits.speed_max_m_s),
            now.settings.safety.limits.horizontal_m_s,
            PRESSED,
        )
    return next_pace(memory.pace, behind_m_s, now.dt_s)
