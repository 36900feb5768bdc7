"""A plan for the whole fleet: who shall be where, when."""

from dataclasses import dataclass

from gcs.model.state import Array

STEP_S = 0.2
"""Between two moments at which the ways are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class ReturnPaths:
    """A plan for the whole fleet. Rows as it was asked for."""

    drawn_m: Array  # (n, t, 3) every STEP_S, show frame: what each is drawn to
    path_m: Array  # (n, t, 3) and where it should be then
    over_s: Array  # (n,) when each is above its pad, from where it comes straight down
    down_s: Array  # (n,) when each is down
    unplanned: tuple[int, ...]  # rows that found no way: they wait for all others, and the filter leads them

    def goal_m(self, row: int, time_s: float) -> Array:
        """(3,) what draws that vehicle `time_s` after the order."""
        goal_m: Array = at(self.drawn_m[row], time_s)
        return goal_m

    def expected_m(self, time_s: float) -> Array:
        """(n, 3) where everybody should be then."""
        return at(self.path_m.swapaxes(0, 1), time_s)


def at(moments_m: Array, time_s: float) -> Array:
    """(...) of (t, ...) places every STEP_S, at a time between them; before and after, the first and last."""
    position = min(max(time_s / STEP_S, 0.0), len(moments_m) - 1.0)
    first = min(int(position), max(len(moments_m) - 2, 0))
    last = min(first + 1, len(moments_m) - 1)
    place_m: Array = moments_m[first] + (position - first) * (moments_m[last] - moments_m[first])
    return place_m
