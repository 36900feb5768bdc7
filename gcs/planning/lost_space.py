"""Where vehicles without a link are expected, and the space that they can reach. Pure; decision 0041."""

from collections import deque
from math import ceil

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
from gcs.model.setpoint_loss import STOP_S
from gcs.model.state import Array, Mask

TINY = 1e-6

DRIFT_S = 0.2 + 1.0 + STOP_S
"""Longest time that a vehicle without commands keeps its last velocity, with PX4's defaults: until the
watchdog ends its setpoints, until it notices (COM_OF_LOSS_T), and for its stop. Its last position is
already extrapolated by the 0.5 s after which it is not commanded any more.
"""

NEAR_HOME_M = 10.0
"""As near to home as this (RTL_MIN_DIST) PX4 may return as low as this (RTL_DESCEND_ALT)."""

SEEN_AHEAD_S = 0.5
"""Last positions are brought forward by so much (`gcs.estimation.fleet_state.FORWARD_MAX_S`)."""

ACTS_AFTER_S = 0.4
"""PX4 brakes so long after it notices the loss, as if evenly over 2 STOP_S."""

AHEAD_S = 3.0
"""In which the others leave the space that a silent vehicle can reach."""

AUTO_UP_M_S, AUTO_DOWN_M_S, AUTO_CRUISE_M_S = 3.0, 1.5, 5.0
"""PX4's defaults of MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN and MPC_XY_CRUISE: vehicles that fly by themselves."""

COLUMNS_APART_M = 2.6
"""Greatest distance between the columns along a drift: less than the width that each keeps free."""

OVERSHOOT_M = 1.0
"""A take-off may end this much too high."""


SENT_BEFORE_S = 0.2
"""A vehicle flew a setpoint this long before the position that it flew to with it arrives: 0.1 s each way."""

ALIKE_M_S = 1.0
"""A setpoint is a second possibility from this difference on: a lead of less is half gone when it brakes."""


class KeptSetpoints:
    """The velocities that each vehicle may keep when its link ends: PX4 flies on with its last setpoint.

    That is the one of SENT_BEFORE_S before the newest position. It aims at the desired velocity, and while a
    vehicle turns it leads it by more than that: where both differ much, either may be flown to. A vehicle
    that was not commanded keeps its last known velocity. Turning into its setpoint takes a vehicle about
    SEEN_AHEAD_S: from the position that was brought forward by as much with the last known velocity, it
    flies as if at the setpoint from the start.
    """

    def __init__(self, count: int) -> None:
        self._sent: deque[tuple[float, Array]] = deque()  # desired velocities and setpoints, (2, n, 3)
        self._seen_s = np.full(count, -np.inf)  # when the newest position was measured
        self._kept_m_s: Array = np.full((2, count, 3), np.nan)

    def note(
        self,
        desired_m_s: Array,
        setpoint_m_s: Array,
        age_s: Array,
        now_s: float,
        ended: Mask | None = None,
    ) -> None:
        """Begin a tick.

        Args:
            desired_m_s: (n, 3) desired velocities of the last tick, show frame; NaN: not commanded.
            setpoint_m_s: (n, 3) its setpoints for them, without the trim, which only offsets drag and wind.
            age_s: (n,) age of the newest position, inf: none.
            now_s: of this tick.
            ended: (n,) vehicles to which no station sends setpoints any more: they keep the newest.
        """
        now = np.empty((2, *desired_m_s.shape))
        now[0], now[1] = desired_m_s, setpoint_m_s
        self._sent.append((now_s, now))
        while len(self._sent) > 1 and self._sent[1][0] <= now_s - SENT_BEFORE_S + 1e-6:
            self._sent.popleft()
        flags = np.zeros(len(self._seen_s), np.bool_) if ended is None else ended
        _keep(self._kept_m_s, self._seen_s, self._sent[0][1], now, now_s - age_s, flags)

    def expected_m_s(self, last_velocity_m_s: Array) -> Array:
        """(n, 3) the most probable of them, from the (n, 3) last known velocities."""
        desired_m_s = self._kept_m_s[0]
        expected_m_s: Array = np.where(np.isfinite(desired_m_s), desired_m_s, last_velocity_m_s)
        return expected_m_s

    def possible_m_s(
        self, rows: NDArray[np.intp], last_velocity_m_s: Array
    ) -> tuple[NDArray[np.intp], Array]:
        """Return the velocities that some vehicles may keep: one or two of each, the most probable first.

        Args:
            rows: (k,) of the vehicles.
            last_velocity_m_s: (n, 3) last known velocities.

        Returns: (p,) the row of each velocity, in the order of `rows`, and (p, 3).
        """
        desired_m_s, setpoint_m_s = self._kept_m_s[:, rows]
        desired: Mask = np.asarray(np.isfinite(desired_m_s).all(axis=1))
        first_m_s = np.where(desired[:, None], desired_m_s, last_velocity_m_s[rows])
        differs = desired & (np.linalg.norm(setpoint_m_s - desired_m_s, axis=1) > ALIKE_M_S)
        takes = np.repeat(np.arange(len(rows)), 1 + differs)
        second = np.append(False, takes[1:] == takes[:-1])[: len(takes)]
        return rows[takes], np.where(second[:, None], setpoint_m_s[takes], first_m_s[takes])


