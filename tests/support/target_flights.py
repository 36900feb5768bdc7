"""Simulated flights after a target with receivers that fail, with the estimator and the law of the flight."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import inf, nan
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from gcs.estimation.targets.source_clock import SourceClock
from gcs.estimation.targets.target import TargetEstimate
from gcs.estimation.targets.tracker import Tracker, TrackState
from gcs.formation.following import SPEED_SHARE, CenterLimits
from gcs.model.plan import Target
from gcs.model.state import Array
from gcs.sim.targets.motions import Motion, motion
from gcs.sim.targets.reports import Errors, Report, reports
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.scenario import FormationFlight, TrackedTarget, load
from gcs.simulation.tracked_target import ORIGIN, MovingTarget

COUNT: Final = 8
SCENARIO: Final = Path(__file__).parents[2] / "configs" / "scenarios" / "track-straight.yaml"
TICK_S: Final = 0.05
COAST_S: Final = 5.0
FAULT_S: Final = 25.0
"""After so long the formation follows, and what fails begins to."""

EXACT_S: Final = 20.0

Fault = Callable[[Report], Sequence[Report]]
"""What a receiver sends in place of a report; nothing: it is silent."""


class Moving(NamedTuple):
    """A target, its receiver, and how near the centre must be in 95 % of the time (issue 51)."""

    motion: str
    speed_m_s: float | None
    errors: Errors
    p95_m: float


USUAL: Final = Errors(rate_hz=5.0, noise_m=1.0, delay_s=0.3)
MOVING: Final = {
    "straight": Moving("straight", 5.0, USUAL, 1.0),
    "roundabout": Moving("roundabout", 5.0, USUAL, 2.0),
    "hairpin": Moving("hairpin", 5.0, USUAL, 2.0),
    "corners": Moving("corners", 4.0, Errors(rate_hz=5.0, noise_m=0.05), 3.0),
    "walker": Moving("walker", 1.5, Errors(rate_hz=1.0, noise_m=3.0, delay_s=1.0), 2.5),
    "boat": Moving("boat", None, USUAL, 1.0),
    "rover": Moving("rover", None, USUAL, 2.0),
}


class Sender(NamedTuple):
    """One receiver: what it sends when, and what it makes of that from `FAULT_S` on."""

    errors: Errors
    fault: Fault = lambda report: (report,)
    seed: int = 0


def silent(*spans_s: tuple[float, float]) -> Fault:
    """Sends nothing from and until these times."""
    return lambda report: () if any(a <= report.taken_s < b for a, b in spans_s) else (report,)


@dataclass(slots=True)
class Frozen:
    """Repeats the first report that it is given, by a clock that goes on."""

    held: Report | None = None

    def __call__(self, report: Report) -> Sequence[Report]:
        if report.taken_s >= FAULT_S:
            self.held = self.held or report
        held = self.held or report
        times = {"taken_s": report.taken_s, "sent_s": report.sent_s, "clock_s": report.clock_s}
        return (held._replace(**times),)


@dataclass(slots=True)
class Replayed:
    """Sends what it sent so long ago, with the times of then."""

    ago_s: float
    past: list[Report] = field(default_factory=list)

    def __call__(self, report: Report) -> Sequence[Report]:
        self.past.append(report)
        due = [each for each in self.past if each.taken_s <= report.taken_s - self.ago_s]
        return tuple(each._replace(sent_s=report.sent_s) for each in due[-1:])


def jumps(report: Report) -> Sequence[Report]:
    return (report._replace(latitude_deg=report.latitude_deg + 100.0 / 111_195.0),)


def clock_goes_back(report: Report) -> Sequence[Report]:
    return (report._replace(clock_s=report.clock_s - 60.0),)


def doubles(report: Report) -> Sequence[Report]:
    return (report, report)


def unknown(report: Report) -> Sequence[Report]:
    return (report._replace(latitude_deg=nan, longitude_deg=nan),)


def swapped(report: Report) -> Sequence[Report]:
    return (report._replace(latitude_deg=report.longitude_deg, longitude_deg=report.latitude_deg),)


FAULTS: Final[dict[str, Callable[[], Fault]]] = {
    "freezes": Frozen,
    "jumps": lambda: jumps,
    "replays": lambda: Replayed(10.0),
    "clock": lambda: clock_goes_back,
    "doubles": lambda: doubles,
    "unknown": lambda: unknown,
    "swapped": lambda: swapped,
}


class Seen(NamedTuple):
    """What is known of the target in one tick."""

    state: TrackState
    why: str
    source: int


class FailingTarget(MovingTarget):
    """A target that several receivers report, which fail."""

    def __init__(self, moving: Moving, senders: Sequence[Sender], seed: int) -> None:
        self._motion = motion(moving.motion, seed=seed, speed_m_s=moving.speed_m_s)
        self._due = [_sent(self._motion, sender) for sender in senders]
        self._waiting = [next(each) for each in self._due]
        self._settings = TrackedTarget(motion=moving.motion)
        self._estimate = TargetEstimate([Tracker(1.0, COAST_S, SourceClock(0.0)) for _ in senders])
        self.seen_so_far: list[Seen] = []

    def take(self, now_s: float) -> None:
        for source, due in enumerate(self._due):
            while self._waiting[source].sent_s <= now_s:
                self._estimate.trackers[source].take(self.report(self._waiting[source]), 0.0)
                self._waiting[source] = next(due)

    def seen(self, now_s: float, was: Target, limits: CenterLimits) -> Target:
        target = super().seen(now_s, was, limits)
        estimate = self._estimate
        self.seen_so_far.append(Seen(estimate.state(now_s), estimate.tracker.why, estimate.active))
        return target


class ThenExact(FailingTarget):
    """The same, but from each return of its receivers on the target's present motion is exact for a while."""

    returns_s: Sequence[float] = ()

    def seen(self, now_s: float, was: Target, limits: CenterLimits) -> Target:
        target = super().seen(now_s, was, limits)
        if not any(at <= now_s < at + EXACT_S for at in self.returns_s):
            return target
        place, before = self._motion(now_s), self._motion(now_s - TICK_S)
        return replace(
            target,
            x_m=place.north_m,
            y_m=place.east_m,
            velocity_x_m_s=place.north_m_s,
            velocity_y_m_s=place.east_m_s,
            acceleration_x_m_s2=(place.north_m_s - before.north_m_s) / TICK_S,
            acceleration_y_m_s2=(place.east_m_s - before.east_m_s) / TICK_S,
            deviation_m_s=0.0,
            time_s=now_s,
        )


