"""Each vehicle's link: share of telemetry that arrives, gaps between setpoints, signs of life.

Pure; times are given. Rows are as in FleetState.
"""

from math import inf, isfinite
from typing import Final

import numpy as np

from gcs.model.jit import kernel
from gcs.model.state import TINY, Array, Mask

QUALITY_OVER_S: Final = 5.0
"""Age at which an arrival counts by 1/e."""


class LinkQuality:
    """The share of requested positions that arrive, from the newest arrivals once a tick."""

    def __init__(self, expected_hz: Array) -> None:
        """`expected_hz` (n,): rates of positions requested, each above 0 and at most the rate of `note`."""
        self._expected_hz = expected_hz
        self._rate_hz = np.zeros_like(expected_hz)
        self._weight = np.zeros_like(expected_hz)  # of what the rate averages: 1 long after the first arrival
        self._arrival_s = np.full_like(expected_hz, -np.inf)
        self._time_s: float | None = None

    def note(self, arrival_s: Array, now_s: float) -> None:
        """Add the arrival of each vehicle's newest position: (n,), -inf before the first."""
        before_s, self._time_s = self._time_s, now_s
        arrived, self._arrival_s = arrival_s > self._arrival_s, arrival_s
        if before_s is None or now_s <= before_s:
            return
        elapsed_s = now_s - before_s
        weight = -np.expm1(-elapsed_s / QUALITY_OVER_S)
        has_arrived = arrival_s > -np.inf
        self._rate_hz = self._rate_hz + weight * (arrived / elapsed_s - self._rate_hz)
        self._weight = self._weight + weight * (has_arrived - self._weight)

    @property
    def share(self) -> Array:
        """(n,) from 0 to 1, since the first position or over QUALITY_OVER_S; 0 before the first."""
        rate_hz = self._rate_hz / np.maximum(self._weight, TINY)
        share: Array = np.minimum(1.0, rate_hz / self._expected_hz)
        return share


GAP_COUNTS_S: Final = 10.0
"""A failsafe shows in a heartbeat, seconds after the gap that caused it where heartbeats are lost."""


class SetpointGaps:
    """Recent times in which this station could send a vehicle no setpoint: a stall of the station leaves one.

    A tick that sends none because the vehicle's position is too old is no gap: the link lost the position.
    """

    def __init__(self, count: int) -> None:
        self._last_s = np.nan  # the last tick
        self._commanded = np.zeros(count, dtype=np.bool_)  # ever
        self._gap_s, self._ended_s = np.zeros(count), np.full(count, -np.inf)  # the longest recent one

    def note(self, commanded: Mask, left: Mask, now_s: float) -> None:
        """Begin a tick at `now_s`.

        Args:
            commanded: (n,) vehicles to which the last tick sent a setpoint.
            left: (n,) vehicles that were outside control in the last tick: theirs stays the gap before that.
            now_s: time of this tick.
        """
        _note_gaps(commanded, left, now_s, self._last_s, self._gap_s, self._ended_s, self._commanded)
        self._last_s = now_s

    def longest_s(self, row: int) -> float:
        """The longest gap of the last GAP_COUNTS_S, or before it left control; NaN: never commanded."""
        return float(self._gap_s[row]) if self._commanded[row] else np.nan


@kernel
def _note_gaps(
    commanded: Mask, left: Mask, now_s: float, last_s: float, longest_s: Array, ended_s: Array, ever: Mask
) -> None:
    """As `SetpointGaps.note`; the last three (n,) are changed."""
    gap_s = now_s - last_s  # NaN in the first tick
    for i in range(len(commanded)):
        counts = not left[i] and (gap_s >= longest_s[i] or now_s - ended_s[i] > GAP_COUNTS_S)
        if counts:
            longest_s[i] = gap_s if np.isfinite(gap_s) else 0.0
        if counts or left[i]:
            ended_s[i] = now_s
        ever[i] |= commanded[i]


BEATS_MAY_LACK_S: Final = 1.5
"""Heartbeats come once a second: a single missing one means nothing. A vehicle on the ground is offline after
`operation.silence_s` and this, and one in the air is reported.
"""

BEATS_LACK_MAX_S: Final = 8.0
"""A vehicle in the air is lost after `operation.silence_s` and this. Where a fifth of all messages is lost,
ten heartbeats in a row are lost once in ten million.
"""

ARRIVES_S: Final = 1.0
"""An autopilot sends several messages a second: when the newest is older, none arrives."""


