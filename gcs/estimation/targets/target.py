"""A target that several sources report: the first of those that are tracked is used. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import exp
from typing import Final

import numpy as np

from gcs.estimation.targets.height import HeightBelief
from gcs.estimation.targets.motion import TargetMotion, all_foreseen
from gcs.estimation.targets.tracker import Tracker, TrackState
from gcs.model.state import Array

BRIDGED_S: Final = 1.0
"""After a change of the source the difference between both decays with this time constant."""

HEIGHT_S: Final = 3.0
"""A height that was not reported for so long does not climb on."""

DISAGREE: Final = 3.0
"""Sources that differ by more than so many standard deviations of both contradict each other."""

BEST_FIRST: Final = (TrackState.TRACKED, TrackState.COASTING, TrackState.LOST)


@dataclass(slots=True, eq=False)
class TargetEstimate:
    """Where a target is, by the source that is in use.

    Attributes:
        trackers: one for each source, the best first.
        active: index of the one in use.
        changes: how often that has changed.
    """

    trackers: Sequence[Tracker]
    active: int = 0
    changes: int = 0
    _bridge_m: Array = field(default_factory=lambda: np.zeros(2), init=False)
    _bridged_s: float = field(default=0.0, init=False)
    _height: HeightBelief | None = field(default=None, init=False)  # the newest of any source

    @property
    def tracker(self) -> Tracker:
        """The one in use."""
        return self.trackers[self.active]

    def motion(self, now_s: float) -> TargetMotion | None:
        """How the target moves at `now_s`; None: nothing was received. Call it once a tick."""
        return motions((self,), now_s)[0]

    def state(self, now_s: float) -> TrackState:
        return self.tracker.state(now_s)

    def begin_again(self) -> None:
        """Forget where it was: the next report of each source is believed, wherever it is."""
        for tracker in self.trackers:
            tracker.begin_again()
        self._bridge_m, self._height = np.zeros(2), None

    def apart_m(self, now_s: float) -> float:
        """How far another tracked source is from the one in use, if they contradict each other; else 0."""
        motion = self.tracker.motion(now_s)
        if motion is None:
            return 0.0
        apart_m = 0.0
        for source, tracker in enumerate(self.trackers):
            other = tracker.motion(now_s)
            if source == self.active or other is None or tracker.state(now_s) is not TrackState.TRACKED:
                continue
            off_m = float(np.hypot(*(other.position_m - motion.position_m)))
            if off_m > DISAGREE * float(np.hypot(other.deviation_m, motion.deviation_m)):
                apart_m = max(apart_m, off_m)
        return apart_m

    def chosen(self, now_s: float) -> Tracker:
        """That of the best source, from now on the one in use."""
        if self.active == 0 and self.trackers[0].is_fresh(now_s):
            return self.trackers[0]
        best = self._best(now_s)
        if best != self.active:
            before, after = self.tracker.motion(now_s), self.trackers[best].motion(now_s)
            if before is not None and after is not None:
                self._bridge_m = before.position_m + self._bridge(now_s) - after.position_m
                self._bridged_s = now_s
                self.changes += 1
            self.active = best
        return self.trackers[best]

    def bridged(self, motion: TargetMotion, now_s: float) -> TargetMotion:
        """The motion by the source in use with what is left of the one before, and with its height."""
        if self.changes:
            motion = motion.at(motion.position_m + self._bridge(now_s))
        if self._height is self.tracker.height is None:
            return motion
        return motion._replace(height=self._kept_height(now_s))

    def _kept_height(self, now_s: float) -> HeightBelief | None:
        """How high it is; what was not reported for a while stays where it was, whatever source is used."""
        if self.tracker.height is not None:
            self._height = self.tracker.height
        if self._height is None:
            return None
        then = self._height.foreseen(now_s)
        if now_s - self._height.time_s <= HEIGHT_S:
            return then
        return replace(then, height_m=self._height.height_m, climb_m_s=0.0)

    def _best(self, now_s: float) -> int:
        """Index of the first that is tracked; else of the one in use while it is no worse than others.

        One that is late already is not waited for while another is not.
        """
        for source, tracker in enumerate(self.trackers):
            if tracker.is_fresh(now_s):
                return source
        states = [tracker.state(now_s) for tracker in self.trackers]
        for state in BEST_FIRST:
            if state is not TrackState.TRACKED and states[self.active] is state:
                return self.active
            if state in states:
                return states.index(state)
        return self.active

    def _bridge(self, now_s: float) -> Array:
        bridge_m: Array = self._bridge_m * exp(-max(now_s - self._bridged_s, 0.0) / BRIDGED_S)
        return bridge_m


def motions(targets: Sequence[TargetEstimate], now_s: float) -> list[TargetMotion | None]:
    """`TargetEstimate.motion` of many targets, at once."""
    beliefs = [target.chosen(now_s).belief for target in targets]
    foreseen = iter(all_foreseen([belief for belief in beliefs if belief is not None], now_s))
    return [
        None if belief is None else target.bridged(next(foreseen), now_s)
        for target, belief in zip(targets, beliefs, strict=True)
    ]
