"""Targets that the formation can follow: what their sources report, which one is followed, and how."""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, isfinite, nan
from typing import Final

import numpy as np

from gcs.estimation.targets.motion import TargetMotion
from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate, motions
from gcs.estimation.targets.tracker import TargetReport, Tracker, TrackState
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import InForce, Newest
from gcs.formation.following import FAR_M, CenterLimits, fleet_limits, inside_circle
from gcs.formation.orbit import target_reach_m
from gcs.links.intake import Intake
from gcs.links.tak.settings import OwnTracks
from gcs.links.targets.receive import intake_of, keep_receiving
from gcs.links.targets.settings import TargetSettings
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import IN_THE_AIR, ShowPhase
from gcs.model.plan import Target
from gcs.model.preflight_report import Check, State
from gcs.model.target_fix import TargetFix
from gcs.planning.feasibility import lack_around
from gcs.service.alarms import AlarmCause, Condition
from gcs.service.features import TargetsView, TargetView

FOLLOWING: Final = IN_THE_AIR - {ShowPhase.RETURNING}
"""Phases in which the formation follows a target, or will in a moment."""

OUTRUN_M: Final = 10.0
"""The formation falls behind a target that is farther ahead and gains."""

WAIT: Final = "Wait until the way is free, hold, or select another target."


@dataclass(eq=False)
class ConfiguredTarget:
    """One target of the configuration: its estimate, and what its sources say of themselves."""

    settings: TargetSettings
    estimate: TargetEstimate
    intakes: Sequence[Intake]
    problems: list[str] = field(default_factory=list)  # of each source, in words; empty: none
    placed: Target | None = None  # with its clearance, as it was last known; None: never, or it has none

    @staticmethod
    def of(settings: TargetSettings, own: OwnTracks) -> "ConfiguredTarget":
        steady_s = 0.0 if settings.clearance_m else settings.coast_steady_s
        trackers = [
            Tracker(settings.deviation_m, settings.coast_s, SourceClock(settings.delay_s), steady_s)
            for _ in settings.sources
        ]
        intakes = [intake_of(f"target {settings.name}", source, own) for source in settings.sources]
        return ConfiguredTarget(settings, TargetEstimate(trackers), intakes, [""] * len(trackers))

    def why(self, now_s: float) -> str:
        """Why it is not tracked, in words; empty while it is."""
        state, tracker = self.estimate.state(now_s), self.estimate.tracker
        if state is TrackState.TRACKED:
            return ""
        reported = tracker.why or self.problems[self.estimate.active]
        if state is TrackState.NONE:
            return reported or "nothing was received yet"
        return reported or f"nothing for {now_s - tracker.newest_s:.1f} s"


