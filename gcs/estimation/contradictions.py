"""Finds positions that their own content shows to be wrong, though they are fresh.

A position that stands while the vehicle moves: a telemetry radio, a companion computer or an estimator that
repeats itself. A position that does not go where the velocity leads: one of the two is wrong. Autopilots
report positions in centimetres and heights in millimetres, and no estimator repeats all three in flight: an
equal position is a repeated one. One axis alone may stand for a while, but not against setpoints.

Links that stood deliver what waited at once, so that the time between two arrivals says little. The vehicle's
own clock is in its messages: what either time explains is no contradiction.
"""

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel, kernel_within
from gcs.model.state import Array, Mask


class Doubt(IntEnum):
    """Why a position is not believed, by its content."""

    NONE = 0
    STANDS = 1  # though the vehicle reports that it moves
    STANDS_COMMANDED = 2  # though setpoints move the vehicle
    STRAYS = 3  # from where the velocity leads
    LATE = 4  # as its vehicle's clock, answers and other messages show: older than its arrival says


Doubts = NDArray[np.int64]

REPEATS, MOVES_M = 2, 0.01
"""A position that arrived so often again, each time with a velocity that leads so far, is a repeated one."""

TRAVEL_M: Final = 0.1
"""By its velocities the vehicle has left the position that it repeats: far above the last digit."""

ANSWER_S, COMMANDED_M = 1.0, 1.0
"""As TRAVEL_M, by setpoints: later, since a vehicle answers late, and farther, since it may lag."""

STRAYS_M: Final = 1.3
"""How far positions may go from where velocities lead: estimators drift by a few dm within STRAYS_S."""

UP_SHARE: Final = 0.5
"""Of such a difference up, which counts so much less: heights are twice as uncertain."""

STRAYS_S: Final = 1.5
"""Time constant with which that is forgotten."""

DRIFTS_M, DRIFTS_S = 3.2, 8.0
"""The same of slow drifts, up as sideways. Estimates recorded of PX4 without corrections go up to 2.5 m."""

ACCURATE_M: Final = 1.0
"""Of a receiver that reports a worse accuracy, a slow drift may be that many times as far."""

AXIS_M, AXIS_ANSWER_S = 0.002, 1.5
"""One axis stands if it moves by no more, far below its last digit, while setpoints lead along it so long."""

LEADS_M: Final = 0.2
"""From here on setpoints lead away along an axis."""

BURST_S: Final = 2.0
"""By the vehicle's clock at most so much more time passes between two positions than between arrivals."""

GAP_S: Final = 0.5
"""Two positions with so much time between them are not compared: the velocity between them is unknown."""

TURNS_M_S2: Final = 4.0
"""By so much a vehicle may accelerate between two positions: what that explains is no contradiction."""

SUDDEN_M, SUDDEN_M_S = 1.5, 2.0
"""A step off by more than this and this speed is a jump, which is judged as one, and not a drift."""


LATE_S: Final = 0.6
"""The slowest link that is flown with: what is later by as much than it could be is not flown on."""


@kernel
def _length_m(way_m: Array) -> float:
    length_m: float = np.sqrt(way_m[0] * way_m[0] + way_m[1] * way_m[1] + way_m[2] * way_m[2])
    return length_m


@kernel_within
def explaining_s(step_m: Array, mean_m_s: Array, since_s: float, by_clock_s: float) -> float:
    """Time over which a velocity explains more of a step: between arrivals, or by the vehicle's clock.

    Args:
        step_m: (3,) from one position to the next.
        mean_m_s: (3,) reported velocity between them.
        since_s: between their arrivals.
        by_clock_s: by the vehicle's own clock; NaN where it is not known.
    """
    off, off_by_clock = 0.0, 0.0
    for axis in range(3):
        off += (step_m[axis] - since_s * mean_m_s[axis]) ** 2
        off_by_clock += (step_m[axis] - by_clock_s * mean_m_s[axis]) ** 2
    runs = (by_clock_s > 0.0) & (by_clock_s <= since_s + BURST_S)
    return by_clock_s if runs and off_by_clock < off else since_s