@kernel
def is_silent(
    now_s: float, life_s: float, beat_s: float, position_s: float, silence_s: float, judged_s: float
) -> bool:
    """Whether a vehicle is silent: a sign of life is older than `silence_s`, or has never arrived.

    The only rule for it: phases, failsafes and alarms follow from this.

    Args:
        now_s: of this tick.
        life_s: arrival of any message from its autopilot, -inf before the first.
        beat_s: arrival of its newest heartbeat, with the time by which the next may be late added.
        position_s: arrival of its newest position.
        silence_s: `operation.silence_s`; a sign of exactly this age is fresh.
        judged_s: the longest silence that can be known: after a stall messages may not be read yet.
    """
    age_s = now_s - np.minimum(np.minimum(life_s, position_s), beat_s)  # NaN where one is
    return not np.minimum(age_s, judged_s) <= silence_s


@kernel
def signs_of_life(
    now_s: float,
    life_s: Array,
    beat_s: Array,
    position_s: Array,
    position_m: Array,
    may_lack_s: Array,
    absent: Mask,
    silence_s: float,
    judged_s: float,
) -> tuple[Mask, Mask, Mask, Mask]:
    """Which vehicles are seen; are silent; have sent a heartbeat lately; and every sign of life lately.

    Those are seen that have a position and are not silent, whatever can be known after a stall.

    Args:
        now_s: of this tick.
        life_s: (n,) as of `is_silent`, and so is `position_s`.
        beat_s: (n,) arrival of the newest heartbeat.
        position_s: (n,).
        position_m: (n, 3), NaN where not known.
        may_lack_s: (n,) by how much the next heartbeat may be late.
        absent: (n,) these are judged by any silence.
        silence_s: as of `is_silent`, and so is `judged_s`.
        judged_s: of the others.

    Returns: (n,) each.
    """
    n = len(life_s)
    seen, silent = np.empty(n, np.bool_), np.empty(n, np.bool_)
    beats, fresh = np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        known_s, next_s = np.inf if absent[i] else judged_s, beat_s[i] + may_lack_s[i]
        located = np.isfinite(position_m[i, 0] + position_m[i, 1] + position_m[i, 2])
        seen[i] = located and not is_silent(now_s, life_s[i], next_s, position_s[i], silence_s, np.inf)
        silent[i] = is_silent(now_s, life_s[i], next_s, position_s[i], silence_s, known_s)
        beats[i] = now_s - beat_s[i] <= silence_s
        fresh[i] = not silent[i] and np.minimum(now_s - beat_s[i], known_s) <= silence_s
    return seen, silent, beats, fresh


def warm_up() -> None:
    """Compile or load the kernels, with the types used in flight."""
    never_s, none = np.full(1, -np.inf), np.zeros(1, np.bool_)
    SetpointGaps(1).note(none, none, 0.0)
    frozen_s, frozen_m = never_s.copy(), np.zeros((1, 3))
    for frozen in (frozen_s, frozen_m):
        frozen.setflags(write=False)
    signs_of_life(0.0, frozen_s, frozen_s, frozen_s, frozen_m, never_s, none, 1.0, inf)


def lacking(now_s: float, life_s: float, beat_s: float, position_s: float, silence_s: float) -> str:
    """What is missing of a vehicle's telemetry, in words; empty when nothing is (decision 0024).

    Every message of a vehicle's autopilot is a sign of life. Its position is needed to fly it, its heartbeat
    to know its mode: a pilot's takeover shows nowhere else.

    - No telemetry at all, or no position: the vehicle is lost, and nothing is sent to it.
    - No heartbeat, but positions: it is flown on. Setpoints take nothing from a pilot, for PX4 follows them
      in OFFBOARD only. An alarm names the missing heartbeats. Without a fresh heartbeat the service sends no
      mode change on its own. After BEATS_LACK_MAX_S more the vehicle counts as lost: a pilot may have flown
      it for so long that the others must not rely on its giving way.

    Times of arrival are those of any message from its autopilot, of its newest heartbeat and of its newest
    position, -inf before the first.
    """
    if not now_s - life_s <= silence_s:
        return f"no telemetry{_since(now_s - life_s)}"
    if not now_s - position_s <= silence_s:
        if now_s - life_s > ARRIVES_S:
            return f"no telemetry{_since(now_s - life_s)}"
        beats = now_s - beat_s <= silence_s
        others = "heartbeats still arrive" if beats else "other telemetry still arrives"
        return f"no position{_since(now_s - position_s)}, {others}"
    if not now_s - beat_s <= silence_s + BEATS_MAY_LACK_S:
        return f"no heartbeat{_since(now_s - beat_s)}, positions still arrive"
    return ""


def _since(age_s: float) -> str:
    return f" for {age_s:.1f} s" if isfinite(age_s) else ""