@dataclass(frozen=True, slots=True, eq=False)
class FollowedFlight:
    """What was flown; k ticks."""

    time_s: Array  # (k,)
    center_m: Array  # (k, 2) commanded
    truth_m: Array  # (k, 2) of the target
    off_m: Array  # (k,) from the true target to the mean of the vehicles
    seen: Sequence[Seen]
    violations: int
    fastest_m_s: float  # of the centre
    hardest_m_s2: float

    def at(self, time_s: float) -> int:
        return int(np.searchsorted(self.time_s, time_s))

    @property
    def step_m(self) -> Array:
        """(k - 1,) of the centre in each tick."""
        return np.asarray(np.hypot(*np.diff(self.center_m, axis=0).T))


def follow(
    moving: Moving,
    senders: Sequence[Sender],
    seconds: float,
    seed: int = 0,
    *,
    exact_from_s: Sequence[float] = (),
) -> FollowedFlight:
    """Follow the target for so long; its receivers fail from `FAULT_S` on.

    From `exact_from_s` on, each time for `EXACT_S`, the estimate is the truth.
    """
    scenario = load(SCENARIO).model_copy(update={"duration_s": seconds}).in_world_of(seed)
    assert isinstance(scenario.flight, FormationFlight)
    run = FormationRun(scenario, scenario.flight, COUNT, seed)
    run.tracked = target = ThenExact(moving, senders, seed)
    target.returns_s = exact_from_s
    record = run.fly()
    truth_m = np.array(record.target_m)
    off_m = np.hypot(*(np.array(record.position_m)[:, :, :2].mean(axis=1) - truth_m).T)
    return FollowedFlight(
        np.array(record.time_s),
        np.array(record.center_m)[:, :2],
        truth_m,
        np.asarray(off_m),
        target.seen_so_far,
        len(record.violating),
        SPEED_SHARE * scenario.control.safety.limits.horizontal_m_s,
        float(min(run.settings.acceleration_max_m_s2, run.traits.response.acceleration_m_s2.min())),
    )


def _sent(truth: Motion, sender: Sender) -> Iterator[Report]:
    """Reports of one receiver, with its fault."""
    for report in reports(truth, ORIGIN, sender.errors, sender.seed):
        failed = sender.fault(report)
        yield from failed if report.taken_s >= FAULT_S else (report,)


class DroppedOut(NamedTuple):
    """How a flight went through drop-outs of 1, 3 and 10 s."""

    back_s: tuple[float, ...]  # until the centre was within the row's p95, and stayed for 1 s; inf: never
    least_s: tuple[
        float, ...
    ]  # until a centre that knows the target's way could be there, with its acceleration
    step: float  # greatest of the commanded centre in a tick, as a share of its greatest speed times the tick
    violations: int


DROP_OUTS_S: Final = ((25.0, 26.0), (41.0, 44.0), (59.0, 69.0))
LASTS_S: Final = 95.0


