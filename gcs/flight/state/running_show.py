"""The selected show: its clock, the vehicles' parts, and its live target."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.control.inputs import DrawnGoals
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Obstacle, Plan, Target
from gcs.model.state import Array, VehicleId
from gcs.service import BeginView, CueMark, SelectedShow, ShowFigures
from gcs.shows import ShowClock, Timeline
from gcs.shows.drawn import Motion
from gcs.shows.following import DrawnPace, TrackErrors, assigned
from gcs.shows.format import Drawing
from gcs.shows.tempo import Tempo
from gcs.shows.timeline import Live

LONGEST_STEP_S = 0.2
"""After a longer pause between ticks the clock waits for no more than this."""

SLOWEST_M_S = 1e-3
"""An orbit has a speed, also of a show that stands still."""

ENDS_WITHIN_S = 1.0
"""A show that ends this near to its end has come to it: another station's clock may be behind the lead's."""

OVER = frozenset({ShowPhase.IDLE, ShowPhase.LANDED})


class ShowFleet(NamedTuple):
    """n vehicles among which a show is played: first those of FleetState, then those flown elsewhere."""

    ids: Sequence[VehicleId]  # n
    position_m: Array  # (n, 3), show frame, NaN where not known
    formed: NDArray[np.bool_]  # (n,) flies with the show
    own: int  # number of the first ones, for which goals are made


@dataclass(slots=True, eq=False)
class ShowRun:
    """Runtime state of one show. Changed on the event loop only; every `now_s` is the tick's own time."""

    name: str
    timeline: Timeline
    clock: ShowClock = ShowClock()
    live: Target | None = None  # the newest update, since the target became live
    started: bool = False  # by a command that named its hash; False again once all vehicles are down
    parts: dict[VehicleId, int] = field(default_factory=dict)  # rows of the lights
    figures: ShowFigures | None = None  # results of its check; None: not known
    received: bool = False  # from another flight, which has its file and its check
    pace: DrawnPace = DrawnPace()  # of the clock in a drawn part
    goals: DrawnGoals | None = None  # of this tick, rows as in FleetState; None: the law leads
    off_m: Array = field(default_factory=lambda: np.zeros(0))  # (n,) from them; NaN: takes no part, not known
    errors: TrackErrors | None = (
        None  # of the vehicles by row of `ShowFleet`, since the start; None: no drawn part
    )
    lags_reported: bool = False
    spares: tuple[VehicleId, ...] = ()  # on the ground, in the fleet's order
    arriving: set[VehicleId] = field(default_factory=set)  # spares that are not at their trajectories yet
    tempo: Tempo = Tempo()  # of the clock beside the pace: an external clock changes it
    begun: bool = False  # its clock has run since the start
    begins_s: float | None = None  # the tick's time from which the clock runs, once it runs; None: at once
    begin: BeginView | None = None  # how it waits for its beginning; None: it begins as soon as it can
    _followed_s: float | None = None  # when the goals were made last
    _ended_s: float | None = None  # the tick's time at which it came to its end; its lights go on
    cue_times: tuple[CueMark, ...] = field(init=False)  # of every cue as played

    def __post_init__(self) -> None:
        self.cue_times = tuple(CueMark(played.cue.cue, played.at_s) for played in self.timeline.played)

    @property
    def hash(self) -> str:
        """Hash of everything that is flown."""
        return self.timeline.show.digest

    @property
    def obstacle_ids(self) -> frozenset[str]:
        return frozenset(box.id for box in self.obstacles)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        return tuple({box: None for _, standing in self.timeline.obstacles for box in standing})

    def lit_s(self, now_s: float) -> float:
        """The time of its lights, which goes on after the show's end."""
        after_s = 0.0 if self._ended_s is None else now_s - self._ended_s
        return self.show_s(now_s) + after_s

    def show_s(self, now_s: float) -> float:
        """The show's own time, within the show."""
        return min(max(self.clock.show_s(now_s), 0.0), self.timeline.duration_s)

    @property
    def rate(self) -> float:
        """How fast its clock runs, while it runs."""
        return self.tempo.rate * (1.0 if self.goals is None else self.pace.rate)

    @property
    def moves(self) -> bool:
        """Whether vehicles follow their trajectories; False: they fly to where a part begins."""
        return self.clock.runs and not self.pace.approaches

    @property
    def there(self) -> bool:
        """Whether all vehicles in formation are where the drawing has them, or have had the time for it."""
        return not self.pace.approaches

    @property
    def exchanges_pads(self) -> bool:
        """Whether the vehicles' pads are assigned anew where the return begins."""
        named = self.timeline.show.drawing
        return self.started and named is not None and named.lands == "nearest"

    @property
    def spares_most(self) -> int:
        """Number of vehicles that may stand by on the ground."""
        named = self.timeline.show.drawing
        return 0 if named is None or named.spares is None else named.spares.count

    def takes_spares(self, now_s: float) -> bool:
        """Whether a vehicle that is lost now is replaced: its cue has not begun."""
        named = self.timeline.show.drawing
        if named is None or named.spares is None:
            return False
        cue = named.spares.before_cue
        begins_s = min(played.at_s for played in self.timeline.played if played.cue.cue == cue)
        return self.show_s(now_s) < begins_s

    def replace(self, lost: VehicleId, spare: VehicleId) -> None:
        """Give the part of a vehicle to a spare one."""
        self.spares = tuple(name for name in self.spares if name != spare)
        self.parts[spare] = self.parts.pop(lost)
        self.arriving.add(spare)

    def give_back(self, spare: VehicleId, lost: VehicleId) -> None:
        """Take the part from a spare vehicle that did not take off; it is no spare any more."""
        if spare in self.parts:
            self.parts[lost] = self.parts.pop(spare)
        self.arriving.discard(spare)

    def assign(self, chosen: Sequence[VehicleId], start_m: Array) -> None:
        """Give each vehicle its part: its trajectory and its light.

        Args:
            chosen: that start, in the fleet's order.
            start_m: (k, 3) where they stand.
        """
        drawing, named = self.timeline.drawing, self.timeline.show.drawing
        parts = np.arange(len(chosen))
        if drawing is not None and named is not None and named.pads == "nearest":
            parts = assigned(start_m, drawing.trajectories.at(self.timeline.parts[0].from_s).position_m)
        self.parts = dict(zip(chosen, parts.tolist(), strict=True))
        self.errors, self.lags_reported = None, False

    def lags(self, vehicle_ids: Sequence[VehicleId]) -> str:
        """Describe by how much each vehicle was off its trajectory, the farthest first; empty without any."""
        if self.errors is None:
            return ""
        rms_m, max_m = self.errors.rms_m, self.errors.max_m
        flown = [row for row in np.argsort(-max_m).tolist() if self.errors.time_s[row] > 0.0]
        return ", ".join(f"{vehicle_ids[row]} {rms_m[row]:.2f} ({max_m[row]:.2f})" for row in flown)

    def follow_drawing(self, seen: ShowFleet, now_s: float, *, assembling: bool, leads: bool = True) -> None:
        """Make the goals of this tick, and have the clock wait for late vehicles. Call once a tick.

        Args:
            seen: the vehicles, the same in every tick.
            now_s: the tick's time.
            assembling: the vehicles are on the way to where the show begins, or goes on.
            leads: False: clock, pace and tempo are those of another station.
        """
        named, motion = self.timeline.show.drawing, self.timeline.motion_at(self.show_s(now_s))
        before_s, self._followed_s = self._followed_s, now_s
        dt_s = 0.0 if before_s is None else min(now_s - before_s, LONGEST_STEP_S)
        if named is None or motion is None:
            self.goals = None
            if leads:
                self.pace = DrawnPace()
                self._hold_back(1.0 - self.tempo.rate, dt_s)
            return
        part = np.array([self.parts.get(name, -1) for name in seen.ids], dtype=np.intp)
        rows = np.flatnonzero(part >= 0)
        off_m = np.full(len(seen.ids), np.nan)
        off_m[rows] = np.linalg.norm(seen.position_m[rows] - motion.position_m[part[rows]], axis=1)
        off_m[~seen.formed] = np.nan
        self.off_m = off_m
        tracked_m = self._tracked_m(seen.ids, off_m, named.waits_from_m)
        if self.clock.runs and not self.pace.approaches and dt_s > 0.0:
            errors = self.errors or TrackErrors.none(len(seen.ids))
            self.errors = errors.noted(tracked_m, dt_s)
        if leads:
            self._step_pace(motion.of(part[rows]), named, dt_s, assembling=assembling)
        self._make_goals(part[: seen.own], motion, now_s)

    def _step_pace(self, motion: Motion, named: Drawing, dt_s: float, *, assembling: bool) -> None:
        """Let the clock run, wait, or slow down for vehicles that are late."""
        if not (self.clock.runs or assembling):
            self.pace = DrawnPace()
        elif dt_s > 0.0 and (self.clock.runs or self.pace.approaches):  # else it waits for its beginning
            self.pace = self.pace.step(motion, self.off_m, dt_s, named)
            self._hold_back(1.0 - self.pace.rate * self.tempo.rate, dt_s)

    def _hold_back(self, share: float, dt_s: float) -> None:
        """Have a clock that runs lose this share of the time; negative: it runs faster."""
        if self.clock.runs:
            self.clock = self.clock.later(share * dt_s)

    def _make_goals(self, part: NDArray[np.intp], motion: Motion, now_s: float) -> None:
        """Make the goals of vehicles with these parts (n,), -1: none; `motion` holds outside the drawing."""
        rows, show_s = np.flatnonzero(part >= 0), self.show_s(now_s)
        motion, yaw_rad = self.timeline.motion_at(show_s) or motion, self.timeline.yaw_at(show_s)
        yaw_rad = None if yaw_rad is None else yaw_rad[part[rows]]
        pace, tempo = self.pace, self.tempo
        change_per_s = pace.rate_per_s * tempo.rate + pace.rate * tempo.rate_per_s
        pace = replace(pace, rate=pace.rate * tempo.rate, rate_per_s=change_per_s)
        self.goals = pace.goals(motion.of(part[rows]), rows, len(part), yaw_rad)

    def _tracked_m(self, vehicle_ids: Sequence[VehicleId], off_m: Array, there_m: float) -> Array:
        """(n,) Distances that count as track errors: not those of spares on their way."""
        if not self.arriving:
            return off_m
        self.arriving -= {
            name for name, off in zip(vehicle_ids, off_m.tolist(), strict=True) if off < there_m
        }
        on_the_way = np.array([name in self.arriving for name in vehicle_ids], dtype=np.bool_)
        return np.where(on_the_way, np.nan, off_m)

    def follow(self, phase: ShowPhase, now_s: float) -> None:
        """Run the clock while the show runs; a pause stops it, and the end resets it."""
        if phase is ShowPhase.RUNNING:
            self.clock = self.clock.run(now_s if self.begins_s is None else self.begins_s)
            self.begun, self.begins_s, self._ended_s = True, None, None
        else:
            at_end = self.begun and self.clock.show_s(now_s) > self.timeline.duration_s - ENDS_WITHIN_S
            self._ended_s = now_s if at_end and self._ended_s is None else self._ended_s
            self.clock = self.clock.stop(now_s)
        if phase is not ShowPhase.RUNNING:
            self._followed_s, self.pace = None, DrawnPace()
        if phase in OVER and self.started:
            self.clock, self.started, self.live, self._ended_s = ShowClock(), False, None, None
            self.tempo, self.begun, self.begin = Tempo(), False, None

    def is_live(self, now_s: float) -> bool:
        return isinstance(self.timeline.leg_at(self.show_s(now_s)), Live)

    @property
    def has_live(self) -> bool:
        """Whether the target is live at any of its cues."""
        return any(played.cue.target == "live" for played in self.timeline.played)

    def is_over(self, now_s: float) -> bool:
        return self.clock.ended(self.timeline, now_s)

    def cue(self, now_s: float) -> str:
        return self.timeline.cue_at(self.show_s(now_s)).cue.cue

    def desired(self, now_s: float) -> Plan:
        """Return the show's plan at this time, with all its obstacles. Target times are the tick's."""
        if not self.is_live(now_s):
            self.live = None  # an update does not apply to the next live target
        plan = self.timeline.plan_at(
            self.clock.show_s(now_s), clock_s=now_s, runs=self.clock.runs, live=self.live
        )
        return plan if self.tempo.rate == 1.0 else self._slowed(plan)

    def _slowed(self, plan: Plan) -> Plan:
        """Have what moves by itself keep the tempo: spin, orbit and the target on its way."""
        rate, orbit, target = self.tempo.rate, plan.orbit, plan.target
        if target is not self.live:
            speeds = target.velocity_x_m_s * rate, target.velocity_y_m_s * rate
            target = replace(target, velocity_x_m_s=speeds[0], velocity_y_m_s=speeds[1])
        return replace(
            plan,
            formation=replace(plan.formation, spin_rad_s=plan.formation.spin_rad_s * rate),
            orbit=replace(orbit, speed_m_s=max(orbit.speed_m_s * rate, SLOWEST_M_S)),
            target=target,
        )

    def colours(
        self, vehicle_ids: Sequence[VehicleId], now_s: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """(n, 3) red, green, blue of each vehicle, and (n,) which play a part; other rows mean nothing."""
        part = np.array([self.parts.get(name, -1) for name in vehicle_ids], dtype=np.intp)
        lit = part >= 0
        colour = np.zeros((len(vehicle_ids), 3), np.uint8)
        colour[lit] = self.timeline.colours_at(self.lit_s(now_s))[part[lit]]
        return colour, lit

    def view(self, now_s: float) -> SelectedShow:
        return SelectedShow(
            name=self.name,
            hash=self.hash,
            cue=self.cue(now_s),
            cues=tuple(dict.fromkeys(played.cue.cue for played in self.timeline.played)),
            clock_s=self.show_s(now_s),
            duration_s=self.timeline.duration_s,
            runs=self.clock.runs,
            target_is_live=self.is_live(now_s),
            timeline=self.cue_times,
            track_rms_m=None if self.errors is None else round(self.errors.fleet_rms_m, 3),
            track_max_m=None if self.errors is None else round(float(self.errors.max_m.max()), 2),
            spares=self.spares,
            begin=self.begin,
            begun=self.begun,
            lit_until_s=self.timeline.lit_until_s,
        )
