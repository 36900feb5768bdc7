"""Flies a show in virtual time: hover, assembly, timeline, return."""

from collections.abc import Callable

import numpy as np

from gcs.control import Task
from gcs.failsafe.policy import FailsafePolicy
from gcs.flight.fleet import stands
from gcs.model.errors import RefusedError
from gcs.model.plan import Obstacle, Plan
from gcs.shows import Flaw, LoadedShow, Played
from gcs.simulation.flight import SimulatedFlight
from gcs.simulation.record import Record
from gcs.simulation.scenario import FormationFlight, Judged, Scenario, World

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
        self, loaded: LoadedShow, world: World, seed: int, on_progress: Callable[[float], None] | None = None
    ) -> None:
        """`world` sets the vehicles and links; `on_progress` is called with the share that is flown."""
        self._on_progress, self._report_at_s = on_progress, 0.0
        show, timeline = loaded.show, loaded.timeline
        self.loaded, self.timeline = loaded, timeline
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

    def before_tick(self) -> None:
        if self._on_progress is not None and self.time_s >= self._report_at_s:
            self._report_at_s = self.time_s + REPORT_S
            self._on_progress(self.share_flown())
        for when_s, cause, action in self.record.failsafes[self._named :]:
            words = f"failsafe '{cause}' acts {when_s:.0f} s after the assembly began: {action}"
            self.flaws.append(Flaw(("timeline", 0), words))
        self._named = len(self.record.failsafes)
        if self.began_s is None:
            self._assemble()
        if self.began_s is not None and self.ended_s is None:
            self._play(self.time_s - self.began_s)
        if self.ended_s is not None:
            begin = self.center_moves
            self.center_moves = False
            self.come_home(self.loaded.show.fleet.takeoff_height_m, begin=begin)

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
            done_s = ASSEMBLED_IN_S + self.time_s - self.began_s
        else:
            done_s = ASSEMBLED_IN_S + timeline_s + min(self.time_s - self.ended_s, HOME_IN_S)
        return done_s / (ASSEMBLED_IN_S + timeline_s + HOME_IN_S)

    def finished(self) -> bool:
        return self.ended_s is not None and not self.record.in_air[-1].any()

    def _assemble(self) -> None:
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
        return Plan(plan.formation, plan.orbit, plan.target, tuple(possible), plan.yaw)


def rehearse(
    loaded: LoadedShow, seed: int = 1, on_progress: Callable[[float], None] | None = None
) -> tuple[Rehearsal, Record]:
    """Fly a show once, with the recorded errors of the vehicles' position estimates.

    `on_progress` is called with the share of the flight that is done, from 0 to 1.
    """
    flight = Rehearsal(loaded, World(noise=1.0), seed, on_progress)
    return flight, flight.fly()