@kernel
def _keep(
    kept_m_s: Array, seen_s: Array, then_m_s: Array, now_m_s: Array, measured_s: Array, ended: Mask
) -> None:
    """Take what each vehicle flew to when its newest position was measured, and the newest where `ended`.

    Args:
        kept_m_s: (2, n, 3) desired velocities and setpoints, changed.
        seen_s: (n,) when the position was measured that they belong to, changed.
        then_m_s: (2, n, 3) those of SENT_BEFORE_S ago.
        now_m_s: (2, n, 3) the newest.
        measured_s: (n,) when the newest position was measured.
        ended: (n,) vehicles that keep the newest.
    """
    for i in range(len(seen_s)):
        if measured_s[i] > seen_s[i] + 1e-6:
            seen_s[i] = measured_s[i]
            for of in range(2):
                for axis in range(3):
                    kept_m_s[of, i, axis] = then_m_s[of, i, axis]
        if ended[i]:
            for of in range(2):
                for axis in range(3):
                    kept_m_s[of, i, axis] = now_m_s[of, i, axis]


def warm_up() -> None:
    """Compile or load the kernel that every tick runs."""
    still = np.zeros((1, 3))
    KeptSetpoints(1).note(still, still, np.zeros(1), 0.0)


def return_heights_m(count: int, lowest_m: float, layer_m: float, highest_m: float) -> Array:
    """(n,) heights above home at which vehicles return by themselves, RTL_RETURN_ALT.

    The first vehicle in the list returns lowest, the last highest. In most of a sphere the vehicles of the
    outer pads fly above the others: listed last, they return above them, and none climbs through another's
    height (decision 0041). Neighbours in the list share a height where there are more vehicles than layers.

    Args:
        count: n vehicles.
        lowest_m: the lowest of the heights.
        layer_m: between two layers; 0: all return at the same height.
        highest_m: no layer is above; 0 or more.
    """
    room = int((highest_m - lowest_m) / layer_m + 1e-9) if layer_m and highest_m > lowest_m else 0
    layers = max(1, min(count, room + 1))
    layer = np.arange(count) * layers // max(count, 1)
    heights_m: Array = lowest_m + layer_m * layer.astype(np.float64)
    return heights_m


