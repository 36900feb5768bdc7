"""How near the formation was to the targets that it followed, each by its own estimate. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np

from gcs.model.lifecycle import ShowPhase
from gcs.model.state import Array
from gcs.recording.mcap_reader import RecordedSample
from gcs.service.snapshots import TargetTracking

REACHED_M: Final = 3.0
"""A target, or its orbit, is reached when the centre is no farther away; the way there does not count."""

LONGEST_S: Final = 1.0
"""What is between two ticks that are farther apart is not known."""


@dataclass(slots=True)
class _Followed:
    """What is collected of one target; the lists have a value for each reading."""

    followed_s: float = 0.0
    approach_s: float = 0.0
    state_s: dict[str, float] = field(default_factory=dict)
    at_s: list[float] = field(default_factory=list)
    off_m: list[float] = field(default_factory=list)
    deviation_m: list[float] = field(default_factory=list)

    def result(self, name: str) -> TargetTracking:
        lost_s = self.state_s.get("lost", 0.0) + self.state_s.get("none", 0.0)
        lasted = TargetTracking(
            name,
            round(self.followed_s, 1),
            round(self.approach_s, 1),
            round(self.state_s.get("coasting", 0.0), 1),
            round(lost_s, 1),
        )
        if not self.off_m:
            return lasted
        median_m, p95_m, worst_m = np.percentile(self.off_m, (50, 95, 100)).round(2).tolist()
        return replace(
            lasted,
            median_m=median_m,
            p95_m=p95_m,
            worst_m=worst_m,
            worst_at_s=round(self.at_s[int(np.argmax(self.off_m))], 2),
            deviation_m=round(float(np.median(self.deviation_m)), 2),
        )


def target_tracking(ticks: Sequence[RecordedSample], center_m: Array) -> tuple[TargetTracking, ...]:
    """How near the centre was to each target while it was selected and a running show followed it.

    Args:
        ticks: of the flight.
        center_m: (k, 2) of the vehicles in the formation at each tick, NaN: there were none.
    """
    of: dict[str, _Followed] = {}
    way, reached = ("", 0.0), False
    for (before, tick), place_m in zip(pairwise(ticks), center_m[1:], strict=True):
        name = _followed(tick)
        if way != (way := (name, tick.status.plan.orbit.radius_m)):
            reached = False
        if not name:
            continue
        seconds = min(tick.tick.time_s - before.tick.time_s, LONGEST_S)
        collected = of.setdefault(name, _Followed())
        state, off_m, deviation_m = _reading(tick, name, place_m)
        reached = reached or off_m <= REACHED_M
        collected.followed_s += seconds
        collected.state_s[state] = collected.state_s.get(state, 0.0) + seconds
        if not reached:
            collected.approach_s += seconds
        elif tick.features is not before.features and np.isfinite(off_m):
            collected.at_s.append(tick.tick.time_s - ticks[0].tick.time_s)
            collected.off_m.append(off_m)
            collected.deviation_m.append(deviation_m)
    return tuple(collected.result(name) for name, collected in of.items())


def _followed(tick: RecordedSample) -> str:
    """Name of the target that the formation follows at this tick; empty: none."""
    targets, show = tick.features.targets, tick.status.selected
    is_led = show is not None and not show.target_is_live
    if targets is None or is_led or tick.status.show is not ShowPhase.RUNNING:
        return ""
    return targets.selected


def _reading(tick: RecordedSample, name: str, center_m: Array) -> tuple[str, float, float]:
    """State of a target, distance of the centre (2,) from it or from its orbit, and its deviation."""
    targets = tick.features.targets
    of = {} if targets is None else {each.name: each for each in targets.targets}
    if name not in of:
        return "none", np.nan, np.nan
    state, read = of[name].state, (of[name].x_m, of[name].y_m, of[name].deviation_m)
    if state not in {"tracked", "coasting"}:
        return state, np.nan, np.nan
    x_m, y_m, deviation_m = (np.nan if each is None else each for each in read)
    away_m = float(np.hypot(center_m[0] - x_m, center_m[1] - y_m))
    return state, abs(away_m - tick.status.plan.orbit.radius_m), deviation_m
