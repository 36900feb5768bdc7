"""Flies a show in virtual time: hover, assembly, timeline, return."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import hypot

import numpy as np

from gcs.control import ControlSettings, Task, Tasks
from gcs.control.law_step import LawRunner
from gcs.failsafe.policy import Action, Cause, FailsafePolicy
from gcs.flight.commands.spares import climb_is_free, replacements
from gcs.flight.maneuvers.maneuvers import UP_SHARE
from gcs.flight.state.flight import SETTLES_S, in_shape
from gcs.flight.state.running_show import ShowFleet, ShowRun
from gcs.formation.laws.protocol import GoalShape
from gcs.formation.laws.registry import law_of
from gcs.model.errors import ConfigError, RefusedError, ShowError
from gcs.model.plan import Obstacle, Plan
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.return_paths.closed_ways import closed_places
from gcs.shows import Flaw, LoadedShow, Played
from gcs.shows.following import APPROACH_MAX_S, TrackErrors, assigned
from gcs.shows.format import control_of
from gcs.shows.service_rules import ServiceRules
from gcs.simulation.random_sites import drawn_site
from gcs.simulation.scenario import Adversity, FormationFlight, Judged, Scenario, ScenarioBox, Wind, World
from gcs.simulation.simulated_flight import SimulatedFlight

ASSEMBLED_BY_S = 120.0
"""Time limit of the assembly."""

HOME_BY_S = 400.0
"""Time limit of the return."""

ASSEMBLED_IN_S = 10.0
HOME_IN_S = 30.0
"""Typical duration of the return in the shipped shows, for the estimate of progress."""

TAKEOFF_M_S = 1.5
"""MPC_TKO_SPEED."""


@dataclass(frozen=True, slots=True)
class Replacement:
    """A spare that takes off for a lost vehicle."""

    lost: int  # rows
    spare: int
    tick: int  # in which it takes off


class Rehearsal(SimulatedFlight):
    """One flight of a show; `flaws` has the problems that occurred.

    Where vehicles are lost, the show's spares stand on their places: rows after those of its vehicles.
    """

    def __init__(
        self,
        loaded: LoadedShow,
        world: World,
        seed: int,
        adversity: Adversity | None = None,
        rules: ServiceRules | None = None,
    ) -> None:
        """Hover above the pads.

        Args:
            loaded: the show.
            world: vehicles and links.
            seed: of the vehicles' errors, and of which are lost.
            adversity: what the show does not know of; None: nothing.
            rules: of the service that is to fly it, with the areas of its fence; None: it has none.
        """
        adversity = adversity or Adversity()
        show, timeline = loaded.show, loaded.timeline
        self.loaded, self.timeline = loaded, timeline
        count = show.fleet.vehicles
        places_m = show.start_places_m if adversity.loss.share else show.pads_m
        self.show_s: list[float] = []  # the show's time at every tick, below 0 before it began
        self.errors = TrackErrors.none(len(places_m))  # true ones, in drawn parts
        self.own_errors = self.errors  # the same of where the vehicles themselves estimate to be
        self.off_m: list[Array] = []  # (n,) of each tick, likewise; NaN where no drawn part ran
        self.began_s: float | None = None  # when the sphere stood and the show's clock started
        self.ended_s: float | None = None  # when the return began
        self.flaws: list[Flaw] = []
        self._refused: set[str] = set()
        self._named = 0  # failsafes that acted, and are among the flaws
        self._law_named = False  # which is among them
        self._shaped_s = np.inf  # since when the vehicles are where the law leads, where that is no sphere
        first = timeline.plan_at(0.0)
        self.rules = rules = rules or ServiceRules()
        control = control_of(show, rules.usual, timeline.areas)
        scenario = _scenario(loaded, world, adversity, first, control, spares=len(places_m) - count)
        if adversity.site is not None:
            open_m = float(np.linalg.norm(places_m[:, :2], axis=1).max()) + first.formation.radius_m
            random = np.random.default_rng([seed, 7])
            scenario = drawn_site(scenario, adversity.site, random, open_m).scenario
        start_m = places_m.copy()
        start_m[:count, 2] -= show.fleet.takeoff_height_m
        super().__init__(scenario, start_m, np.full_like(start_m, np.nan), first, seed)
        self.stands_by = np.arange(len(start_m)) >= count  # (n,) spares on the ground
        self.replaced: list[Replacement] = []
        self.world.stand(self.stands_by)
        self.task[~self.stands_by] = Task.FORMATION
        self._unknown: tuple[Obstacle, ...] = ()  # obstacles that are not the show's
        self._stand(adversity.boxes)
        ids = self.world.ids
        self.run = ShowRun(loaded.name, timeline, spares=ids[count:])
        self.run.assign(ids[:count], start_m[:count])
        self.trajectory_of = np.full(len(start_m), -1)  # (n,) row of each vehicle's trajectory, -1: none yet
        self.trajectory_of[:count] = [self.run.parts[name] for name in ids[:count]]

    def _stand(self, boxes: Sequence[ScenarioBox]) -> None:
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
        for when_s, cause, action in self.record.failsafes[self._named :]:
            if (cause, action) == (Cause.VEHICLE_LOST, Action.RE_FORM):
                continue  # which the loss asks for
            if (cause, action) == (Cause.VEHICLES_LOST, Action.RETURN) and self.ended_s is not None:
                continue  # few fly any more, and these return already
            words = f"failsafe '{cause}' acts {when_s:.0f} s after the assembly began: {action}"
            self.flaws.append(Flaw(("timeline", 0), words))
        self._named = len(self.record.failsafes)
        self._name_law_failure()
        if self.ended_s is None:
            self._replace_lost()
            leads = self._follow()
            if self.began_s is None:
                self._assemble(leads)
        if self.began_s is not None and self.ended_s is None:
            self._play()
        self.show_s.append(-1.0 if self.began_s is None else self.run.show_s(self.time_s))
        if self.ended_s is not None:
            begin = self.center_moves
            self.center_moves = False
            if begin:
                self._exchange_pads()
            self.come_home(self.loaded.show.fleet.takeoff_height_m, begin=begin)

    def _runner(self) -> LawRunner | None:
        """Raises: ShowError when the law's process does not begin: its settings do not fit, or it fails."""
        try:
            return super()._runner()
        except ConfigError as error:
            key = "law_settings" if self.loaded.show.law_settings else "law"
            raise ShowError(self.loaded.file, [self.loaded.problem(Flaw((key,), str(error)))]) from None

    def _name_law_failure(self) -> None:
        """Have all return, as an operator does, once the law is not relied on any more: all hold."""
        if self.record.law_failed is None:
            return
        if not self._law_named:
            when_s, why = self.record.law_failed
            words = f"law {self.plan.formation.law} fails {when_s:.0f} s after the assembly began: {why}"
            self.flaws.append(Flaw(("law",), words))
        self._law_named = True
        if self.began_s is None:
            self._begin()  # for one tick: what is judged is the show
        else:
            self.return_now()

    @property
    def steered(self) -> Mask:
        return super().steered & (self.run.goals is None)

    def led(self, tasks: Tasks) -> Tasks:
        if self.run.goals is None or self.ended_s is not None:
            return tasks
        return tasks.led_by(self.run.goals, moves=not self.run.pace.approaches)

    def _exchange_pads(self) -> None:
        """Assign the pads anew, as in flight, if the show says so and lost vehicles do not fly to theirs."""
        named = self.loaded.show.drawing
        if named is None or named.lands != "nearest" or self.losses.loss.action == "return":
            return
        rows = np.flatnonzero((self.task == Task.FORMATION) & self.present)
        self.pads_m = self.world.home_m.copy()
        self.pads_m[rows] = self.pads_m[rows][assigned(self.world.received_m[rows], self.pads_m[rows])]

    def _replace_lost(self) -> None:
        """Have spares take off for lost vehicles, by the rules of the flight, and join once they are up."""
        ids, row_of, fleet = self.world.ids, self.world.row_of, self.loaded.show.fleet
        lost, in_air = [ids[row] for row in np.flatnonzero(self.losses.known)], self.world.in_air.copy()

        def may_climb(name: VehicleId) -> bool:
            return self._may_climb(row_of[name], in_air)

        for gone, spare in replacements(self.run, self.time_s, lost, may_climb):
            row = row_of[spare]
            self.replaced.append(Replacement(row_of[gone], row, len(self.show_s)))
            self.trajectory_of[row] = self.run.parts[spare]
            self.world.take_off(np.arange(len(in_air)) == row, TAKEOFF_M_S)
        up = -self.world.received_m[:, 2] >= UP_SHARE * fleet.takeoff_height_m
        joins = self.stands_by & self.world.in_air & up
        self.task[joins] = Task.FORMATION
        self.stands_by = self.stands_by & ~joins

    def _may_climb(self, row: int, in_air: Mask) -> bool:
        here_m, height_m = self.world.received_m, self.loaded.show.fleet.takeoff_height_m
        losses, uncertainty_m = self.losses, np.array(self.traits.uncertainty_m)
        closed = losses.segments_m, uncertainty_m[losses.segments_of]
        place_m, own_m = here_m[row : row + 1], uncertainty_m[row : row + 1]
        free = climb_is_free(here_m[row], here_m[in_air], height_m)
        return free and not bool(closed_places(place_m, height_m, self.floor, own_m, closed)[0])

    def _follow(self) -> bool:
        """Have the drawing lead, and the clock run as vehicles keep up. Returns: False if the law leads."""
        run, world = self.run, self.world
        flies, assembling = (self.task == Task.FORMATION) & self.present, self.began_s is None
        seen = ShowFleet(world.ids, world.received_m, flies, len(flies))
        approached = run.pace.approaches
        run.follow_drawing(seen, self.time_s, assembling=assembling)
        if approached and run.goals is not None and not run.pace.approaches:
            self._note_absent(run.off_m)
        off_m = np.full(len(self.task), np.nan)
        if run.goals is not None and not run.pace.approaches:
            true_m = np.linalg.norm(world.position_m - run.goals.position_m, axis=1)
            cut = self.losses.rows & (self.time_s >= self.losses.loss.at_s)
            counts = flies & ~cut & ~np.isin(world.ids, list(run.arriving))
            off_m[counts] = true_m[counts]
        if (goals := run.goals) is not None:
            self.errors = self.errors.noted(off_m, world.tick_s)
            own_m = np.linalg.norm(world.estimate()[0] - goals.position_m, axis=1)
            self.own_errors = self.own_errors.noted(np.where(np.isnan(off_m), np.nan, own_m), world.tick_s)
        self.off_m.append(off_m)
        return run.goals is not None

    def _note_absent(self, off_m: Array) -> None:
        """Note the vehicle that is farthest from where a part begins, if the part begins without it."""
        named, show_s = self.loaded.show.drawing, self.run.show_s(self.time_s)
        farthest_m = float(np.nanmax(off_m, initial=0.0))
        if named is None or farthest_m <= named.waits_from_m:
            return
        row, part = int(np.nanargmax(off_m)), self.timeline.cue_at(show_s)
        words = f"vehicle {row + 1} is {farthest_m:.1f} m from where it begins, after {APPROACH_MAX_S:g} s"
        self.flaws.append(Flaw(("timeline", part.index, "trajectories"), f"trajectories: {words} on the way"))

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
            done_s = ASSEMBLED_IN_S + self.run.show_s(self.time_s)
        else:
            done_s = ASSEMBLED_IN_S + timeline_s + min(self.time_s - self.ended_s, HOME_IN_S)
        return done_s / (ASSEMBLED_IN_S + timeline_s + HOME_IN_S)

    def finished(self) -> bool:
        return self.ended_s is not None and not (self.record.in_air[-1] & ~self.losses.known).any()

    def _assemble(self, drawn: bool) -> None:
        """Begin the show once its first shape, or the first place of its drawing, is reached."""
        begins = self.run.there if drawn else self._stands()
        if not (begins or drawn) and self.time_s > ASSEMBLED_BY_S:
            begins, goal = True, law_of(self.plan.formation.law).goal_shape
            shape = "formation" if goal is GoalShape.NONE else goal.value
            words = f"the {shape} does not stand after {ASSEMBLED_BY_S:g} s"
            self.flaws.append(Flaw(("timeline", 0), words))
        if begins:
            self._begin()

    def _stands(self) -> bool:
        """Whether the vehicles are where the law leads: those of no sphere for a time, as in flight."""
        center, goal = self.memory.center, law_of(self.plan.formation.law).goal_shape
        if center is None:
            return False
        offset_m = self.world.received_m - center.position_m
        shaped = in_shape(goal, offset_m, self.memory.radius_m, np.array(self.traits.charge))
        self._shaped_s = min(self._shaped_s, self.time_s) if shaped else np.inf
        return shaped and (goal is GoalShape.SPHERE or self.time_s - self._shaped_s >= SETTLES_S)

    def _begin(self) -> None:
        self.began_s, self.center_moves = self.time_s, True
        self.run.clock = self.run.clock.run(self.time_s)

    def _play(self) -> None:
        plan = self.run.desired(self.time_s)
        self.plan = self._with_possible_obstacles(plan, self.timeline.cue_at(self.run.show_s(self.time_s)))
        if self.run.is_over(self.time_s):
            self.ended_s = self.time_s

    def _with_possible_obstacles(self, plan: Plan, played: Played) -> Plan:
        """Refuse, as in flight, obstacles that would contain a vehicle or appear too close ahead of one."""
        ids = {box.id for box in self.plan.obstacles}
        possible: list[Obstacle] = []
        for box in plan.obstacles:
            if box.id not in ids and box.id not in self._refused:
                try:
                    self.check_box(box)
                except RefusedError as error:
                    self._refused.add(box.id)
                    self.flaws.append(Flaw(("timeline", played.index, "obstacles"), str(error)))
            if box.id not in self._refused:
                possible.append(box)
        self._refused &= {box.id for box in plan.obstacles}
        return Plan(plan.formation, plan.orbit, plan.target, (*possible, *self._unknown), plan.yaw)


