"""Finds positions that their own content shows to be wrong, though they are fresh.

A position that stands while the vehicle moves: a telemetry radio, a companion computer or an estimator that
repeats itself. A position that does not go where the velocity leads: one of the two is wrong. Autopilots
report positions in centimetres and heights in millimetres, and no estimator repeats all three in flight: an
equal position is a repeated one.
"""

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.jit import kernel
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
"""Of a difference up, which counts so much less: heights are twice as uncertain."""

STRAYS_S: Final = 1.5
"""Time constant with which that is forgotten."""

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


@kernel
def _doubt(
    was: int, repeats: int, held_for_s: float, leads_m: tuple[Array, Array, Array], late_s: float
) -> int:
    """`Doubt` of a vehicle that had `was`, by its columns as of `Contradictions`."""
    travel_m, owed_m, strayed_m = leads_m
    if late_s > (LATE_S / 2.0 if was == Doubt.LATE else LATE_S):
        return Doubt.LATE
    if repeats >= REPEATS and _length_m(travel_m) > TRAVEL_M:
        return Doubt.STANDS
    if held_for_s >= ANSWER_S and _length_m(owed_m) > COMMANDED_M:
        return Doubt.STANDS_COMMANDED
    off_m = np.sqrt(strayed_m[0] ** 2 + strayed_m[1] ** 2 + (UP_SHARE * strayed_m[2]) ** 2)
    if off_m > (STRAYS_M / 2.0 if was == Doubt.STRAYS else STRAYS_M):
        return Doubt.STRAYS
    if held_for_s > 0.0 and was in (Doubt.STANDS, Doubt.STANDS_COMMANDED):
        return was  # until it moves
    return Doubt.NONE


@kernel
def _compare(
    dt_s: float,
    reported: tuple[Array, Array, Array, Mask, Array],
    asked_m_s: Array,
    before: tuple[Array, Array, Array, NDArray[np.int64], Array, Array, Array, Array],
    doubts: Doubts,
) -> None:
    """As `Contradictions.look`.

    Args:
        dt_s: since the last tick.
        reported: positions and velocities (n, 3), times of arrival (n,), which are armed (n,), and how late
            positions are (n,).
        asked_m_s: (n, 3) setpoints, NaN: not commanded.
        before: columns of `Contradictions`; written, as is `doubts`.
        doubts: (n,).
    """
    position_m, velocity_m_s, time_s, armed, late_s = reported
    last_m, last_m_s, last_s, repeats, held_s, travel_m, owed_m, strayed_m = before
    for i in range(len(time_s)):
        if np.isfinite(asked_m_s[i]).all():
            owed_m[i] += dt_s * asked_m_s[i]
        if time_s[i] > last_s[i]:
            since_s, stepped_m = time_s[i] - last_s[i], position_m[i] - last_m[i]
            led_m = 0.5 * since_s * (velocity_m_s[i] + last_m_s[i])
            if (stepped_m == 0.0).all():
                repeats[i] += _length_m(led_m) > MOVES_M
                travel_m[i] += led_m
            else:  # also where one of them is unknown
                repeats[i], held_s[i], travel_m[i], owed_m[i] = 0, time_s[i], 0.0, 0.0
            off_m = stepped_m - led_m
            strayed_m[i] *= np.exp(-since_s / STRAYS_S)
            length_m, turned_m = _length_m(off_m), 0.5 * TURNS_M_S2 * since_s * since_s
            if since_s <= GAP_S and turned_m < length_m <= SUDDEN_M + SUDDEN_M_S * since_s:
                strayed_m[i] += (1.0 - turned_m / length_m) * off_m
            last_m[i], last_m_s[i], last_s[i] = position_m[i], velocity_m_s[i], time_s[i]
        held_for_s = last_s[i] - held_s[i]
        leads_m = travel_m[i], owed_m[i], strayed_m[i]
        doubt = _doubt(doubts[i], repeats[i], held_for_s, leads_m, late_s[i])
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
        self._last = np.full((count, 3), np.nan), np.zeros((count, 3)), np.full(count, -np.inf)
        self._repeats = np.zeros(count, np.int64)
        self._moved = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
        self._now_s = np.nan

    def look(self, now_s: float, reported: tuple[Array, Array, Array, Mask, Array], asked_m_s: Array) -> None:
        """Compare the newest telemetry, once a tick.

        Args:
            now_s: of this tick.
            reported: positions and velocities (n, 3), show frame, NaN unknown; their times of arrival (n,),
                -inf before the first; which vehicles are armed (n,); and how late positions are (n,).
            asked_m_s: (n, 3) setpoints of the last tick; NaN: not commanded.
        """
        dt_s = 0.0 if np.isnan(self._now_s) else max(now_s - self._now_s, 0.0)
        self._now_s = now_s
        self.doubts, self.held_s = self.doubts.copy(), self.held_s.copy()  # holders of the old ones keep them
        before = (*self._last, self._repeats, self.held_s, *self._moved)
        _compare(dt_s, reported, np.array(asked_m_s), before, self.doubts)
