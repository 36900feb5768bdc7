"""From the velocity that a vehicle should have to the setpoint that produces it."""

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask


@kernel
def scale_to_limits(
    velocity_m_s: Array, horizontal_max_m_s: float, up_max_m_s: float, down_max_m_s: float
) -> Array:
    """Scale rows that exceed a limit until none does; the direction is kept.

    PX4 clips each axis by itself, which changes the direction.

    Args:
        velocity_m_s: (n, 3), z down. Rows not finite stay not finite: `gcs.safety` makes them rest.
        horizontal_max_m_s: sideways.
        up_max_m_s: of climbing.
        down_max_m_s: of descending.

    Returns: (n, 3) in m/s.
    """
    scaled = np.empty_like(velocity_m_s)
    for i in range(len(velocity_m_s)):
        x, y, z = velocity_m_s[i, 0], velocity_m_s[i, 1], velocity_m_s[i, 2]
        horizontal = horizontal_max_m_s / max(np.hypot(x, y), TINY)
        vertical = (up_max_m_s if z < 0.0 else down_max_m_s) / max(abs(z), TINY)
        share = min(1.0, horizontal, vertical)
        if not np.isfinite(x + y + z):
            share = np.nan
        for k in range(3):
            scaled[i, k] = velocity_m_s[i, k] * share
    return scaled


@kernel
def compensate(
    desired_m_s: Array,
    measured_m_s: Array,
    acceleration_m_s2: Array,
    gain: Array,
    vertical_gain: Array,
    lead_s: Array,
) -> Array:
    """Inner loop on the measured velocity, and a lead for the acceleration that is known beforehand.

    It has no state, so nothing winds up when a limit is met.

    Args:
        desired_m_s: (n, 3) velocity the vehicle should have now.
        measured_m_s: (n, 3) velocity it has.
        acceleration_m_s2: (n, 3) desired acceleration.
        gain: (n,) share of the horizontal velocity error added to the setpoint; 0 trusts the autopilot.
        vertical_gain: (n,) the same up and down, where PX4 by itself responds three times as fast.
        lead_s: (n,) lag of the autopilots' responses, in seconds.

    Returns: (n, 3) setpoints in m/s, not yet within limits.
    """
    setpoint = np.empty_like(desired_m_s)
    for i in range(len(desired_m_s)):
        for k in range(3):
            own_gain = vertical_gain[i] if k == 2 else gain[i]
            setpoint[i, k] = desired_m_s[i, k] + lead_s[i] * acceleration_m_s2[i, k]
            setpoint[i, k] += own_gain * (desired_m_s[i, k] - measured_m_s[i, k])
    return setpoint


@kernel
def limit_change(
    desired_m_s: Array, before_m_s: Array, measured_m_s: Array, acceleration_max_m_s2: Array, dt_s: float
) -> Array:
    """Follow the desired velocity within the acceleration limit.

    Args:
        desired_m_s: (n, 3).
        before_m_s: (n, 3) of the previous tick; NaN where not commanded, then `measured_m_s` counts.
        measured_m_s: (n, 3).
        acceleration_max_m_s2: (n,) of the change.
        dt_s: since the previous tick.

    Returns: (n, 3) in m/s.
    """
    followed = np.empty_like(desired_m_s)
    for i in range(len(desired_m_s)):
        square = 0.0
        for k in range(3):
            before = before_m_s[i, k] if np.isfinite(before_m_s[i, k]) else measured_m_s[i, k]
            followed[i, k] = before
            square += (desired_m_s[i, k] - before) ** 2
        share = min(1.0, acceleration_max_m_s2[i] * dt_s / max(np.sqrt(square), TINY))
        for k in range(3):
            followed[i, k] += share * (desired_m_s[i, k] - followed[i, k])
    return followed


@kernel
def shrink_relative(
    base_m_s: Array,
    relative_m_s: Array,
    horizontal_max_m_s: float,
    up_max_m_s: float,
    down_max_m_s: float,
    speed_max_m_s: Array,
) -> Array:
    """The common velocity, plus as much of each vehicle's own motion as the limits leave.

    Args:
        base_m_s: (3,) velocity of the formation.
        relative_m_s: (n, 3) relative to it.
        horizontal_max_m_s: sideways.
        up_max_m_s: of climbing.
        down_max_m_s: of descending.
        speed_max_m_s: (n,) of each vehicle, in any direction.

    Returns: (n, 3) in m/s. Where the common part alone exceeds a limit, it is returned alone.

    Source: article, section 3: v_t + v_d.
    """
    total = np.empty_like(relative_m_s)
    for i in range(len(relative_m_s)):
        x, y, z = relative_m_s[i, 0], relative_m_s[i, 1], relative_m_s[i, 2]
        limit = min(horizontal_max_m_s, speed_max_m_s[i])
        share = _share(
            base_m_s[0] ** 2 + base_m_s[1] ** 2, base_m_s[0] * x + base_m_s[1] * y, x * x + y * y, limit
        )
        if speed_max_m_s[i] < np.inf:
            square = base_m_s[0] ** 2 + base_m_s[1] ** 2 + base_m_s[2] ** 2
            inner = base_m_s[0] * x + base_m_s[1] * y + base_m_s[2] * z
            share = min(share, _share(square, inner, x * x + y * y + z * z, speed_max_m_s[i]))
        if z > 0.0:
            share = min(share, max(down_max_m_s - base_m_s[2], 0.0) / z)
        elif z < 0.0:
            share = min(share, max(up_max_m_s + base_m_s[2], 0.0) / -z)
        for k in range(3):
            total[i, k] = base_m_s[k] + share * relative_m_s[i, k]
    return total