class Targets(Feature):
    """All targets of one station. Used on the event loop only."""

    name = "targets"

    def __init__(
        self,
        settings: Sequence[TargetSettings],
        frame: ShowFrame,
        newest: Newest,
        in_force: InForce,
        unix_minus_loop_s: Callable[[], float],
        leads: Callable[[], bool],
        own: OwnTracks,
    ) -> None:
        """Follow none of them yet.

        Args:
            settings: of each target.
            frame: of the show.
            newest: time, and the formation's centre.
            in_force: the plan, of which the target is replaced.
            unix_minus_loop_s: this computer's clock minus the loop's; NaN: it is not to be trusted.
            leads: whether this station decides what the formation follows.
            own: tracks that are no targets.
        """
        self._targets = {each.name: ConfiguredTarget.of(each, own) for each in settings}
        self._own = own
        self._frame, self._newest, self._in_force = frame, newest, in_force
        self._unix_minus_loop_s, self._leads = unix_minus_loop_s, leads
        self.selected = ""
        self._holds = False
        self._moved_s = inf  # when a target of before a restart was there, until it is reported again
        self.intakes = [intake for target in self._targets.values() for intake in target.intakes]

    async def receive(self) -> None:
        async with asyncio.TaskGroup() as group:
            for name, target in self._targets.items():
                for source, settings in enumerate(target.settings.sources):
                    take, failed = partial(self.take, name, source), partial(self.failed, name, source)
                    intake = target.intakes[source]
                    group.create_task(keep_receiving(settings, self._own, take, failed, intake))

    def take(self, name: str, source: int, fix: TargetFix) -> None:
        """Take a report of one of a target's sources, by its index."""
        degrees = (np.array([fix.latitude_deg]), np.array([fix.longitude_deg]))
        x_m, y_m, _ = self._frame.position_m(*degrees, np.array([self._frame.altitude_amsl_m]))[0].tolist()
        target = self._targets[name]
        counts = target.settings.height == "reported"
        x_m_s, y_m_s, _ = self._frame.from_ned(np.array([fix.north_m_s, fix.east_m_s, 0.0])).tolist()
        report = TargetReport(
            fix.arrived_s,
            (x_m, y_m),
            (x_m_s, y_m_s),
            fix.deviation_m,
            fix.velocity_deviation_m_s,
            fix.source_s,
            fix.altitude_amsl_m - self._frame.altitude_amsl_m if counts else nan,
            fix.height_deviation_m,
        )
        target.estimate.trackers[source].take(report, self._unix_minus_loop_s())
        target.problems[source] = ""

    def failed(self, name: str, source: int, why: str) -> None:
        """Note why nothing arrives from one of a target's sources."""
        self._targets[name].problems[source] = why

    def select(self, name: str) -> None:
        """Follow this target; empty: the target of the plan stays as it is. Raises: UnknownError."""
        if name:
            estimate = self._known(name).estimate
            if estimate.state(self._newest.state.time_s) is not TrackState.TRACKED:
                estimate.begin_again()
                self._targets[name].placed = None
        self.selected, self._holds = name, False
        self._moved_s = self._newest.state.time_s if name else inf

    def resume(self, name: str, was_s: float) -> None:
        """Follow a target again that was followed before a restart, and was at the plan's target at `was_s`.

        Without reports it moves on for `coast_s`, and then is held. Raises: UnknownError.
        """
        self.select(name)
        self._moved_s = was_s

    def report(self, name: str, fix: TargetFix) -> None:
        """Take a report that an operator's program sends. Raises: UnknownError, RefusedError."""
        kinds = [source.kind for source in self._known(name).settings.sources]
        if "rest" not in kinds:
            raise RefusedError(f"target {name} has no source of kind rest; it has {', '.join(kinds)}")
        self.take(name, kinds.index("rest"), fix)

    def _known(self, name: str) -> ConfiguredTarget:
        if name not in self._targets:
            names = ", ".join(self._targets) or "none: add targets to the configuration"
            raise UnknownError(f"there is no target {name}; there are {names}")
        return self._targets[name]

    def lead(self, at: Instant) -> None:
        """Have the plan's target be where the selected one is estimated, or hold where it was lost.

        All that have a clearance are kept clear of, also while another one, or a show, leads.
        """
        self._newest.kept_clear = dict(self._kept_clear(at.time_s))
        run, plan = at.show_run, self._in_force.plan
        if not self.selected or not self._leads() or (run is not None and not run.is_live(at.time_s)):
            return
        selected = self._targets[self.selected]
        estimate, settings = selected.estimate, selected.settings
        motion, is_lost = estimate.motion(at.time_s), estimate.state(at.time_s) is TrackState.LOST
        if motion is None:
            is_lost = at.time_s - self._moved_s > settings.coast_s
            if not is_lost:
                return
        if self._holds and is_lost:
            return
        self._holds = is_lost
        if motion is None or is_lost:
            target = plan.target.held(at.time_s)
        else:
            target = motion.target(at.time_s, settings.clearance_m)
            target = inside_circle(target, self._limits(FAR_M)) if self._keeps_inside(motion) else target
        if run is not None:
            run.live = target
        self._in_force.plan = replace(plan, target=target)

    def _kept_clear(self, now_s: float) -> Iterator[tuple[str, Target]]:
        for name, target in self._targets.items():
            if not target.settings.clearance_m:
                continue
            motion = target.estimate.motion(now_s)
            if motion is not None and target.estimate.state(now_s) is not TrackState.LOST:
                target.placed = motion.target(now_s, target.settings.clearance_m)
            elif target.placed is not None and target.placed.followed:
                target.placed = replace(target.placed.held(now_s), followed=False)
            if target.placed is not None:
                yield name, target.placed

    @property
    def silent_s(self) -> float:
        """How long nothing believed of the selected target has been received; NaN: it is, or none is."""
        if not self.selected or not self._leads():
            return nan
        now_s, estimate = self._newest.state.time_s, self._targets[self.selected].estimate
        state = estimate.state(now_s)
        since_s = self._moved_s if state is TrackState.NONE else estimate.tracker.newest_s
        return nan if state is TrackState.TRACKED else now_s - since_s

    def checks(self, at: Instant) -> Iterator[Check]:
        """Whether the selected target is known, unless a show is selected that follows none."""
        run = at.show_run
        if self.selected and (run is None or run.has_live):
            why = self._targets[self.selected].why(at.time_s)
            problem = f"target {self.selected}: {why}" if why else ""
            yield Check(
                "target-tracked",
                State.FAIL if why else State.PASS,
                problem=problem,
                to_do="check its source, or select another target" if why else "",
            )
            motion = self._targets[self.selected].estimate.tracker.motion(at.time_s)
            cannot = "" if motion is None else self._beyond(motion) or self._outruns(motion)
            cannot = cannot or self._without_height(at.time_s)
            yield Check(
                "target-followed",
                State.FAIL if cannot else State.PASS,
                problem=f"target {self.selected}: {cannot}" if cannot else "",
                to_do="wait, or select another target" if cannot else "",
            )

    def conditions(self, at: Instant) -> Iterator[Condition]:
        run = at.show_run
        is_led = run is not None and not run.is_live(at.time_s)
        if not self.selected or is_led or at.show not in FOLLOWING:
            return
        target, name = self._targets[self.selected], self.selected
        state = target.estimate.state(at.time_s)
        is_late = at.time_s - self._moved_s > target.settings.coast_s
        is_lost = state is TrackState.LOST or (state is TrackState.NONE and is_late)
        if why := target.why(at.time_s):
            consequence = "Its last place is the target." if is_lost else "It is followed on its last motion."
            yield Condition(AlarmCause.TARGET_LOST, why, about=name, consequence=consequence)
        elif lacks := self._without_height(at.time_s):
            yield Condition(AlarmCause.TARGET_LOST, lacks, about=name, consequence="It counts as at 0 m.")
        if apart_m := target.estimate.apart_m(at.time_s):
            yield Condition(AlarmCause.TARGET_SOURCES, f"they differ by {apart_m:.0f} m", about=name)
        motion = target.estimate.tracker.motion(at.time_s)
        if motion is None or is_lost:
            return
        ahead_m = self._ahead_m(motion)
        way = "The formation keeps inside its circle, beside it." if self._keeps_inside(motion) else ""
        if beyond := self._beyond(motion):
            yield Condition(AlarmCause.TARGET_BEYOND, beyond, about=name)
        elif outruns := self._outruns(motion):
            yield Condition(AlarmCause.TARGET_OUTRUNS, f"it {outruns}", consequence=way, about=name)
        elif ahead_m > OUTRUN_M:
            held_off = self._held_off()
            ahead, advice = f"it is {ahead_m:.0f} m ahead{held_off}", WAIT if held_off else ""
            yield Condition(AlarmCause.TARGET_OUTRUNS, ahead, consequence=way, advice=advice, about=name)

    def _held_off(self) -> str:
        """What the formation keeps clear of meanwhile, in words; empty: of nothing."""
        near, detour = self._newest.near_traffic, self._newest.memory.detour
        if near is not None:
            names = (*near.names, *(box.id.removeprefix("traffic ") for box in near.boxes))
            return f", and the formation keeps clear of traffic {names[0]}"
        return ", and the formation goes round obstacles" if detour is not None and detour.active else ""

    @property
    def _reach_m(self) -> float:
        """How far from the show's origin a target can be followed."""
        plan, fence = self._in_force.plan, self._in_force.control.safety.fence
        return target_reach_m(fence.distance_max_m, plan.orbit.radius_m, plan.formation.radius_m)

    def _limits(self, behind_m: float = 0.0) -> CenterLimits:
        """What all vehicles together can follow, so far behind."""
        formation, control, traits = (
            self._in_force.plan.formation,
            self._in_force.control,
            self._newest.traits,
        )
        fastest_m_s = np.minimum(control.safety.limits.horizontal_m_s, traits.speed_max_m_s)
        hardest_m_s2 = np.minimum(control.acceleration_max_m_s2, traits.response.acceleration_m_s2)
        rim_m_s = abs(formation.spin_rad_s) * formation.radius_m
        fleet = fleet_limits(fastest_m_s, hardest_m_s2, rim_m_s, behind_m=behind_m)
        return replace(fleet, speed_m_s=max(fleet.speed_m_s, control.law.center_speed_max_m_s))

    @property
    def _follows_m_s(self) -> float:
        """The fastest target that all vehicles together can follow."""
        return self._limits().speed_m_s

    def _keeps_inside(self, motion: TargetMotion) -> bool:
        """Whether the centre may keep inside the circle of a target that is too fast for it."""
        plan, settings = self._in_force.plan, self._targets[self.selected].settings
        elsewhere = plan.orbit.radius_m or plan.obstacles or settings.clearance_m
        return motion.belief.circles and not elsewhere

    def _without_height(self, now_s: float) -> str:
        """That the selected target's height is needed and not reported, in words; empty: it is not needed."""
        target = self._targets[self.selected]
        motion = target.estimate.motion(now_s) if target.settings.height == "reported" else None
        return "" if motion is None or motion.height is not None else "its height is not reported"

    def _beyond(self, motion: TargetMotion) -> str:
        """How far a target is beyond where it can be followed, in words; empty: it can."""
        beyond_m = float(np.hypot(*motion.position_m)) - self._reach_m
        if beyond_m > 0.0:
            return f"{beyond_m:.0f} m farther than fence, orbit and sphere allow"
        plan, safety = self._in_force.plan, self._in_force.control.safety
        x_m, y_m = motion.position_m.tolist()
        return lack_around((x_m, y_m), plan.orbit, plan.formation, safety)

    def _outruns(self, motion: TargetMotion) -> str:
        """That it is faster than the formation by more than a deviation, in words; empty: it is not."""
        speed_m_s = float(np.hypot(*motion.velocity_m_s))
        if speed_m_s - motion.velocity_deviation_m_s <= self._follows_m_s:
            return ""
        return f"moves at {speed_m_s:.1f} m/s, and the formation follows with {self._follows_m_s:.1f} m/s"

    def _ahead_m(self, motion: TargetMotion) -> float:
        """How far a target is ahead of a centre that is to be above it, if that does not catch up; else 0."""
        center = self._newest.memory.center
        if center is None or self._in_force.plan.orbit.radius_m:
            return 0.0
        off_m = motion.position_m - center.position_m[:2]
        opens = float((motion.velocity_m_s - center.velocity_m_s[:2]) @ off_m) > 0.0
        return float(np.hypot(*off_m)) if opens else 0.0

    def view(self, at: Instant) -> TargetsView | None:
        if not self._targets:
            return None
        now = motions([each.estimate for each in self._targets.values()], at.time_s)
        return TargetsView(
            selected=self.selected,
            targets=tuple(
                self._view(name, each, motion, at.time_s)
                for (name, each), motion in zip(self._targets.items(), now, strict=True)
            ),
            follows_m_s=self._follows_m_s,
            reach_m=self._reach_m,
            off_m=self._off_m(at.time_s),
        )

    def _off_m(self, now_s: float) -> float:
        """How far the centre is from the selected target, or from the orbit around it; NaN: not known."""
        center, selected = self._newest.memory.center, self._targets.get(self.selected)
        if center is None or selected is None or selected.estimate.state(now_s) is TrackState.LOST:
            return nan
        motion = selected.estimate.tracker.motion(now_s)
        if motion is None:
            return nan
        away_m = float(np.hypot(*(motion.position_m - center.position_m[:2])))
        return abs(away_m - self._in_force.plan.orbit.radius_m)

    def _view(
        self, name: str, target: ConfiguredTarget, motion: TargetMotion | None, now_s: float
    ) -> TargetView:
        estimate, tracker = target.estimate, target.estimate.tracker
        x_m, y_m, x_m_s, y_m_s, deviation_m = (nan,) * 5
        if motion is not None:
            (x_m, y_m), (x_m_s, y_m_s) = motion.position_m.tolist(), motion.velocity_m_s.tolist()
            deviation_m = motion.deviation_m
        newest_s = tracker.newest_s
        return TargetView(
            name=name,
            source=target.settings.sources[estimate.active].kind,
            state=estimate.state(now_s).value,
            why=target.why(now_s),
            age_s=now_s - newest_s if isfinite(newest_s) else nan,
            rate_hz=1.0 / tracker.period_s if tracker.accepted > 1 else nan,
            x_m=x_m,
            y_m=y_m,
            velocity_x_m_s=x_m_s,
            velocity_y_m_s=y_m_s,
            deviation_m=deviation_m,
            height_m=nan if tracker.height is None else tracker.height.foreseen(now_s).height_m,
            clearance_m=target.settings.clearance_m,
            reports=sum(each.accepted for each in estimate.trackers),
            refused=sum(each.outliers + each.standing for each in estimate.trackers),
        )