@kernel_within
def _is_stuck(
    i: int,
    dt_s: float,
    position_m: Array,
    asked_m_s: Array,
    axis_m: Array,
    pushed_m: Array,
    pushed_s: Array,
) -> bool:
    """Whether row `i` stands along an axis though setpoints lead along it; the last three are written.

    Args:
        i: row of what follows, (n, 3) each.
        dt_s: since the last tick.
        position_m: as reported.
        asked_m_s: setpoints, NaN: not commanded.
        axis_m: where the axes stand.
        pushed_m: how far setpoints have led along each since.
        pushed_s: for how long it has been more than LEADS_M.
    """
    stuck = False
    for axis in range(3):
        if not abs(position_m[i, axis] - axis_m[i, axis]) <= AXIS_M:  # also the first
            axis_m[i, axis], pushed_m[i, axis] = position_m[i, axis], 0.0
        elif np.isfinite(asked_m_s[i, axis]):
            pushed_m[i, axis] += dt_s * asked_m_s[i, axis]
        led_m = abs(pushed_m[i, axis])
        pushed_s[i, axis] = pushed_s[i, axis] + dt_s if led_m > LEADS_M else 0.0
        stuck |= led_m > COMMANDED_M and pushed_s[i, axis] >= AXIS_ANSWER_S
    return stuck


@kernel
def _doubt(
    was: int,
    repeats: int,
    held_for_s: float,
    leads_m: tuple[Array, Array, Array, Array],
    stuck: bool,
    late_s: float,
    drifts_m: float,
) -> int:
    """`Doubt` of a vehicle that had `was`, by its columns as of `Contradictions`; `drifts_m`: its bound."""
    travel_m, owed_m, strayed_m, drifted_m = leads_m
    if late_s > (LATE_S / 2.0 if was == Doubt.LATE else LATE_S):
        return Doubt.LATE
    if repeats >= REPEATS and _length_m(travel_m) > TRAVEL_M:
        return Doubt.STANDS
    if stuck or (held_for_s >= ANSWER_S and _length_m(owed_m) > COMMANDED_M):
        return Doubt.STANDS_COMMANDED
    off_m = np.sqrt(strayed_m[0] ** 2 + strayed_m[1] ** 2 + (UP_SHARE * strayed_m[2]) ** 2)
    share = 0.5 if was == Doubt.STRAYS else 1.0
    if off_m > share * STRAYS_M or _length_m(drifted_m) > share * drifts_m:
        return Doubt.STRAYS
    if held_for_s > 0.0 and was in (Doubt.STANDS, Doubt.STANDS_COMMANDED):
        return was  # until it moves
    return Doubt.NONE


