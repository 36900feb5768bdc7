"""Targets that the formation can follow: what their sources report, which one is followed, and how."""

import asyncio
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import hypot, isfinite, nan
from typing import Final

import numpy as np

from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate
from gcs.estimation.targets.tracker import TargetReport, Tracker, TrackState
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.flight import Flight
from gcs.formation.orbit import target_reach_m
from gcs.links.intake import Intake
from gcs.links.targets.receive import intake_of, keep_receiving
from gcs.links.targets.settings import TargetSettings
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Target
from gcs.model.preflight_report import Check, State
from gcs.model.target_fix import TargetFix
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import TargetsView, TargetView


@dataclass(eq=False)
class Tracked:
    """One target of the configuration, and what its sources say of themselves."""

    settings: TargetSettings
    estimate: TargetEstimate
    intakes: Sequence[Intake]
    problems: list[str] = field(default_factory=list)  # of each source, in words; empty: none

    @staticmethod
    def of(settings: TargetSettings) -> "Tracked":
        trackers = [
            Tracker(settings.deviation_m, settings.coast_s, SourceClock(settings.delay_s))
            for _ in settings.sources
        ]
        intakes = [intake_of(settings.name, source) for source in settings.sources]
        return Tracked(settings, TargetEstimate(trackers), intakes, [""] * len(trackers))

    def why(self, now_s: float) -> str:
        """Why it is not tracked, in words; empty while it is."""
        state, counts = self.estimate.state(now_s), self.estimate.counts
        if state is TrackState.TRACKED:
            return ""
        reported = self.estimate.tracker.why or self.problems[counts]
        if state is TrackState.NONE:
            return reported or "nothing was received yet"
        return reported or f"nothing for {now_s - self.estimate.tracker.newest_s:.1f} s"