@kernel
def _share(base_square: float, inner: float, square: float, limit: float) -> float:
    """Largest s in [0, 1] with |base + s relative| within the limit; 0 when base alone exceeds it."""
    room = limit * limit - base_square
    if square == 0.0:
        return 1.0
    if room <= 0.0:
        return 0.0
    share: float = (np.sqrt(inner * inner + square * room) - inner) / square
    return min(1.0, share)


@kernel
def correct_trim(
    trim_m_s: Array,
    expected_m_s: Array,
    allowed_m_s: Array,
    measured_m_s: Array,
    base_m_s: Array,
    commanded: Mask,
    yields: Mask,
    at_limit: Mask,
    dt_s: float,
    response_s: float,
    rate_per_s: Array,
    vertical_rate_per_s: Array,
    trim_max_m_s: float,
) -> tuple[Array, Array]:
    """Learn each vehicle's setpoint correction for wind, drag and its own response.

    Args:
        trim_m_s: (n, 3) so far.
        expected_m_s: (n, 3) velocity relative to the base that a vehicle with the measured response would
            have now, NaN at first.
        allowed_m_s: (n, 3) commanded velocity.
        measured_m_s: (n, 3).
        base_m_s: (n, 3) part of the commanded velocity that has a lead, and so is expected without lag.
        commanded: (n,) the trim of all others is reset.
        yields: (n,) the trim of these does not grow.
        at_limit: (n, 2) the setpoint meets a limit, sideways and up or down: there the trim does not grow.
        dt_s: since the last tick.
        response_s: time constant of the response.
        rate_per_s: (n,) of the correction, sideways.
        vertical_rate_per_s: (n,) of the correction, up and down.
        trim_max_m_s: in any direction.

    Returns: the next trim and expectation.
    """
    blend = 1.0 - np.exp(-dt_s / response_s)
    trim, expected = np.zeros_like(trim_m_s), np.full_like(expected_m_s, np.nan)
    before, after = np.empty(2), np.empty(2)  # squares, sideways and up or down
    for i in range(len(trim)):
        if not commanded[i]:
            continue
        before[:], after[:] = 0.0, 0.0
        for k in range(3):
            was = expected_m_s[i, k]
            if np.isnan(was):
                was = measured_m_s[i, k] - base_m_s[i, k]
            expected[i, k] = was + blend * (allowed_m_s[i, k] - base_m_s[i, k] - was)
            rate = vertical_rate_per_s[i] if k == 2 else rate_per_s[i]
            trim[i, k] = trim_m_s[i, k] + dt_s * rate * (base_m_s[i, k] + expected[i, k] - measured_m_s[i, k])
            before[k // 2] += trim_m_s[i, k] ** 2
            after[k // 2] += trim[i, k] ** 2
        for k in range(3):
            if (yields[i] or at_limit[i, k // 2]) and after[k // 2] > before[k // 2]:
                trim[i, k] = trim_m_s[i, k]
        size_m_s = np.sqrt(trim[i, 0] ** 2 + trim[i, 1] ** 2 + trim[i, 2] ** 2)
        share = min(1.0, trim_max_m_s / max(size_m_s, TINY))
        for k in range(3):
            trim[i, k] *= share
    return trim, expected


@kernel
def shared(formed: Mask, vector: Array) -> Array:
    """(n, 3) with the common vector (3,) in the rows in formation (n,), and 0 in the others."""
    vectors = np.zeros((len(formed), 3))
    for i in range(len(formed)):
        if formed[i]:
            for k in range(3):
                vectors[i, k] = vector[k]
    return vectors


@kernel
def most_lacking_m_s(
    way: Array,
    base_m_s: Array,
    expected_m_s: Array,
    measured_m_s: Array,
    formed: Mask,
    requested_m_s: Array,
    speed_max_m_s: Array,
    horizontal_max_m_s: float,
    pressed: float,
) -> float:
    """Largest lack of speed along the formation's direction, of the vehicles close to their limits.

    Args:
        way: (3,) velocity of the formation, not 0.
        base_m_s: (n, 3) part of each velocity that has a lead.
        expected_m_s: (n, 3) velocity relative to `base_m_s` that each should have.
        measured_m_s: (n, 3).
        formed: (n,) in formation; the others do not count.
        requested_m_s: (n, 3) setpoints before limits.
        speed_max_m_s: (n,) of each vehicle.
        horizontal_max_m_s: of all.
        pressed: share of its limit from which a setpoint has little reserve left.

    Returns: in m/s, 0 where no vehicle lacks any.
    """
    length_m_s = np.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    most_m_s = 0.0
    for i in range(len(formed)):
        limit_m_s = min(horizontal_max_m_s, speed_max_m_s[i])
        if not (formed[i] and np.hypot(requested_m_s[i, 0], requested_m_s[i, 1]) > pressed * limit_m_s):
            continue
        lack = 0.0
        for k in range(3):
            lack += (base_m_s[i, k] + expected_m_s[i, k] - measured_m_s[i, k]) * way[k]
        most_m_s = max(most_m_s, lack / length_m_s)
    return most_m_s