def drop_outs(name: str, seed: int = 0, later_s: float = 0.0, *, exact: bool = False) -> DroppedOut:
    """Fly over a target with drop-outs, which begin so much later than usual.

    With `exact` its motion is exact after each of them.
    """
    moving = MOVING[name]
    spans_s = [(begins_s + later_s, ends_s + later_s) for begins_s, ends_s in DROP_OUTS_S]
    sender = Sender(moving.errors, silent(*spans_s), seed)
    returns_s = [ends_s + moving.errors.delay_s for _, ends_s in spans_s] if exact else []
    flown = follow(moving, [sender], LASTS_S + later_s, seed, exact_from_s=returns_s)
    near, stays = flown.off_m <= moving.p95_m, round(1.0 / TICK_S)
    back_s, least_s = [], []
    for _, ends_s in spans_s:
        begin = flown.at(ends_s + moving.errors.delay_s)
        there = [at for at in range(begin, flown.at(ends_s + 25.0)) if near[at : at + stays].all()]
        back_s.append(round(float(flown.time_s[there[0]] - flown.time_s[begin]), 2) if there else inf)
        least_s.append(_least_s(flown, begin, moving.p95_m))
    return DroppedOut(
        tuple(back_s),
        tuple(least_s),
        float(flown.step_m.max()) / (flown.fastest_m_s * TICK_S),
        flown.violations,
    )


def _least_s(flown: FollowedFlight, begin: int, near_m: float) -> float:
    """No centre can be that near any sooner: with its acceleration, whatever it knows, at any speed."""
    moves_m_s = (flown.center_m[begin] - flown.center_m[begin - 1]) / TICK_S
    after_s = TICK_S * np.arange(len(flown.center_m) - begin)
    coasts_m = flown.center_m[begin] + after_s[:, None] * moves_m_s
    off_m = np.hypot(*(flown.truth_m[begin:] - coasts_m).T)
    reached = off_m - flown.hardest_m_s2 * after_s**2 / 2.0 <= near_m
    return float(after_s[np.argmax(reached)]) if reached.any() else inf


class Failed(NamedTuple):
    """What a source that fails does to the centre within `SEEN_S`, before the formation holds."""

    off_honest_m: float  # greatest distance of the centre from where an honest source has it
    off_silent_m: float  # from where a silent one has it
    noticed_s: float  # since the first such report could arrive; NaN: never
    why: str
    violations: int


SEEN_S: Final = 4.0


def failed(name: str, faults: Sequence[str], seed: int = 0) -> dict[str, Failed]:
    """Fly over a target with a source that fails, in each of these ways."""
    moving = MOVING[name]

    def flown(fault: Fault | None) -> FollowedFlight:
        sender = Sender(moving.errors, fault or (lambda report: (report,)), seed)
        seconds = FAULT_S + SEEN_S + moving.errors.delay_s
        return follow(moving, [sender], seconds, seed)

    honest, quiet = flown(None), flown(silent((FAULT_S, FAULT_S + 60.0)))
    return {fault: _failed(flown(FAULTS[fault]()), honest, quiet, moving.errors.delay_s) for fault in faults}


def _failed(flown: FollowedFlight, honest: FollowedFlight, quiet: FollowedFlight, delay_s: float) -> Failed:
    begin = flown.at(FAULT_S + delay_s)

    def off_m(other: FollowedFlight) -> float:
        many = min(len(flown.center_m), len(other.center_m))
        return float(np.hypot(*(flown.center_m[begin:many] - other.center_m[begin:many]).T).max())

    noticed = [at for at in range(begin, len(flown.seen)) if flown.seen[at].state is not TrackState.TRACKED]
    noticed_s = float(flown.time_s[noticed[0]] - flown.time_s[begin]) if noticed else nan
    return Failed(off_m(honest), off_m(quiet), noticed_s, flown.seen[-1].why, flown.violations)


class Switched(NamedTuple):
    """How a flight went on between two sources, of which the better one is lost and returns."""

    changes: int
    over_s: float  # longest from the first report that is missing until the other source counts
    jump_m: float  # greatest step of the centre, less that of the target, within 0.5 s of a change
    violations: int


TIMES, EVERY_S, GONE_S = 20, 6.0, 3.0


def switched(name: str, seed: int = 0) -> Switched:
    """Fly over a target with a source of 0.3 m, lost `TIMES` times, and one of 1.5 m."""
    moving = MOVING[name]
    lost_s = [FAULT_S + number * EVERY_S for number in range(TIMES)]
    better = replace(moving.errors, noise_m=0.3)
    senders = [
        Sender(better, silent(*((begin_s, begin_s + GONE_S) for begin_s in lost_s)), seed),
        Sender(replace(moving.errors, noise_m=1.5), seed=seed + 100),
    ]
    seconds = lost_s[-1] + EVERY_S
    flown = follow(moving, senders, seconds, seed)
    is_other = np.array([each.source == 1 for each in flown.seen])
    changes = np.flatnonzero(np.diff(is_other)) + 1
    over_s = [
        float(flown.time_s[at] - begin_s) - moving.errors.delay_s
        for begin_s in lost_s
        for at in [flown.at(begin_s) + int(np.argmax(is_other[flown.at(begin_s) :]))]
    ]
    steps_m = np.hypot(*(np.diff(flown.center_m, axis=0) - np.diff(flown.truth_m, axis=0)).T)
    jumps_m = [float(steps_m[at - 1 : at + 10].max()) for at in changes]
    return Switched(len(changes), max(over_s), max(jumps_m), flown.violations)
