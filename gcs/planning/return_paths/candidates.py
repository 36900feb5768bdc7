"""Candidate paths of each vehicle: slanting, level or by a detour to above its pad, then straight down."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gcs.model.jit import kernel, kernel_apart
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import STEP_S
from gcs.planning.return_paths.round_boxes import WaysRound
from gcs.safety.neighbours import Rows

SLANTS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Heights above the pad where the slanting part ends: shares between `over_m` and the own height."""

RISES_M = (0.0, 3.0, 6.0)
"""Climbs before a level path."""

ASIDES_M = (-9.0, -4.5, 4.5, 9.0)
"""Sideways offsets of a detour, to the right of the straight path's middle."""

ASIDE_SLANTS = (0.0, 0.5)

EACH = len(SLANTS) + len(RISES_M) + len(ASIDES_M) * len(ASIDE_SLANTS)
"""Candidate paths of one vehicle; as many as `WAYS` round obstacles."""

TAIL = 10
"""Most steps by which a vehicle trails behind its goal."""

SPEED_SHARE = 0.95
"""Share of the limits: a late vehicle must be able to catch up."""

LATER_S, WAITS, MANY = 4.0, 8, 100
"""Boxes move on while a vehicle waits: its paths are looked at again after each of so many times; with more
vehicles than the last once, as looking takes long.
"""

TOUCH_DOWN_M_S = 0.6
"""Below the handover its autopilot lands it, slower than the limits."""

