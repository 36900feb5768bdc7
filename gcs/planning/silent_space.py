"""The space that silent vehicles can reach soon, for all of them at once. Pure; decision 0041."""

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.setpoint_loss import STOP_S
from gcs.model.state import Array, Mask
from gcs.planning.lost_space import (
    AHEAD_S,
    AUTO_CRUISE_M_S,
    AUTO_DOWN_M_S,
    AUTO_UP_M_S,
    DRIFT_S,
    NEAR_HOME_M,
    SEEN_AHEAD_S,
    TINY,
    stops_m,
)


def silent_segments_m(
    last_m: Array,
    velocity_m_s: Array,
    home_m: Array,
    return_height_m: Array,
    silent_s: Array,
    *,
    action: NDArray[np.str_] | str,
    noticed_s: Array | float,
    drift_s: Array | float = DRIFT_S,
) -> tuple[Array, NDArray[np.intp]]:
    """Return the part of `swept_segments_m` that silent vehicles, not lost yet, can reach within AHEAD_S.

    A silence may end: only what the others could no longer avoid later is closed to them. It grows. Before
    a vehicle can have noticed the silence it flies on: `expected_drift` keeps the others apart from it.

    Args:
        last_m: (p, 3) last known positions, show frame.
        velocity_m_s: (p, 3) that each may keep; not finite: none. A vehicle may have several rows.
        home_m: (p, 3) where each started; NaN: not known.
        return_height_m: (p,) above its home.
        silent_s: (p,) since the newest position.
        action: see `swept_segments_m`, (p,) or of all; "hold" only drifts.
        noticed_s: after this silence, at the earliest, a vehicle executes `action` (COM_OF_LOSS_T);
            as `action`.
        drift_s: see DRIFT_S; as `action`.

    Returns: (m, 2, 3) segments, and (m,) the row of each among these p.
    """
    actions = np.broadcast_to(np.asarray(action, np.str_), len(last_m))
    returns, lands = actions == "return", (actions == "land") | (actions == "descend")
    times_s = np.empty((len(last_m), 2))
    times_s[:, 0], times_s[:, 1] = noticed_s, drift_s
    return _segments_m(last_m, velocity_m_s, home_m, return_height_m, silent_s, returns, lands, times_s)


@kernel
def _segments_m(
    last_m: Array,
    velocity_m_s: Array,
    home_m: Array,
    return_height_m: Array,
    silent_s: Array,
    returns: Mask,
    lands: Mask,
    times_s: Array,
) -> tuple[Array, NDArray[np.intp]]:
    """As `silent_segments_m`, of which `times_s` (p, 2) are the last two arguments."""
    found_m, of, count = np.empty((4 * len(last_m) + 4, 2, 3)), np.empty(4 * len(last_m) + 4, np.intp), 0
    for i in range(len(last_m)):
        noticed_s, drift_s = times_s[i, 0], times_s[i, 1]
        surely_s = min(max(noticed_s - SEEN_AHEAD_S, 0.0) + STOP_S / 2.0, drift_s)  # half of its usual stop
        first_m, moves_m_s = last_m[i].copy(), velocity_m_s[i]
        if np.isfinite(moves_m_s).all():
            first_m += moves_m_s * surely_s
        places_m = stops_m(first_m, moves_m_s * (drift_s - surely_s))
        many = len(places_m)
        while count + 4 * many > len(of):
            found_m = np.concatenate((found_m, np.empty_like(found_m)))
            of = np.concatenate((of, np.empty_like(of)))
        begun = count
        knows_home = np.isfinite(home_m[i]).all()
        acts_s = max(silent_s[i] + AHEAD_S - noticed_s, 0.0)
        to_climb_m = np.inf
        if knows_home:
            to_climb_m = max((places_m[0, 2] - home_m[i, 2]) + return_height_m[i], 0.0)
        up_m = min(AUTO_UP_M_S * acts_s, to_climb_m) if returns[i] else 0.0
        down_m = AUTO_DOWN_M_S * acts_s if lands[i] else 0.0
        top_z_m, bottom_z_m = places_m[:, 2].min() - up_m, places_m[:, 2].max() + down_m
        for at in range(many):
            found_m[count, :, :2] = places_m[at, :2]
            found_m[count, 0, 2], found_m[count, 1, 2] = top_z_m, bottom_z_m
            count += 1
        for at in range(many - 1):
            found_m[count, 0], found_m[count, 1] = places_m[at], places_m[at + 1]
            count += 1
        if returns[i] and knows_home:
            reach_m, climbed = AUTO_CRUISE_M_S * acts_s, up_m == to_climb_m
            count = _put_ways(last_m[i], places_m, home_m[i], top_z_m, reach_m, climbed, found_m, count)
        of[begun:count] = i
    return found_m[:count], of[:count]


@kernel
def _put_ways(
    last_m: Array,
    places_m: Array,
    home_m: Array,
    top_z_m: float,
    reach_m: float,
    climbed: bool,
    found_m: Array,
    count: int,
) -> int:
    """Write the ways home from (3,) the last position and (k, 3) places, if `climbed` from above these, too.

    Returns: the number of segments in `found_m`, of which `count` were there before.
    """
    for at in range(-1, len(places_m)):  # near home it may return without a climb
        level_m = last_m if at < 0 else places_m[at]
        if np.hypot(home_m[0] - level_m[0], home_m[1] - level_m[1]) <= NEAR_HOME_M:
            _put_way(level_m, home_m, level_m[2], reach_m, found_m[count])
            count += 1
    for at in range(len(places_m) if climbed else 0):
        _put_way(places_m[at], home_m, top_z_m, reach_m, found_m[count])
        count += 1
    return count


@kernel
def _put_way(begun_m: Array, home_m: Array, z_m: float, reach_m: float, segment_m: Array) -> None:
    """Write the level way from (3,) a place towards home, as far as it can be reached, to (2, 3)."""
    x_m, y_m = home_m[0] - begun_m[0], home_m[1] - begun_m[1]
    share = min(reach_m / max(np.hypot(x_m, y_m), TINY), 1.0)
    segment_m[0, 0], segment_m[0, 1] = begun_m[0], begun_m[1]
    segment_m[1, 0], segment_m[1, 1] = begun_m[0] + share * x_m, begun_m[1] + share * y_m
    segment_m[:, 2] = z_m


def warm_up() -> None:
    """Compile or load the kernels."""
    one_m, ones = np.ones((1, 3)), np.ones(1)
    silent_segments_m(one_m, one_m, one_m, ones, ones, action="return", noticed_s=1.0)
