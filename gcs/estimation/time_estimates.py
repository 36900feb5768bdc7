"""Estimates of remaining battery time and of the duration of maneuvers. Pure.

Nothing here commands anything. What is not known yet is NaN or None, never a guess.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.estimation.touch_down import SLOWLY_M_S
from gcs.model.state import Array, Mask

STEPS: Final = 100
"""A battery's charge is reported in whole percent."""

STEPS_BEFORE: Final = 3
"""Percent that must have been used, from the first change after take-off, before a rate is estimated."""

STEPS_BACK: Final = 10
"""The rate is the mean over at most this many percent: older use says less about the present."""

JUMP: Final = 5
"""A larger change at once is no discharge but a recalculation or another battery: the history is cleared."""

SETTLES_S: Final = 5.0
"""After take-off the voltage, and with it the reported charge, drops as the motors start, without use."""

TOP_SHARE: Final = 0.8
"""Of the radius: height of the highest slot above the centre, with more than three vehicles."""

CLIMB_M_S: Final = 1.0
"""On average, from the take-off command until the height is reached (PX4's MPC_TKO_SPEED is 1.5)."""

ARMS_S: Final = 2.5
"""From the arm command until the motors lift."""

JOINS_S: Final = 2.0
"""From the end of the last take-off until all follow setpoints."""

STOPS_S: Final = 2.5
"""At the start of a collective return all vehicles stop and their paths are planned."""

SLANT_SHARE: Final = 0.25
"""Of the shorter of both: paths home slant, but not over their whole length."""

TOUCHES_DOWN_M_S: Final = 0.6
"""The autopilot's own landing, from the handover height."""

SEEN_DOWN_S: Final = 5.0
"""From the touch-down until the motors are off: PX4's land detector (3 s), then COM_DISARM_LAND (2 s)."""


class BatteryHistory:
    """When each vehicle's reported charge first fell to each percent, since its take-off. n vehicles."""

    def __init__(self, n: int) -> None:
        self._reached_s = np.full(
            (n, STEPS + 1), np.nan
        )  # at row i, column p: when i first reported p percent
        self._lowest = np.full(n, STEPS + 1, dtype=np.int64)  # percent; STEPS + 1: nothing noted
        self._first = np.full(n, -1, dtype=np.int64)  # the first change after take-off; -1: none yet
        self._since_s = np.full(n, np.nan)  # take-off
        self._rows = np.arange(n)

    def note(self, remaining: Array, flying: Mask, now_s: float) -> None:
        """Add the reported charges.

        Args:
            remaining: (n,) 0 to 1, NaN where nothing is known.
            flying: (n,) in the air and received; a vehicle that lands starts a new history with its next
            take-off.
            now_s: any monotonic clock, s.
        """
        begins = flying & np.isnan(self._since_s)
        self._since_s[begins] = now_s
        self._since_s[~flying] = np.nan
        self._reached_s[~flying] = np.nan
        self._lowest[~flying], self._first[~flying] = STEPS + 1, -1
        measured = flying & np.isfinite(remaining) & (now_s - self._since_s >= SETTLES_S)
        percent = np.clip(np.ceil(STEPS * np.where(measured, remaining, 1.0) - 1e-6), 0, STEPS).astype(
            np.int64
        )
        falls = measured & (percent < self._lowest)
        for row in np.flatnonzero(falls).tolist():  # rare: once for each percent of each vehicle
            self._fell(row, int(percent[row]), now_s)

    def _fell(self, row: int, percent: int, now_s: float) -> None:
        before = int(self._lowest[row])
        if before <= STEPS and before - percent > JUMP:
            self._reached_s[row] = np.nan
            self._first[row] = percent
        elif before <= STEPS and self._first[row] < 0:
            self._first[row] = percent
        self._reached_s[row, percent : min(before, STEPS + 1)] = now_s
        self._lowest[row] = percent

    def rate_per_s(self, now_s: float) -> Array:
        """(n,) share of a whole battery used in a second; NaN until enough has been used to estimate it."""
        has_rate = (self._first >= 0) & (self._first - self._lowest >= STEPS_BEFORE)
        lowest = np.where(has_rate, self._lowest, 0)
        since = np.where(has_rate, np.minimum(self._first, lowest + STEPS_BACK), 1)
        since_s, until_s = self._reached_s[self._rows, since], self._reached_s[self._rows, lowest]
        used = (since - lowest) / STEPS
        with np.errstate(divide="ignore", invalid="ignore"):
            # the longer the next change does not come, the slower the use
            rate = np.minimum(used / (until_s - since_s), (used + 1.0 / STEPS) / (now_s - since_s))
        return np.where(has_rate & np.isfinite(rate) & (rate > 0.0), rate, np.nan)

    def left_s(self, down_to: float, now_s: float) -> Array:
        """(n,) time until `down_to` (0 to 1) of a battery is left, at least 0; NaN where it is not known."""
        rate = self.rate_per_s(now_s)
        has_rate = np.isfinite(rate)
        lowest = np.where(has_rate, self._lowest, 0)
        at_s = np.where(has_rate, self._reached_s[self._rows, lowest], 0.0)
        used = np.clip(rate * (now_s - at_s), 0.0, 1.0 / STEPS)
        return np.asarray(np.maximum(lowest / STEPS - used - down_to, 0.0) / rate)


