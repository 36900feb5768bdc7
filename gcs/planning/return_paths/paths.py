"""A plan for the whole fleet: each vehicle's goal and position over time."""

from dataclasses import dataclass

from gcs.model.state import Array

STEP_S = 0.2
"""Interval at which the paths are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class ReturnPaths:
    """A plan for the whole fleet. Rows as in the request."""

    drawn_m: Array  # (n, t, 3) every STEP_S, show frame: the goal of each vehicle
    path_m: Array  # (n, t, 3) and its expected position
    over_s: Array  # (n,) when each is above its pad, from where it descends straight
    down_s: Array  # (n,) when each is down
    unplanned: tuple[int, ...]  # rows without a path: they wait for all others, and the filter leads them

    def goal_m(self, row: int, time_s: float) -> Array:
        """(3,) Goal of that vehicle `time_s` after the start of the plan."""
        goal_m: Array = at(self.drawn_m[row], time_s)
        return goal_m

    def expected_m(self, time_s: float) -> Array:
        """(n, 3) Expected positions at that time."""
        return at(self.path_m.swapaxes(0, 1), time_s)


def at(moments_m: Array, time_s: float) -> Array:
    """(...) Interpolate (t, ...) positions every STEP_S; before and after, the first and the last."""
    position = min(max(time_s / STEP_S, 0.0), len(moments_m) - 1.0)
    first = min(int(position), max(len(moments_m) - 2, 0))
    last = min(first + 1, len(moments_m) - 1)
    place_m: Array = moments_m[first] + (position - first) * (moments_m[last] - moments_m[first])
    return place_m
