"""Flies a show in virtual time: hover, assembly, timeline, return."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import hypot

import numpy as np

from gcs.control import Task, Tasks
from gcs.control.inputs import DrawnGoals
from gcs.failsafe.policy import Action, Cause, FailsafePolicy
from gcs.flight.fleet import stands
from gcs.model.errors import RefusedError
from gcs.model.plan import Obstacle, Plan
from gcs.model.state import Array
from gcs.shows import Flaw, LoadedShow, Played
from gcs.shows.following import DrawnPace, TrackErrors, assigned
from gcs.simulation.flight import SimulatedFlight
from gcs.simulation.scenario import Adversity, Box, FormationFlight, Judged, Scenario, Wind, World

ASSEMBLED_BY_S = 120.0
"""Time limit of the assembly."""

HOME_BY_S = 400.0
"""Time limit of the return."""

ASSEMBLED_IN_S = 10.0
HOME_IN_S = 30.0
"""Typical duration of the return in the shipped shows, for the estimate of progress."""

REPORT_S = 1.0
"""Virtual time between two reports of progress."""


class Rehearsal(SimulatedFlight):
    """One flight of a show; `flaws` has the problems that occurred."""

    def __init__(
        self,
        loaded: LoadedShow,
        world: World,
        seed: int,
        on_progress: Callable[[float], None] | None = None,
        adversity: Adversity | None = None,
    ) -> None:
        """Hover above the pads.

        Args:
            loaded: the show.
            world: vehicles and links.
            seed: of the vehicles' errors, and of which are lost.
            on_progress: called with the share that is flown.
            adversity: what the show does not know of; None: nothing.
        """
        adversity = adversity or Adversity()
        self._on_progress, self._report_at_s = on_progress, 0.0
        show, timeline = loaded.show, loaded.timeline
        self.loaded, self.timeline = loaded, timeline
        self.show_s: list[float] = []  # the show's time at every tick, below 0 before it began
        self.errors = TrackErrors.none(show.fleet.vehicles)  # true ones, in drawn parts
        self.off_m: list[Array] = []  # (n,) of each tick, likewise; NaN where no drawn part ran
        self._pace, self._clock_s = DrawnPace(), 0.0
        self._goals: DrawnGoals | None = None
        self.began_s: float | None = None  # when the sphere stood and the show's clock started
        self.ended_s: float | None = None  # when the return began
        self.flaws: list[Flaw] = []
        self._refused: set[str] = set()
        self._named = 0  # failsafes that acted, and are among the flaws
        first = timeline.plan_at(0.0)
        flight = FormationFlight(
            kind="formation",
            radius_m=first.formation.radius_m,
            height_m=first.formation.height_m,
            law=first.formation.law,
            takeoff_height_m=show.fleet.takeoff_height_m,
            loss=adversity.loss,
        )
        scenario = Scenario(
            name=loaded.name,
            about=show.about,
            duration_s=ASSEMBLED_BY_S + timeline.duration_s + HOME_BY_S,
            flight=flight,
            judged=Judged(vehicles=(show.fleet.vehicles,)),
            world=world,
            control=show.control,
            failsafes=FailsafePolicy(),
        )
        start_m = show.pads_m - (0.0, 0.0, show.fleet.takeoff_height_m)
        super().__init__(scenario, start_m, np.full_like(start_m, np.nan), first, seed)
        self.task[:] = Task.FORMATION
        self._unknown: tuple[Obstacle, ...] = ()  # obstacles that are not the show's
        self._stand(adversity.boxes)
        self.trajectory_of = np.arange(show.fleet.vehicles)  # (n,) row of each vehicle's trajectory
        if loaded.drawing is not None and show.drawing is not None and show.drawing.pads == "nearest":
            first_m = loaded.drawing.trajectories.at(timeline.parts[0].from_s).position_m
            self.trajectory_of = assigned(start_m, first_m)

    def _stand(self, boxes: Sequence[Box]) -> None:
        """Have obstacles stand that the show does not know of; one in the way of a vehicle is a flaw."""
        for number, box in enumerate(boxes, 1):
            obstacle = Obstacle(f"unknown box {number}", **box.model_dump())
            try:
                self.check_box(obstacle)
            except RefusedError as error:
                self.flaws.append(Flaw(("timeline", 0), str(error)))
            else:
                self._unknown = (*self._unknown, obstacle)
        self.plan = replace(self.plan, obstacles=(*self.plan.obstacles, *self._unknown))

    def before_tick(self) -> None:
        if self._on_progress is not None and self.time_s >= self._report_at_s:
            self._report_at_s = self.time_s + REPORT_S
            self._on_progress(self.share_flown())
        for when_s, cause, action in self.record.failsafes[self._named :]:
            if (cause, action) == (Cause.VEHICLE_LOST, Action.RE_FORM):
                continue  # which the loss asks for
            if (cause, action) == (Cause.VEHICLES_LOST, Action.RETURN) and self.ended_s is not None:
                continue  # few fly any more, and these return already
            words = f"failsafe '{cause}' acts {when_s:.0f} s after the assembly began: {action}"
            self.flaws.append(Flaw(("timeline", 0), words))
        self._named = len(self.record.failsafes)
        if self.began_s is None:
            self._assemble()
        elif self.ended_s is None and not self._follow(self._clock_s):
            self._clock_s += self.world.tick_s
        if self.began_s is not None and self.ended_s is None:
            self._play(self._clock_s)
        self.show_s.append(-1.0 if self.began_s is None else self._clock_s)
        if self.ended_s is not None:
            self._goals = None
            begin = self.center_moves
            self.center_moves = False
            if begin:
                self._exchange_pads()
            self.come_home(self.loaded.show.fleet.takeoff_height_m, begin=begin)

    def led(self, tasks: Tasks) -> Tasks:
        if self._goals is None:
            return tasks
        return tasks.led_by(self._goals, moves=not self._pace.approaches)

    def _exchange_pads(self) -> None:
        """Assign the pads anew, as in flight, if the show says so and lost vehicles do not fly to theirs."""
        named = self.loaded.show.drawing
        if named is None or named.lands != "nearest" or self.losses.loss.action == "return":
            return
        rows = np.flatnonzero((self.task == Task.FORMATION) & self.present)
        self.pads_m = self.world.home_m.copy()
        self.pads_m[rows] = self.pads_m[rows][assigned(self.world.received_m[rows], self.pads_m[rows])]

    def _follow(self, show_s: float) -> bool:
        """Have the drawing lead, and the clock run as vehicles keep up. Returns: False if the law leads."""
        drawing, motion, dt_s = self.loaded.show.drawing, self.timeline.motion_at(show_s), self.world.tick_s
        off_m = np.full(len(self.task), np.nan)
        if drawing is None or motion is None:
            self._pace, self._goals = DrawnPace(), None
            self.off_m.append(off_m)
            return False
        motion = motion.of(self.trajectory_of)
        flies = (self.task == Task.FORMATION) & self.present
        away_m = np.linalg.norm(self.world.received_m - motion.position_m, axis=1)
        self._pace = self._pace.step(motion, np.where(flies, away_m, np.nan), dt_s, drawing)
        self._clock_s += self._pace.rate * dt_s
        moved = self.timeline.motion_at(self._clock_s)
        motion = motion if moved is None else moved.of(self.trajectory_of)
        yaw_rad = self.timeline.yaw_at(self._clock_s)
        yaw_rad = None if yaw_rad is None else yaw_rad[self.trajectory_of]
        self._goals = self._pace.goals(motion, np.arange(len(flies)), len(flies), yaw_rad)
        if not self._pace.approaches:
            true_m = np.linalg.norm(self.world.position_m - motion.position_m, axis=1)
            cut = self.losses.rows & (self.time_s >= self.losses.loss.at_s)
            off_m[flies & ~cut] = true_m[flies & ~cut]
        self.errors = self.errors.noted(off_m, dt_s)
        self.off_m.append(off_m)
        return True

    def return_now(self) -> None:
        if self.ended_s is None:
            self.began_s = self.time_s if self.began_s is None else self.began_s
            self.ended_s, self.center_moves = self.time_s, True

    def share_flown(self) -> float:
        """Finished share of the flight, from 0 to 1: exact within the timeline, estimated elsewhere."""
        timeline_s = self.timeline.duration_s
        if self.began_s is None:
            done_s = min(self.time_s, ASSEMBLED_IN_S)
        elif self.ended_s is None:
            done_s = ASSEMBLED_IN_S + self._clock_s
        else:
            done_s = ASSEMBLED_IN_S + timeline_s + min(self.time_s - self.ended_s, HOME_IN_S)
        return done_s / (ASSEMBLED_IN_S + timeline_s + HOME_IN_S)

    def finished(self) -> bool:
        return self.ended_s is not None and not (self.record.in_air[-1] & ~self.losses.known).any()

    def _assemble(self) -> None:
        if self._follow(0.0):
            self.began_s = None if self._pace.approaches else self.time_s
            self.center_moves = self.began_s is not None
            return
        center = self.memory.center
        charge = np.array(self.traits.charge)
        if center is not None and stands(
            self.world.received_m - center.position_m, self.memory.radius_m, charge
        ):
            self.began_s = self.time_s
        elif self.time_s > ASSEMBLED_BY_S:
            words = f"the sphere does not stand after {ASSEMBLED_BY_S:g} s"
            self.flaws.append(Flaw(("timeline", 0), words))
            self.began_s = self.time_s
        self.center_moves = self.began_s is not None

    def _play(self, show_s: float) -> None:
        plan = self.timeline.plan_at(show_s, clock_s=self.time_s)
        self.plan = self._with_possible_obstacles(plan, self.timeline.cue_at(show_s))
        if show_s >= self.timeline.duration_s:
            self.ended_s = self.time_s

    def _with_possible_obstacles(self, plan: Plan, one: Played) -> Plan:
        """Refuse, as in flight, obstacles that would contain a vehicle or appear too close ahead of one."""
        known = {box.id for box in self.plan.obstacles}
        possible: list[Obstacle] = []
        for box in plan.obstacles:
            if box.id not in known and box.id not in self._refused:
                try:
                    self.check_box(box)
                except RefusedError as error:
                    self._refused.add(box.id)
                    self.flaws.append(Flaw(("timeline", one.index, "obstacles"), str(error)))
            if box.id not in self._refused:
                possible.append(box)
        self._refused &= {box.id for box in plan.obstacles}
        return Plan(plan.formation, plan.orbit, plan.target, (*possible, *self._unknown), plan.yaw)


def rehearse(
    loaded: LoadedShow,
    seed: int = 1,
    on_progress: Callable[[float], None] | None = None,
    adversity: Adversity | None = None,
    wind_m_s: tuple[float, float] = (0.0, 0.0),
) -> Rehearsal:
    """Fly a show once, with the recorded errors of the vehicles' position estimates.

    Args:
        loaded: the show.
        seed: of these errors, and of which vehicles are lost.
        on_progress: called with the share of the flight that is done, from 0 to 1.
        adversity: losses, and obstacles that the show does not know of; None: none.
        wind_m_s: along the show's x and y; its gusts have a standard deviation of `GUSTS` of it.
    """
    speed_m_s = hypot(*wind_m_s)
    wind = Wind(mean_x_m_s=wind_m_s[0], mean_y_m_s=wind_m_s[1], gust_m_s=GUSTS * speed_m_s)
    drag_per_s = WIND_DRAG_PER_S if speed_m_s else World().drag_per_s
    flight = Rehearsal(
        loaded, World(noise=1.0, wind=wind, drag_per_s=drag_per_s), seed, on_progress, adversity
    )
    flight.fly()
    return flight


GUSTS = 0.125
WIND_DRAG_PER_S = 0.2
"""Of real quadrotors; that of PX4's simulator is 1.0."""