@dataclass(frozen=True, slots=True, eq=False)
class Estimates:
    """Energy and time of one fleet, n vehicles; refreshed once a second."""

    low_s: Array  # (n,) until the low-battery threshold, 0 below it; NaN: not known
    empty_s: Array  # (n,) until the battery is empty; NaN: not known
    battery_least: float | None  # 0 to 1, of the flying vehicles; where none flies, of all that report
    battery_least_row: int | None
    battery_median: float | None
    low_row: int | None  # the vehicle that reaches the threshold first
    assembled_s: float | None  # until the formation stands; None: none is being formed, or it is not known
    home_s: float | None  # until all are down at their pads, if the return began now, or until it ends


def nothing(n: int) -> Estimates:
    unknown = np.full(n, np.nan)
    return Estimates(unknown, unknown, None, None, None, None, None, None)


def batteries(
    history: BatteryHistory, remaining: Array, flying: Mask, received: Mask, below: float, now_s: float
) -> Estimates:
    """Estimates of the batteries; without durations of maneuvers.

    Args:
        history: that has noted `remaining`.
        remaining: (n,) 0 to 1, NaN where nothing is known.
        flying: (n,) in the air and received.
        received: (n,) with fresh telemetry.
        below: threshold of the low-battery failsafe, 0 to 1.
        now_s: the clock of `history`.
    """
    counted = np.isfinite(remaining) & (flying if flying.any() else received)
    rows = np.flatnonzero(counted)
    low_s, empty_s = history.left_s(below, now_s), history.left_s(0.0, now_s)
    low_s[counted & (remaining <= below)] = 0.0  # whatever the rate until then
    estimated = np.flatnonzero(np.isfinite(low_s))
    least = int(rows[np.argmin(remaining[rows])]) if len(rows) else None
    return Estimates(
        low_s=low_s,
        empty_s=empty_s,
        battery_least=None if least is None else float(remaining[least]),
        battery_least_row=least,
        battery_median=float(np.median(remaining[rows])) if len(rows) else None,
        low_row=int(estimated[np.argmin(low_s[estimated])]) if len(estimated) else None,
        assembled_s=None,
        home_s=None,
    )


def approach_s(distance_m: Array, speed_m_s: float, rate_per_s: float, within_m: float) -> Array:
    """(n,) time to come within `within_m` with the rate `rate_per_s` and at most `speed_m_s`.

    Far away at the speed; nearer than speed / rate, the distance decays.
    """
    slows_m = max(speed_m_s / rate_per_s, within_m)
    fast_s = np.maximum(distance_m - slows_m, 0.0) / speed_m_s
    slow_m = np.minimum(distance_m, slows_m)
    return np.asarray(fast_s + np.log(np.maximum(slow_m / within_m, 1.0)) / rate_per_s)