@kernel
def _compare(
    dt_s: float,
    reported: tuple[Array, Array, Array, Mask, Array, Array, Array],
    asked_m_s: Array,
    before: tuple[
        Array, Array, Array, Array, NDArray[np.int64], Array, Array, Array, Array, Array, Array, Array, Array
    ],
    doubts: Doubts,
) -> None:
    """As `Contradictions.look`.

    Args:
        dt_s: since the last tick.
        reported: as there.
        asked_m_s: (n, 3) setpoints, NaN: not commanded.
        before: columns of `Contradictions`; written, as is `doubts`.
        doubts: (n,).
    """
    position_m, velocity_m_s, time_s, armed, late_s, clock_s, accuracy_m = reported
    last_m, last_m_s, last_s, last_clock_s, repeats, held_s, travel_m, owed_m = before[:8]
    strayed_m, drifted_m, axis_m, pushed_m, pushed_s = before[8:]
    for i in range(len(time_s)):
        if np.isfinite(asked_m_s[i]).all():
            owed_m[i] += dt_s * asked_m_s[i]
        stuck = _is_stuck(i, dt_s, position_m, asked_m_s, axis_m, pushed_m, pushed_s)
        if time_s[i] > last_s[i]:
            since_s, stepped_m = time_s[i] - last_s[i], position_m[i] - last_m[i]
            mean_m_s = 0.5 * (velocity_m_s[i] + last_m_s[i])
            if (stepped_m == 0.0).all():
                repeats[i] += _length_m(since_s * mean_m_s) > MOVES_M
                travel_m[i] += since_s * mean_m_s
            else:  # also where one of them is unknown
                repeats[i], held_s[i], travel_m[i], owed_m[i] = 0, time_s[i], 0.0, 0.0
            since_s = explaining_s(stepped_m, mean_m_s, since_s, clock_s[i] - last_clock_s[i])
            off_m = stepped_m - since_s * mean_m_s
            strayed_m[i] *= np.exp(-since_s / STRAYS_S)
            drifted_m[i] *= np.exp(-since_s / DRIFTS_S)
            length_m, turned_m = _length_m(off_m), 0.5 * TURNS_M_S2 * since_s * since_s
            if since_s <= GAP_S and length_m <= SUDDEN_M + SUDDEN_M_S * since_s:
                drifted_m[i] += off_m  # turns to and fro add up to nothing
                if turned_m < length_m:
                    strayed_m[i] += (1.0 - turned_m / length_m) * off_m
            last_m[i], last_m_s[i], last_s[i] = position_m[i], velocity_m_s[i], time_s[i]
            last_clock_s[i] = clock_s[i]
        held_for_s = last_s[i] - held_s[i]
        leads_m = travel_m[i], owed_m[i], strayed_m[i], drifted_m[i]
        drifts_m = DRIFTS_M * np.fmax(accuracy_m[i] / ACCURATE_M, 1.0)
        doubt = _doubt(doubts[i], repeats[i], held_for_s, leads_m, stuck, late_s[i], drifts_m)
        doubts[i] = doubt if armed[i] else Doubt.NONE
        if doubts[i] == Doubt.LATE:
            held_s[i] = last_s[i] - late_s[i]


class Contradictions:
    """Which of n vehicles' newest positions contradict what else is known. Of armed vehicles only.

    Attributes:
        doubts: (n,) `Doubt` of each.
        held_s: (n,) since when each position is the same: the last one that was new arrived then, or would
            have if it were not late.
    """

    def __init__(self, count: int) -> None:
        self.doubts: Doubts = np.zeros(count, np.int64)
        self.held_s = np.full(count, -np.inf)
        self._last_m, self._last_m_s = np.full((count, 3), np.nan), np.zeros((count, 3))
        self._last_s, self._last_clock_s = np.full(count, -np.inf), np.full(count, np.nan)
        self._repeats = np.zeros(count, np.int64)
        self._travel_m, self._owed_m = np.zeros((count, 3)), np.zeros((count, 3))
        self._strayed_m, self._drifted_m = np.zeros((count, 3)), np.zeros((count, 3))
        self._axis_m = np.full((count, 3), np.nan)
        self._pushed_m, self._pushed_s = np.zeros((count, 3)), np.zeros((count, 3))
        self._now_s = np.nan

    def look(
        self,
        now_s: float,
        reported: tuple[Array, Array, Array, Mask, Array, Array, Array],
        asked_m_s: Array,
    ) -> None:
        """Compare the newest telemetry, once a tick.

        Args:
            now_s: of this tick.
            reported: positions and velocities (n, 3), show frame, NaN unknown; their times of arrival (n,),
                -inf before the first; which vehicles are armed (n,); how late positions are (n,); the
                vehicle's own clock as each was sent, and the accuracy its receiver reports, NaN unknown (n,).
            asked_m_s: (n, 3) setpoints of the last tick; NaN: not commanded.
        """
        dt_s = 0.0 if np.isnan(self._now_s) else max(now_s - self._now_s, 0.0)
        self._now_s = now_s
        self.doubts, self.held_s = self.doubts.copy(), self.held_s.copy()  # holders of the old ones keep them
        last = self._last_m, self._last_m_s, self._last_s, self._last_clock_s
        leads = self._travel_m, self._owed_m, self._strayed_m, self._drifted_m
        pushed = self._axis_m, self._pushed_m, self._pushed_s
        before = (*last, self._repeats, self.held_s, *leads, *pushed)
        _compare(dt_s, reported, np.array(asked_m_s), before, self.doubts)