class Targets(Feature):
    """All targets of one station. Used on the event loop only."""

    name = "targets"

    def __init__(self, settings: Sequence[TargetSettings], flight: Flight, frame: ShowFrame) -> None:
        self._tracked = {each.name: Tracked.of(each) for each in settings}
        self._flight, self._frame = flight, frame
        self._selected = ""
        self._held = False
        self.intakes = [intake for each in self._tracked.values() for intake in each.intakes]

    async def receive(self) -> None:
        async with asyncio.TaskGroup() as group:
            for name, tracked in self._tracked.items():
                for place, source in enumerate(tracked.settings.sources):
                    take, failed = partial(self.take, name, place), partial(self.failed, name, place)
                    group.create_task(keep_receiving(source, take, failed, tracked.intakes[place]))

    def take(self, name: str, place: int, fix: TargetFix) -> None:
        """Take a report of the source at that place."""
        degrees = (np.array([fix.latitude_deg]), np.array([fix.longitude_deg]))
        position_m = self._frame.position_m(*degrees, np.array([self._frame.altitude_amsl_m]))[0]
        velocity_m_s = self._frame.from_ned(np.array([fix.north_m_s, fix.east_m_s, 0.0]))
        report = TargetReport(
            fix.arrived_s,
            (float(position_m[0]), float(position_m[1])),
            (float(velocity_m_s[0]), float(velocity_m_s[1])),
            fix.deviation_m,
            fix.velocity_deviation_m_s,
            fix.source_s,
        )
        tracked = self._tracked[name]
        unix_minus_loop_s = self._flight.unix_s() - fix.arrived_s
        tracked.estimate.trackers[place].take(report, unix_minus_loop_s)
        tracked.problems[place] = ""

    def failed(self, name: str, place: int, why: str) -> None:
        """Note why nothing arrives from the source at that place."""
        self._tracked[name].problems[place] = why

    def select(self, name: str) -> None:
        """Follow this target; empty: the target of the plan stays as it is. Raises: UnknownError."""
        if name:
            estimate = self._known(name).estimate
            if estimate.state(self._flight.newest.state.time_s) is not TrackState.TRACKED:
                estimate.begin_again()
        self._selected, self._held = name, False

    def report(self, name: str, fix: TargetFix) -> None:
        """Take a report that an operator's program sends. Raises: UnknownError, RefusedError."""
        tracked = self._known(name)
        kinds = [source.kind for source in tracked.settings.sources]
        if "rest" not in kinds:
            raise RefusedError(f"target {name} has no source of kind rest; it has {', '.join(kinds)}")
        self.take(name, kinds.index("rest"), fix)

    def _known(self, name: str) -> Tracked:
        if name not in self._tracked:
            names = ", ".join(self._tracked) or "none: add targets to the configuration"
            raise UnknownError(f"there is no target {name}; there are {names}")
        return self._tracked[name]

    def lead(self, at: Instant) -> None:
        """Have the plan's target be where the selected one is estimated, or hold where it was lost."""
        run, in_force = at.show_run, self._flight.in_force
        if not self._selected or not self._flight.elsewhere.shows.leads:
            return
        if run is not None and not run.is_live(at.time_s):
            return
        estimate = self._tracked[self._selected].estimate
        motion, state = estimate.motion(at.time_s), estimate.state(at.time_s)
        if motion is None or (self._held and state is TrackState.LOST):
            return
        x_m, y_m = motion.position_m.tolist()
        if state is TrackState.LOST:
            now = in_force.plan.target
            self._held, target = True, Target(*now.position_m(at.time_s), time_s=at.time_s, followed=True)
        else:
            (x_m_s, y_m_s), (x_m_s2, y_m_s2) = motion.velocity_m_s.tolist(), motion.acceleration_m_s2.tolist()
            deviation_m_s = motion.velocity_deviation_m_s
            target = Target(x_m, y_m, x_m_s, y_m_s, at.time_s, True, x_m_s2, y_m_s2, deviation_m_s)
            self._held = False
        if run is not None:
            run.live = target
        in_force.plan = replace(in_force.plan, target=target)

    def checks(self, at: Instant) -> Iterator[Check]:
        """Whether the selected target is known."""
        if self._selected:
            why = self._tracked[self._selected].why(at.time_s)
            problem = f"target {self._selected}: {why}" if why else ""
            yield Check(
                "target-tracked",
                State.FAIL if why else State.PASS,
                problem=problem,
                to_do="check its source, or select another target" if why else "",
            )

    def conditions(self, at: Instant) -> Iterator[Condition]:
        if not self._selected:
            return
        tracked, name = self._tracked[self._selected], self._selected
        if why := tracked.why(at.time_s):
            holds = tracked.estimate.state(at.time_s) is TrackState.LOST
            consequence = "The formation holds." if holds else "It is followed on its last motion."
            yield Condition(AlarmCause.TARGET_LOST, why, about=name, consequence=consequence)
        if apart_m := tracked.estimate.apart_m(at.time_s):
            yield Condition(AlarmCause.TARGET_SOURCES, f"they differ by {apart_m:.0f} m", about=name)
        beyond_m, outruns_m = self._beyond_m(tracked, at.time_s), self._outruns_m(tracked, at.time_s)
        if beyond_m > 0.0:
            because = f"{beyond_m:.0f} m farther than fence, orbit and sphere allow"
            yield Condition(AlarmCause.TARGET_BEYOND, because, about=name)
        elif outruns_m > 0.0:
            yield Condition(AlarmCause.TARGET_OUTRUNS, f"it is {outruns_m:.0f} m ahead", about=name)

    def _beyond_m(self, tracked: Tracked, now_s: float) -> float:
        """How far a target is beyond where it can be followed."""
        motion, plan = tracked.estimate.motion(now_s), self._flight.in_force.plan
        if motion is None:
            return 0.0
        fence_m = self._flight.in_force.control.safety.fence.distance_max_m
        reach_m = target_reach_m(fence_m, plan.orbit.radius_m, plan.formation.radius_m)
        return float(np.hypot(*motion.position_m)) - reach_m

    def _outruns_m(self, tracked: Tracked, now_s: float) -> float:
        """How far the centre is behind a target that is faster than it; else 0."""
        memory, motion = self._flight.newest.memory, tracked.estimate.motion(now_s)
        if memory.center is None or motion is None or self._flight.in_force.plan.orbit.radius_m:
            return 0.0
        ahead_m = motion.position_m - memory.center.position_m[:2]
        opens_m_s = float((motion.velocity_m_s - memory.center.velocity_m_s[:2]) @ ahead_m)
        away_m = hypot(*ahead_m)
        return away_m if away_m > OUTRUN_M and opens_m_s > 0.0 else 0.0

    def view(self, at: Instant) -> TargetsView | None:
        if not self._tracked:
            return None
        return TargetsView(
            selected=self._selected,
            targets=tuple(self._view(name, each, at.time_s) for name, each in self._tracked.items()),
        )

    def _view(self, name: str, tracked: Tracked, now_s: float) -> TargetView:
        estimate, tracker = tracked.estimate, tracked.estimate.tracker
        motion = tracker.motion(now_s)
        x_m, y_m, x_m_s, y_m_s, deviation_m = (nan,) * 5
        if motion is not None:
            (x_m, y_m), (x_m_s, y_m_s) = motion.position_m.tolist(), motion.velocity_m_s.tolist()
            deviation_m = motion.deviation_m
        newest_s = tracker.newest_s
        return TargetView(
            name=name,
            source=tracked.settings.sources[estimate.counts].kind,
            state=estimate.state(now_s).value,
            why=tracked.why(now_s),
            age_s=now_s - newest_s if isfinite(newest_s) else nan,
            rate_hz=1.0 / tracker.period_s if tracker.accepted > 1 else nan,
            x_m=x_m,
            y_m=y_m,
            velocity_x_m_s=x_m_s,
            velocity_y_m_s=y_m_s,
            deviation_m=deviation_m,
            reports=sum(each.accepted for each in estimate.trackers),
            refused=sum(each.outliers + each.standing for each in estimate.trackers),
        )


OUTRUN_M: Final = 10.0
"""A target that is farther ahead and gains is faster than the formation."""