def _scenario(
    loaded: LoadedShow,
    world: World,
    adversity: Adversity,
    first: Plan,
    control: ControlSettings,
    *,
    spares: int,
) -> Scenario:
    """Return what a simulated flight needs to know of a show that begins with the plan `first`."""
    show, formation = loaded.show, first.formation
    flight = FormationFlight(
        kind="formation",
        radius_m=formation.radius_m,
        height_m=formation.height_m,
        law=formation.law,
        takeoff_height_m=show.fleet.takeoff_height_m,
        loss=adversity.loss,
        join=spares,
    )
    return Scenario(
        name=loaded.name,
        about=show.about,
        duration_s=ASSEMBLED_BY_S + loaded.timeline.duration_s + HOME_BY_S,
        flight=flight,
        judged=Judged(vehicles=(show.fleet.vehicles,)),
        world=world,
        control=control,
        failsafes=FailsafePolicy(),
    )


def rehearse(
    loaded: LoadedShow,
    seed: int = 1,
    on_progress: Callable[[float], None] | None = None,
    adversity: Adversity | None = None,
    wind_m_s: tuple[float, float] = (0.0, 0.0),
    rules: ServiceRules | None = None,
) -> Rehearsal:
    """Fly a show once, with the recorded errors of the vehicles' position estimates.

    Args:
        loaded: the show.
        seed: of these errors, and of which vehicles are lost.
        on_progress: called with the share of the flight that is done, from 0 to 1.
        adversity: losses, and obstacles that the show does not know of; None: none.
        wind_m_s: along the show's x and y; its gusts have a standard deviation of `GUSTS` of it.
        rules: of the service that is to fly it, with the areas of its fence; None: it has none.
    """
    speed_m_s = hypot(*wind_m_s)
    wind = Wind(mean_x_m_s=wind_m_s[0], mean_y_m_s=wind_m_s[1], gust_m_s=GUSTS * speed_m_s)
    drag_per_s = WIND_DRAG_PER_S if speed_m_s else World().drag_per_s
    world = World(noise=1.0, wind=wind, drag_per_s=drag_per_s)
    flight = Rehearsal(loaded, world, seed, adversity, rules)
    flight.fly(on_progress)
    return flight


GUSTS = 0.125
WIND_DRAG_PER_S = 0.2
"""Of real quadrotors; that of PX4's simulator is 1.0."""