AreFree = Callable[[Array, Array], Mask]
"""(m,) Which of the places (m, 3), show frame, are inside the fence and clear of obstacles, each so many
seconds (m,) after the planning.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Closed:
    """The space that lost vehicles may sweep. A vehicle that begins inside must not come nearer."""

    segments_m: Array  # (m, 2, 3) scaled
    kept_m: Array  # (m,) scaled distance from each
    scale: Array  # (3,)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """All paths of all vehicles in sequence: path w of vehicle i is row ``i * EACH + w``."""

    goal_m: Array  # (m, 3) the vehicle's goal, every STEP_S; each path begins at the start
    path_m: Array  # (m, 3) its expected position
    first: Rows  # (n * EACH + 1,) index where each path begins
    over: Rows  # (n * EACH,) steps until it is above its pad
    free: Mask  # (n * EACH, w) clear of fence and obstacles, when it begins after so many `LATER_S`

    @property
    def length(self) -> Rows:
        """(n * EACH,) Length of each path, in steps."""
        return np.diff(self.first)

    @property
    def quickest(self) -> int:
        """Steps after which every vehicle could be down, if it were alone."""
        waits = np.rint(self.free.argmax(axis=1) * LATER_S / STEP_S).astype(np.intp)
        free_steps = np.where(self.free.any(axis=1), self.length + waits, np.iinfo(np.intp).max)
        return int(free_steps.reshape(-1, EACH).min(axis=1).max())


def lay(
    start_m: Array,
    pad_m: Array,
    over_m: float,
    handover_m: float,
    *,
    speeds_m_s: Array,
    goal_rate_per_s: float,
    are_free: AreFree | None = None,
    closed: Closed | None = None,
    ways: WaysRound | None = None,
) -> Candidates:
    """Generate all paths of all vehicles.

    Args:
        start_m: (n, 3) where they hover, show frame.
        pad_m: (n, 3) landing positions.
        over_m: least height above the pads on the way.
        handover_m: height above the pad from which its autopilot lands it.
        speeds_m_s: (3,) limits sideways, up, down.
        goal_rate_per_s: rate at which a vehicle approaches its goal.
        are_free: None: all places are free. If no path of a vehicle is free, all count as free: the filter
            leads it.
        closed: the space that lost vehicles may sweep; None: no vehicle is lost.
        ways: round obstacles, for vehicles without another free path; None: there is no obstacle.
    """
    corners_m = _corners_m(start_m, pad_m, over_m, handover_m)
    waits = 0 if ways is None or not ways.move else (WAITS if len(start_m) <= MANY else 1)
    speeds = SPEED_SHARE * speeds_m_s, TOUCH_DOWN_M_S, speeds_m_s, goal_rate_per_s
    laid = _free_of(_laid(corners_m, *speeds), are_free, closed, waits)
    if closed is not None and len(closed.segments_m) and len(blocked := _blocked(laid)):
        for row in blocked:
            own = slice(row * EACH, (row + 1) * EACH)
            corners_m[own] = _round_closed(corners_m[own], closed)
        laid = _free_of(_laid(corners_m, *speeds), are_free, closed, waits)
    if ways is not None and len(blocked := _blocked(laid)):
        corners_m = _round_boxes(corners_m, blocked, ways)
        laid = _free_of(_laid(corners_m, *speeds), are_free, closed, waits)
    return replace(laid, free=_or_all(laid.free))


def _blocked(candidates: Candidates) -> list[int]:
    """Rows of the vehicles without a free path."""
    each = candidates.free.shape[1] * EACH
    blocked: list[int] = np.flatnonzero(~candidates.free.reshape(-1, each).any(axis=1)).tolist()
    return blocked


def _round_boxes(corners_m: Array, rows: list[int], ways: WaysRound) -> Array:
    """(n * EACH, k, 3) the paths (n * EACH, 5, 3), those of `rows` led round obstacles or over them.

    The others repeat their start.
    """
    led = {row: ways.lead(corners_m[row * EACH, 0], corners_m[row * EACH, 2]) for row in rows}
    longest = max(each.shape[1] for each in led.values())
    before = np.repeat(corners_m[:, :1], longest - 1, axis=1)
    all_m = np.concatenate([before, corners_m[:, 1:]], axis=1)
    for row, way_m in led.items():
        own = slice(row * EACH, (row + 1) * EACH)
        all_m[own, 1 : 1 + longest - way_m.shape[1]] = corners_m[row * EACH, 0]
        all_m[own, 1 + longest - way_m.shape[1] : 1 + longest] = way_m
    return all_m


def _free_of(
    laid: tuple[Array, Array, Rows, Rows], are_free: AreFree | None, closed: Closed | None, waits: int
) -> Candidates:
    """The candidates (goals, paths, index of each, steps), and which are clear of everything.

    Where they wait before boxes that move they must be so at the beginning and at the end of each `LATER_S`,
    of which `waits` are looked at; 0: nothing moves.
    """
    goal_m, path_m, first, over = laid
    free = np.ones((len(over), max(waits, 1)), dtype=np.bool_)
    if are_free is not None and len(path_m):
        steps = np.arange(len(path_m)) - np.repeat(first[:-1], np.diff(first))
        after_s = np.multiply(steps, STEP_S, dtype=np.float64)
        begins = [
            np.logical_and.reduceat(are_free(path_m, after_s + later * LATER_S), first[:-1])
            for later in range(waits + 1)
        ]
        free = np.stack([begins[at] & begins[min(at + 1, waits)] for at in range(free.shape[1])], axis=1)
    if closed is not None and len(closed.segments_m):
        free &= _clear_of(path_m * closed.scale, first, closed.segments_m, closed.kept_m)[:, None]
    return Candidates(goal_m, path_m, first, over, free)


def _round_closed(corners_m: Array, closed: Closed) -> Array:
    """(EACH, 5, 3) the paths of one vehicle, led past the lost vehicle nearest to the straight way.

    Eight points about it, at two distances each: a vehicle cuts the corner, the more the faster it is.
    """
    start_m, over_m = corners_m[0, 0], corners_m[:, 2]
    middle_m = closed.segments_m[:, 0] / closed.scale
    along_m = corners_m[0, 4, :2] - start_m[:2]
    share = np.clip((middle_m[:, :2] - start_m[:2]) @ along_m / max(along_m @ along_m, 1e-9), 0.0, 1.0)
    off_m = np.linalg.norm(middle_m[:, :2] - start_m[:2] - share[:, None] * along_m, axis=1)
    nearest = int(np.argmin(off_m - closed.kept_m))
    turn_rad = np.arange(EACH // 2) * 2.0 * np.pi / (EACH // 2)
    around_m = closed.kept_m[nearest] * np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    led_m, lowest_m = corners_m.copy(), over_m[0]
    for k, share_kept in enumerate(ROUND_SHARES):
        half = slice(k * (EACH // 2), (k + 1) * (EACH // 2))
        led_m[half, 1, :2] = middle_m[nearest, :2] + share_kept * around_m
        led_m[half, 1, 2] = (start_m[2] + lowest_m[2]) / 2.0
        led_m[half, 2] = lowest_m
    return led_m


ROUND_SHARES = (1.5, 2.3)
"""Of the kept distance: a path past a lost vehicle turns at these distances from it."""


def _or_all(free: Mask) -> Mask:
    """(n * EACH, w) the free paths; of a vehicle without any, all."""
    some = free.reshape(-1, EACH * free.shape[1]).any(axis=1)
    return np.asarray(free | np.repeat(~some, EACH)[:, None])


@kernel_apart
def _clear_of(place_m: Array, first: Rows, segments_m: Array, kept_m: Array) -> Mask:
    """(k,) which paths of (m, 3) keep the distances (s,) from all segments (s, 2, 3)."""
    clear = np.ones(len(first) - 1, np.bool_)
    for k in range(len(clear)):
        way_m = place_m[first[k] : first[k + 1]]
        low_m, high_m = way_m[0].copy(), way_m[0].copy()
        for at in range(len(way_m)):
            low_m, high_m = np.minimum(low_m, way_m[at]), np.maximum(high_m, way_m[at])
        for s in range(len(segments_m)):
            a_m, b_m = segments_m[s, 0], segments_m[s, 1]
            near = True
            for axis in range(3):
                near &= min(a_m[axis], b_m[axis]) - kept_m[s] < high_m[axis]
                near &= max(a_m[axis], b_m[axis]) + kept_m[s] > low_m[axis]
            if not near:
                continue
            least_m = min(kept_m[s], BEGUN_SHARE * _from_m(way_m[0], a_m, b_m))
            for at in range(len(way_m)):
                if _from_m(way_m[at], a_m, b_m) < least_m:
                    clear[k] = False
                    break
            if not clear[k]:
                break
    return clear


@kernel
def least_apart_m(place_m: Array, segments_m: Array, kept_m: Array) -> Array:
    """(k,) By how much the places (k, p, 3), the nearest of each p, are beyond the kept distances (s,).

    From segments (s, 2, 3), all scaled; negative: nearer.
    """
    apart_m = np.full(len(place_m), np.inf)
    for k in range(len(place_m)):
        for s in range(len(segments_m)):
            for at in range(place_m.shape[1]):
                away_m = _from_m(place_m[k, at], segments_m[s, 0], segments_m[s, 1]) - kept_m[s]
                apart_m[k] = min(apart_m[k], away_m)
    return apart_m


BEGUN_SHARE = 0.98
"""A vehicle that begins inside the closed space must keep this share of its distance."""


@kernel
def _from_m(point_m: Array, a_m: Array, b_m: Array) -> float:
    """Distance of a point (3,) from the segment between two others."""
    along, square = 0.0, 0.0
    for axis in range(3):
        along += (point_m[axis] - a_m[axis]) * (b_m[axis] - a_m[axis])
        square += (b_m[axis] - a_m[axis]) ** 2
    share = min(max(along / max(square, 1e-9), 0.0), 1.0)
    away2 = 0.0
    for axis in range(3):
        away2 += (point_m[axis] - a_m[axis] - share * (b_m[axis] - a_m[axis])) ** 2
    away_m: float = np.sqrt(away2)
    return away_m


def _corners_m(start_m: Array, pad_m: Array, over_m: float, handover_m: float) -> Array:
    """(n * EACH, 5, 3) Start, an intermediate point, above the pad, at the handover, on the pad."""
    n = len(start_m)
    lowest_z_m = pad_m[:, 2] - over_m
    own_z_m = np.minimum(start_m[:, 2], lowest_z_m)
    way_m = pad_m[:, :2] - start_m[:, :2]
    right = np.stack([-way_m[:, 1], way_m[:, 0], np.zeros(n)], axis=1)
    right /= np.maximum(np.hypot(way_m[:, 0], way_m[:, 1]), 1.0)[:, None]

    def above_pad_m(slant: float) -> Array:
        return np.column_stack([pad_m[:, :2], lowest_z_m + slant * (own_z_m - lowest_z_m)])

    legs_m: list[tuple[Array, Array]] = [(start_m, above_pad_m(slant)) for slant in SLANTS]
    for rise_m in RISES_M:
        above = (0.0, 0.0, rise_m)
        legs_m.append((np.column_stack([start_m[:, :2], own_z_m]) - above, above_pad_m(1.0) - above))
    for aside_m in ASIDES_M:
        for slant in ASIDE_SLANTS:
            ends_m = above_pad_m(slant)
            legs_m.append(((start_m + ends_m) / 2.0 + aside_m * right, ends_m))
    corners_m = np.empty((n, EACH, 5, 3))
    corners_m[:, :, 0] = start_m[:, None]
    corners_m[:, :, 3] = (pad_m - (0.0, 0.0, handover_m))[:, None]
    corners_m[:, :, 4] = pad_m[:, None]
    for k, (between_m, ends_m) in enumerate(legs_m):
        corners_m[:, k, 1], corners_m[:, k, 2] = between_m, ends_m
    return corners_m.reshape(n * EACH, 5, 3)


@kernel
def _steps(begin_m: Array, end_m: Array, sideways_m_s: float, up_m_s: float, down_m_s: float) -> int:
    """Return the steps that a straight line takes within the speeds."""
    level_m = np.sqrt((end_m[0] - begin_m[0]) ** 2 + (end_m[1] - begin_m[1]) ** 2)
    sinks_m = end_m[2] - begin_m[2]
    time_s = max(level_m / sideways_m_s, -sinks_m / up_m_s, sinks_m / down_m_s)
    return int(np.ceil(time_s / STEP_S - 1e-9))


@kernel_apart
def _laid(
    corners_m: Array, speeds_m_s: Array, touch_down_m_s: float, limits_m_s: Array, rate_per_s: float
) -> tuple[Array, Array, Rows, Rows]:
    """Goals and paths (m, 3) of corners (k, c, 3), index of each (k + 1,), steps until over the pad (k,)."""
    return_paths, corners = corners_m.shape[:2]
    sideways_m_s, up_m_s, down_m_s = speeds_m_s
    steps = np.empty((return_paths, corners - 1), np.intp)
    first, over = np.zeros(return_paths + 1, np.intp), np.empty(return_paths, np.intp)
    for k in range(return_paths):
        for leg in range(corners - 1):
            sinks_m_s = touch_down_m_s if leg == corners - 2 else down_m_s
            steps[k, leg] = _steps(corners_m[k, leg], corners_m[k, leg + 1], sideways_m_s, up_m_s, sinks_m_s)
        over[k] = steps[k, : corners - 3].sum()
        first[k + 1] = first[k] + 1 + steps[k].sum() + TAIL
    goal_m, path_m = np.empty((first[-1], 3)), np.empty((first[-1], 3))
    for k in range(return_paths):
        at = first[k]
        goal_m[at] = corners_m[k, 0]
        for leg in range(corners - 1):
            for step in range(steps[k, leg]):
                at += 1
                share = (step + 1) / steps[k, leg]
                goal_m[at] = corners_m[k, leg] + share * (corners_m[k, leg + 1] - corners_m[k, leg])
        goal_m[at + 1 : first[k + 1]] = corners_m[k, corners - 1]
        _follow(goal_m[first[k] : first[k + 1]], path_m[first[k] : first[k + 1]], rate_per_s, limits_m_s)
    return goal_m, path_m, first, over


@kernel
def _follow(goal_m: Array, path_m: Array, rate_per_s: float, limits_m_s: Array) -> None:
    """Write the position (k, 3) of a vehicle that follows goals (k, 3), one a step: it rounds the corners."""
    path_m[0] = goal_m[0]
    for k in range(1, len(goal_m)):
        desired_m_s = rate_per_s * (goal_m[k] - path_m[k - 1])
        level_m_s = np.sqrt(desired_m_s[0] ** 2 + desired_m_s[1] ** 2)
        share = min(1.0, limits_m_s[0] / max(level_m_s, 1e-9))
        share = min(share, limits_m_s[1] / max(-desired_m_s[2], 1e-9))
        share = min(share, limits_m_s[2] / max(desired_m_s[2], 1e-9))
        path_m[k] = path_m[k - 1] + STEP_S * share * desired_m_s