@dataclass(frozen=True, slots=True)
class Speeds:
    """Speeds of vehicles under the law, m/s, and the rates at which distances decay, 1/s."""

    level_m_s: float
    up_m_s: float
    down_m_s: float
    slot_m_s: float  # to a slot on the sphere
    slot_rate_per_s: float
    radius_m_s: float  # change of the sphere's radius
    climb_m_s: float  # of the centre


def to_slots_s(position_m: Array, slot_m: Array, within_m: float, speeds: Speeds) -> float:
    """Time until the last of n vehicles is within `within_m` of its slot; 0 for none. (n, 3) show frame."""
    if len(position_m) == 0:
        return 0.0
    way_m = slot_m - position_m
    distance_m = np.linalg.norm(way_m, axis=1)
    nearly_s = approach_s(distance_m, speeds.slot_m_s, speeds.slot_rate_per_s, within_m)
    vertical_m = np.maximum(np.abs(way_m[:, 2]) - within_m, 0.0)
    vertical_s = vertical_m / np.where(way_m[:, 2] < 0.0, speeds.up_m_s, speeds.down_m_s)
    return float(np.maximum(nearly_s, vertical_s).max())


def to_sphere_s(
    position_m: Array, center_m: Array, radius_m: float, within_m: float, speeds: Speeds
) -> float:
    """The same for vehicles without a slot: to the sphere, and up to its highest slots. (n, 3), (3,)."""
    if len(position_m) == 0:
        return 0.0
    off_m = np.abs(np.linalg.norm(position_m - center_m, axis=1) - radius_m)
    nearly_s = approach_s(off_m, speeds.slot_m_s, speeds.slot_rate_per_s, within_m)
    up_m = float(position_m[:, 2].max() - center_m[2]) + TOP_SHARE * radius_m - within_m
    return max(float(nearly_s.max()), up_m / speeds.up_m_s)


def take_off_s(waiting: int, stagger_s: float, climbs_m: Array) -> float:
    """Time until all follow setpoints: `waiting` start one by one, `climbs_m` (n,) is still to climb."""
    queue_s = (waiting - 1) * stagger_s + ARMS_S if waiting else 0.0
    return queue_s + float(np.maximum(climbs_m, 0.0).max(initial=0.0)) / CLIMB_M_S + JOINS_S


def home_s(
    position_m: Array,
    home_m: Array,
    over_m: float,
    handover_m: float,
    speeds: Speeds,
    *,
    standing: bool,
    slow_from_m: Array | float = 0.0,
) -> float | None:
    """Time until n vehicles are down at their pads; None for none, or where a position or a pad is unknown.

    Args:
        position_m: (n, 3) show frame.
        home_m: (n, 3) pads.
        over_m: height above the pads that all keep on their way.
        handover_m: height above the pad from which the autopilot lands.
        speeds: of the law.
        standing: whether they are on their way already; else they stop first, and their paths are planned.
        slow_from_m: (n,) height above the pad from which each descends slowly, if above `handover_m`.
    """
    slow_from_m, way_m = np.maximum(slow_from_m, handover_m), home_m - position_m
    if len(way_m) == 0 or not np.isfinite(way_m).all():
        return None
    level_s = np.hypot(way_m[:, 0], way_m[:, 1]) / speeds.level_m_s
    height_m = way_m[:, 2]
    climb_s = np.where(level_s > 1.0, np.maximum(over_m - height_m, 0.0), 0.0) / speeds.up_m_s
    down_s = (
        np.maximum(np.maximum(height_m, climb_s * speeds.up_m_s + height_m) - slow_from_m, 0.0)
        / speeds.down_m_s
    )
    touch_s = np.clip(height_m, 0.0, handover_m) / TOUCHES_DOWN_M_S
    touch_s += np.maximum(np.minimum(height_m, slow_from_m) - handover_m, 0.0) / SLOWLY_M_S
    both_s = np.maximum(level_s, down_s) + SLANT_SHARE * np.minimum(level_s, down_s)
    flight_s = climb_s + both_s + touch_s
    begins_s = 0.0 if standing else STOPS_S
    return begins_s + float(flight_s.max()) + SEEN_DOWN_S