def swept_segments_m(
    last_m: Array,
    last_velocity_m_s: Array | None,
    home_m: Array | None,
    action: str,
    return_height_m: float,
    *,
    climbing_to_m: float | None = None,
    drift_s: float = DRIFT_S,
) -> Array:
    """Return the straight segments that a vehicle may fly by itself without commands.

    It keeps its last velocity for at most `drift_s`, stops somewhere on that path, and executes `action` from
    there. Columns stand at both ends, and between them so close that no vehicle can pass through.

    Args:
        last_m: (3,) last known position, show frame.
        last_velocity_m_s: (3,) last known velocity; None if unknown.
        home_m: (3,) its own start, if known.
        action: "descend" and "land": straight down; "hold": stays, and may come down later; "return":
            climbs to `return_height_m`, or near home less high (NEAR_HOME_M), flies home at that height and
            descends there.
        return_height_m: above its home (RTL_RETURN_ALT).
        climbing_to_m: above its home; a vehicle last seen lower may still climb to it (a take-off goes on
            without this service). None: it does not climb by itself.
        drift_s: see DRIFT_S.

    Returns: (m, 2, 3).
    """
    moves_m_s = np.zeros(3) if last_velocity_m_s is None else last_velocity_m_s
    places_m = stops_m(np.array(last_m), moves_m_s * drift_s)
    places_m[:, 2] = places_m[:, 2].min()
    lowest_z_m = max(0.0, float(last_m[2]))
    columns = [np.array([stop_m, (stop_m[0], stop_m[1], lowest_z_m)]) for stop_m in places_m]
    paths = [np.array([places_m[0], places_m[-1]])] if len(places_m) > 1 else []
    if climbing_to_m is not None and home_m is not None and home_m[2] - last_m[2] < climbing_to_m:
        top_m = home_m - (0.0, 0.0, climbing_to_m + OVERSHOOT_M)
        columns.append(np.array([top_m, home_m]))
    if action != "return" or home_m is None:
        return np.array([*columns, *paths])
    top_z_m = min(float(places_m[0, 2]), float(home_m[2]) - return_height_m)
    for stop_m in places_m:
        away_m = float(np.hypot(*(stop_m - home_m)[:2]))
        least_m = NEAR_HOME_M if away_m <= NEAR_HOME_M else return_height_m
        corner = np.array([stop_m[0], stop_m[1], top_z_m])
        paths.append(np.array([stop_m, corner]))
        levels_m = sorted({top_z_m, min(float(stop_m[2]), float(home_m[2]) - least_m)})
        paths += [np.array([(*stop_m[:2], z_m), (*home_m[:2], z_m)]) for z_m in levels_m]
    return np.array([*columns, *paths, np.array([(home_m[0], home_m[1], top_z_m), home_m])])


@kernel
def stops_m(last_m: Array, drift_m: Array) -> Array:
    """(k, 3) places along the (3,) drift, COLUMNS_APART_M apart at most; k is 1 without a level drift.

    The last place is that of the whole drift also where it only leads up or down. A drift that is not finite
    is none.
    """
    drifts = np.isfinite(drift_m[0]) and np.isfinite(drift_m[1]) and np.isfinite(drift_m[2])
    along_m = drift_m if drifts else np.zeros(3)
    steps = ceil(np.hypot(along_m[0], along_m[1]) / COLUMNS_APART_M)
    places_m = np.empty((steps + 1, 3))
    for at in range(steps + 1):
        share = 1.0 if at == steps else at * (1.0 / steps)
        for axis in range(3):
            places_m[at, axis] = last_m[axis] + share * along_m[axis]
    if steps == 0:
        places_m[0, :2] = last_m[:2]
        places_m[0, 2] = min(last_m[2], places_m[0, 2])
    return places_m


def expected_drift(
    last_m: Array,
    last_velocity_m_s: Array,
    silent_s: Array,
    rows: Mask,
    *,
    noticed_s: Array | float,
    stop_s: Array | float = STOP_S,
) -> tuple[Array, Array]:
    """Return where vehicles that fell silent a few seconds ago are expected, and how fast; NaN elsewhere.

    They keep their last velocity; ACTS_AFTER_S after they notice the loss they brake, evenly over 2 `stop_s`.
    The others keep clear of this estimate, too, until STOP_S after that: it moves as they do.

    Args:
        last_m: (n, 3) last known positions, brought forward by SEEN_AHEAD_S at most.
        last_velocity_m_s: (n, 3) last known velocities.
        silent_s: (n,) since the newest position; inf: unknown.
        rows: (n,) that are silent or lost.
        noticed_s: after this silence the vehicles act, (n,) or all (COM_OF_LOSS_T).
        stop_s: a vehicle stops as if it kept its last velocity for this time, (n,) or all.

    Returns: (n, 3) positions and (n, 3) velocities, show frame.
    """
    acts_s = np.broadcast_to(noticed_s + ACTS_AFTER_S, silent_s.shape)
    braking_s = np.broadcast_to(2.0 * np.asarray(stop_s), silent_s.shape)
    drifts = rows & (silent_s < acts_s + braking_s + STOP_S)
    since_s = np.where(drifts, silent_s, np.nan)
    brakes_s = np.clip(since_s - acts_s, 0.0, braking_s)
    flown_s = np.minimum(since_s, acts_s) + brakes_s - brakes_s**2 / (2.0 * braking_s)
    flown_s -= np.minimum(since_s, SEEN_AHEAD_S)
    velocity_m_s = last_velocity_m_s * (1.0 - brakes_s / braking_s)[:, None]
    return last_m + last_velocity_m_s * flown_s[:, None], velocity_m_s
