"""A plan for the whole fleet, and how it is followed, in flights and rehearsals.

The plan's own clock waits for vehicles that are behind, so that each one keeps its turn.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask

STEP_S = 0.2
"""Interval at which the paths are compared."""

IN_PLACE_M: Final = 0.8
WELL_IN_PLACE_M: Final = 0.4
"""Tolerance at the end of a slanting path: little height is left to come nearer during the descent."""

KEPT_UP_M = 2.5
"""Up to this distance from its expected position a vehicle is on time."""

HELD_UP_M = 5.0
"""From this distance on the plan's clock stops."""

GIVEN_UP_M = 9.0
"""Farther away, a vehicle does not follow the plan any more, and the plan does not wait for it."""

COLUMN_M = 1.0
"""A landing vehicle within this distance of its place, over the ground, is in its landing column."""

LATE_S = 5.0
"""A vehicle that is not above its pad so long after its path has ended obeys the rules of the road again."""

BESIDE_S, BESIDE_M = 20.0, 2.0
"""A vehicle that is kept off its place so long after its path has ended, by no more than this, comes down
there: another may have landed beside its own.
"""

PATIENCE_S = 15.0
"""Total time that the plan waits: one blocked vehicle must not delay all others for longer."""

BEHIND_M = 11.0
"""A vehicle farther from its goal than this does not follow its path any more."""


class ReturnSettings(Settings):
    """Settings of the return planner."""

    spare_m: NotNegative = 0.1  # in addition to the separation margin, for what the plan does not know
    spare_s: Positive = 6.0
    reaction_s: NotNegative = 0.5  # two close no faster than the safety filter lets them, see `Braking`
    deceleration_m_s2: Positive = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ReturnPaths:
    """A plan for the whole fleet. Rows as in the request."""

    drawn_m: Array  # (n, t, 3) every STEP_S, show frame: the goal of each vehicle
    path_m: Array  # (n, t, 3) and its expected position
    over_s: Array  # (n,) when each is above its pad, from where it descends straight
    down_s: Array  # (n,) when each is down
    unplanned: tuple[int, ...]  # rows without a path: they wait for all others, and the filter leads them

    def goal_m(self, time_s: float) -> Array:
        """(n, 3) Goals `time_s` after the start of the plan."""
        return _at(self.drawn_m.swapaxes(0, 1), time_s)

    def expected_m(self, time_s: float) -> Array:
        """(n, 3) Expected positions at that time."""
        return _at(self.path_m.swapaxes(0, 1), time_s)


def _at(moments_m: Array, time_s: float) -> Array:
    """(...) Interpolate (t, ...) positions every STEP_S; before and after, the first and the last."""
    position = min(max(time_s / STEP_S, 0.0), len(moments_m) - 1.0)
    first = min(int(position), max(len(moments_m) - 2, 0))
    last = min(first + 1, len(moments_m) - 1)
    place_m: Array = moments_m[first] + (position - first) * (moments_m[last] - moments_m[first])
    return place_m


class PathProgress:
    """How far a plan has been flown."""

    def __init__(self, return_paths: ReturnPaths, pad_m: Array) -> None:
        """Start the plan; `pad_m` (n, 3) are the landing positions, show frame."""
        self.return_paths = return_paths
        self.time_s = 0.0
        """Time in the plan: never ahead of the clock, and behind it by the total wait."""
        self.goal_m = return_paths.goal_m(0.0)
        """(n, 3) present goals, show frame."""
        self.arrived: Mask = np.zeros(len(pad_m), dtype=np.bool_)
        """(n,) which vehicles their paths have led above their pads: they descend."""
        self.late: Mask = np.zeros(len(pad_m), dtype=np.bool_)
        """(n,) which vehicles are not there although their paths have ended: others may be in their way."""
        self._pad_m = pad_m
        self._waited_s = 0.0

    def advance(self, step_s: float, position_m: Array, flown: Mask, led_s: float = np.nan) -> None:
        """Advance the plan by `step_s`, or less; or to `led_s`, where another station knows all vehicles.

        Args:
            step_s: since the last call.
            position_m: (n, 3) present positions, show frame.
            flown: (n,) which vehicles follow the plan; it never waits for those without a path.
            led_s: time in the plan as that station has it; NaN: none.
        """
        behind_m = np.linalg.norm(position_m - self.return_paths.expected_m(self.time_s), axis=1)
        followed = flown & (behind_m < GIVEN_UP_M)
        followed[list(self.return_paths.unplanned)] = False
        waited_for = behind_m[followed]
        share = (HELD_UP_M - float(waited_for.max(initial=0.0))) / (HELD_UP_M - KEPT_UP_M)
        waits_s = min(step_s * (1.0 - min(max(share, 0.0), 1.0)), PATIENCE_S - self._waited_s)
        if np.isfinite(led_s):
            self.time_s = max(self.time_s, led_s)
        else:
            self._waited_s += waits_s
            self.time_s += step_s - waits_s
        self.goal_m = self.return_paths.goal_m(self.time_s)
        over = self.time_s >= self.return_paths.over_s
        beside = self.time_s >= self.return_paths.over_s + BESIDE_S
        near = is_above(position_m, self._pad_m, WELL_IN_PLACE_M)
        near |= beside & is_above(position_m, self._pad_m, BESIDE_M)
        self.arrived = np.asarray(over & near)
        self.late = (self.time_s >= self.return_paths.over_s + LATE_S) & ~self.arrived


def is_above(here_m: Array, place_m: Array, within_m: float = IN_PLACE_M) -> Mask:
    """(n,) Whether each vehicle (n, 3) is within `within_m` of its place (n, 3) over the ground."""
    return np.asarray(np.hypot(here_m[:, 0] - place_m[:, 0], here_m[:, 1] - place_m[:, 1]) < within_m)


def above_place_m(here_m: Array, place_m: Array, least_m: float) -> Array:
    """(n, 3) Goals above the places (n, 3): at its own height (n, 3), but at least `least_m` up."""
    return np.column_stack([place_m[:, :2], np.minimum(here_m[:, 2], place_m[:, 2] - least_m)])


def lowest_beside_m(here_m: Array, goal_m: Array) -> float:
    """Z of the lowest landing vehicle (k, 3) outside its landing column (k, 3), show frame; -inf without one.

    A higher vehicle does not descend before it: each one descends past vehicles that are in their columns.
    """
    beside = ~is_above(here_m, goal_m, COLUMN_M)
    return float(here_m[beside, 2].max(initial=-np.inf))


def may_hand_over(here_m: Array, place_m: Array, handover_m: float) -> Mask:
    """(n,) Whether each vehicle is above its place and lower than `handover_m`: its autopilot may land it."""
    return is_above(here_m, place_m) & (place_m[:, 2] - here_m[:, 2] < handover_m)


def keeps_to_path(follows: Mask, here_m: Array, goal_m: Array) -> Mask:
    """(n,) Which followers are near their paths; the others keep the right-of-way rules."""
    return np.asarray(follows & (np.linalg.norm(goal_m - here_m, axis=1) < BEHIND_M))
