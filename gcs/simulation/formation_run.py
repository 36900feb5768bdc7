"""A simulated formation: target, orbit, boxes, changes of the fleet, and the end of the flight."""

from dataclasses import replace

import numpy as np

from gcs.control import Task
from gcs.formation.following import FAR_M, fleet_limits
from gcs.formation.laws.registry import law_of
from gcs.formation.neighbours import Sight
from gcs.model.errors import RefusedError
from gcs.model.plan import Formation, Orbit, Plan, Target
from gcs.model.state import Array, Mask
from gcs.safety.near_traffic import NearTraffic
from gcs.simulation import initial_states as layout
from gcs.simulation.crossing import Crossing
from gcs.simulation.decide import Divide
from gcs.simulation.obstacle_worlds import draw_world
from gcs.simulation.random_sites import drawn_site
from gcs.simulation.record import THROUGH_M, approaching
from gcs.simulation.scenario import Carried, FormationFlight, Scenario
from gcs.simulation.shortest_ways import shortest_ways_s
from gcs.simulation.simulated_flight import SimulatedFlight
from gcs.simulation.tracked_target import MovingTarget
from gcs.simulation.world import Neighbourhood

AFTER_BOXES_S = 25.0
"""Duration of a flight among random boxes after the last one was passed."""


class FormationRun(SimulatedFlight):
    """A formation engaged at once; target, leaving, joining and return follow the scenario."""

    def __init__(
        self,
        scenario: Scenario,
        flight: FormationFlight,
        count: int,
        seed: int,
        divide: Divide | None = None,
    ) -> None:
        self.flight = flight
        self._random = np.random.default_rng([seed, 1])
        total = count + flight.join
        flight, radius_m = layout.accepted(scenario, flight, total)
        start_m, pads_m = layout.formation_start_m(flight, radius_m, total, self._random), None
        height_m = flight.height_m or flight.takeoff_height_m + 5.0 + radius_m
        orbit = Orbit(**flight.orbit.model_dump())
        self._boxes = [(box, 0.0) for box in layout.obstacles_of(flight.boxes)]  # and when each becomes known
        self._target_m = np.array([flight.target.x_m, flight.target.y_m])
        if flight.random_obstacles is not None:
            avoidance = scenario.control.law.avoidance
            grid_m = layout.grid_m(total, flight.spacing_m, 0.0)
            apart_m = float(np.hypot(grid_m[:, 0], grid_m[:, 1]).max())
            drawn = draw_world(self._random, flight.random_obstacles, avoidance, radius_m, apart_m)
            orbit = Orbit(drawn.orbit_radius_m, drawn.speed_m_s)
            self._boxes = list(zip(drawn.boxes, drawn.appear_s, strict=True))
            self._target_m = np.array(drawn.target_m)
            start_m = start_m + np.array([drawn.orbit_radius_m, 0.0, 0.0])
            if drawn.pads_m is not None:
                pads_m = grid_m + np.array([*drawn.pads_m, 0.0])
                start_m = self._between_home_m(flight, radius_m, count, pads_m)
        if flight.site is not None:
            half_m = float(np.abs(start_m[:, :2]).max(initial=0.0)) + radius_m
            around = drawn_site(scenario, flight.site, self._random, half_m)
            scenario = around.scenario
            self._target_m = around.room_m[int(self._random.integers(len(around.room_m)))]
        plan = Plan(Formation(radius_m, height_m, law=flight.law), orbit)
        super().__init__(scenario, start_m, np.full((total, 3), np.nan), plan, seed, divide)
        self.pads_m = pads_m
        if flight.pads == "shuffled":
            grid_m = layout.grid_m(total, flight.spacing_m, 0.0)
            self.pads_m = grid_m[self._random.permutation(total)]
        self.record.orbit_radius_m = orbit.radius_m
        self.task[:count] = Task.FORMATION
        self._joining = np.arange(total) >= count
        self._changed = self._ended = self._returns = False
        self._passing_s = 0.0
        self._path_m: tuple[Array, Array] | None = None  # start and displacement of a carried vehicle
        self.record.charge = charge = np.resize(np.array(flight.charges), total)
        speeds_m_s = np.resize(np.array(flight.speeds_m_s or (np.inf,)), total)
        self.traits = replace(self.traits, charge=charge, speed_max_m_s=speeds_m_s)
        about = scenario.control.law.neighbours, charge, radius_m, self.world.tick_s, seed
        self._neighbourhood = None if flight.radio is None else Neighbourhood(flight.radio, *about)
        self._target_m_s = np.array([flight.target.velocity_x_m_s, flight.target.velocity_y_m_s])
        self.tracked = None if flight.tracked is None else MovingTarget(flight.tracked, seed)
        self._traffic = (
            None if flight.traffic is None else Crossing(flight.traffic, seed, self.settings.safety, radius_m)
        )
        if self._traffic is not None:
            self.record.passages = self._traffic.passages
        self._target_stands = not (flight.tracked or flight.target.turns or self._target_m_s.any())
        self.stands = self._only_assembles and law_of(flight.law).has_slots and not orbit.radius_m

    @property
    def _only_assembles(self) -> bool:
        flight = self.flight
        events = flight.traffic, flight.spins, self._boxes, flight.carried, flight.join, flight.leave_share
        return self._target_stands and flight.ending == "none" and not any(events)

    def _between_home_m(self, flight: FormationFlight, radius_m: float, count: int, pads_m: Array) -> Array:
        """(n, 3) where those in formation begin, and above their pads (n, 3) those that join it."""
        start_m: Array = pads_m - np.array([0.0, 0.0, flight.takeoff_height_m])
        start_m[:count] = layout.formation_start_m(flight, radius_m, count, self._random)
        return start_m

    def before_tick(self) -> None:
        flight, now_s = self.flight, self.time_s
        flies_on = not self._ended or flight.ending == "return-one"
        self.center_moves = now_s >= flight.center_moves_from_s and flies_on
        self._move_target()
        for spin in flight.spins:
            if now_s >= spin.from_s:
                formation = replace(self.plan.formation, spin_rad_s=spin.rate_rad_s)
                self.plan = replace(self.plan, formation=formation)
        self._show_boxes()
        if flight.carried is not None:
            self._carry(flight.carried)
        if not self._changed and (flight.leave_share or flight.join) and now_s >= flight.change_s:
            self._change()
        if self._returns or (flight.ending != "none" and now_s >= flight.ending_s):
            self._end()

    def return_now(self) -> None:
        self._returns = not self._ended

    def near_traffic(self) -> NearTraffic | None:
        return (
            None
            if self._traffic is None
            else self._traffic.near(self.time_s, self.world.position_m, self.memory)
        )

    def sight(self) -> Sight | None:
        """What the radio, if the scenario has one, has delivered by now."""
        if self._neighbourhood is None:
            return None
        present = self.world.in_air & self.present
        return self._neighbourhood.exchange(self.time_s, *self.world.estimate(), present, self.memory.center)

    def _estimated(self, tracked: MovingTarget, now_s: float) -> Target:
        """The target as the formation follows it."""
        fastest_m_s = np.minimum(self.settings.safety.limits.horizontal_m_s, self.traits.speed_max_m_s)
        own_m_s2 = self.traits.response.acceleration_m_s2
        hardest_m_s2 = np.minimum(self.settings.acceleration_max_m_s2, own_m_s2)
        limits = fleet_limits(fastest_m_s, hardest_m_s2, 0.0, behind_m=FAR_M)
        return tracked.seen(now_s, self.plan.target, limits)

    def _move_target(self) -> None:
        now_s, dt_s = self.time_s, self.world.tick_s
        if self._target_stands and now_s > 0.0:
            return
        if self.tracked is not None:
            self.plan = replace(self.plan, target=self._estimated(self.tracked, now_s))
            return
        if now_s > 0.0:
            acceleration_m_s2 = np.zeros(2)
            for turn in self.flight.target.turns:
                if turn.from_s <= now_s - dt_s / 2 < turn.to_s:
                    acceleration_m_s2 += (turn.acceleration_x_m_s2, turn.acceleration_y_m_s2)
            self._target_m = self._target_m + dt_s * (self._target_m_s + dt_s * acceleration_m_s2 / 2)
            self._target_m_s = self._target_m_s + dt_s * acceleration_m_s2
        (x_m, y_m), (x_m_s, y_m_s) = self._target_m.tolist(), self._target_m_s.tolist()
        target = Target(x_m, y_m, x_m_s, y_m_s, now_s)
        self.plan = replace(self.plan, target=target)

    def true_target_m(self) -> Array:
        return super().true_target_m() if self.tracked is None else self.tracked.truth_m(self.time_s)

    def _carry(self, carried: Carried) -> None:
        """Carry the first vehicle along the sphere, hold it, and let it go."""
        center, path = self.memory.center, self._path_m
        there_s = carried.from_s + carried.off_m / carried.speed_m_s
        ends_s = there_s + carried.held_s
        if center is None or self.time_s < carried.from_s:
            return
        if path is None:
            here_m = self.world.position_m[0].copy()
            outward = (here_m - center.position_m) / np.linalg.norm(here_m - center.position_m)
            aside = np.cross(outward, self._random.normal(size=3))
            turn_rad = 2.0 * np.arcsin(min(1.0, carried.off_m / (2.0 * self.memory.radius_m)))
            turned = np.cos(turn_rad) * outward + np.sin(turn_rad) * aside / np.linalg.norm(aside)
            there_m = center.position_m + self.memory.radius_m * turned
            self._path_m = path = (here_m, there_m - here_m)
            self.record.carried_s = (there_s, ends_s, self.scenario.duration_s)
        share = min(1.0, (self.time_s - carried.from_s) / (there_s - carried.from_s))
        self.world.hold(0, path[0] + share * path[1] if self.time_s < ends_s else None)

    def _show_boxes(self) -> None:
        """Make boxes known at their times, but never where a vehicle could no longer stop."""
        for entry in [entry for entry in self._boxes if entry[1] <= self.time_s + 1e-9]:
            box = entry[0]
            try:
                self.check_box(box)
            except RefusedError:
                continue
            self._boxes.remove(entry)
            self.plan = replace(self.plan, obstacles=(*self.plan.obstacles, box))

    def _change(self) -> None:
        self._changed = True
        self.record.changed_s = self.time_s
        flying = np.flatnonzero((self.task == Task.FORMATION) & self.present)
        gone = self._random.choice(flying, round(self.flight.leave_share * len(flying)), replace=False)
        rows = np.zeros(len(self.task), dtype=bool)
        rows[gone] = True
        self.vanish(rows)
        self.task[self._joining] = Task.FORMATION
        if self.flight.join and self._parts:
            self.record.expected = self._joining.copy()
            middle_m = np.array([*self._target_m, -self.plan.formation.height_m])
            self._note_ways(self._joining, np.tile(middle_m, (len(self.task), 1)))

    @property
    def _parts(self) -> bool:
        """Whether boxes are between the formation and its pads."""
        return self.flight.random_obstacles is not None and self.flight.random_obstacles.parts

    def _note_ways(self, rows: Mask, goal_m: Array) -> None:
        """Note how long the shortest ways of those rows (n,) to (n, 3) are, past the boxes."""
        if not self._parts:
            return
        law, safety = self.settings.law, self.settings.safety
        boxes, speed = tuple(map(self._placed, self.plan.obstacles)), (law.speed_m_s, safety.limits)
        here_m, clear_m = self.world.position_m, law.avoidance.margin_m
        self.record.way_s = way_s = np.zeros(len(rows))
        way_s[rows] = shortest_ways_s(
            boxes, here_m[rows], goal_m[rows], clear_m, speed, safety.fence.height_max_m
        )

    def _end(self) -> None:
        """End the flight: through the filter, or by what the autopilots do without setpoints."""
        if self._returns or self.flight.ending == "return":
            self.come_home(self.flight.takeoff_height_m, begin=not self._ended)
            if not self._ended:
                self._note_ways(self.record.expected, self.record.goal_m)
        elif not self._ended and self.flight.ending in {"return-one", "come-down"}:
            self._lead_some_down(alone=self.flight.ending == "return-one")
        elif not self._ended:
            flying = self.present & self.world.in_air
            self.task[:] = Task.NONE
            self.world.fly_alone(flying, self.flight.ending)
        self._ended = True

    def _lead_some_down(self, *, alone: bool) -> None:
        """Lead the first vehicle home, `alone`, or all down near to where they are."""
        flying = self.present & self.world.in_air & ~self.losses.known
        rows = np.isin(np.arange(len(flying)), np.flatnonzero(flying)[: 1 if alone else None])
        self.record.changed_s, self.record.expected = self.time_s, rows
        if alone:
            place_m = self._return_places_m(np.flatnonzero(rows), self.flight.takeoff_height_m)
        else:
            place_m = self._landing_sites_m(rows)
        self.record.goal_m = place_m
        self._lead_down(rows, place_m, returns=alone)
        self._note_ways(rows, place_m)

    def finished(self) -> bool:
        """Whether all have landed; among random boxes, whether the last approach was `AFTER_BOXES_S` ago."""
        if self._traffic is not None:
            return self._traffic.is_over
        random = self.flight.random_obstacles
        if random is not None and random.arrives:
            return self._past_all_boxes()
        counts = self.record.expected if self.flight.ending == "return-one" else ~self.losses.known
        return self._ended and not (self.record.in_air[-1] & counts).any()

    def _past_all_boxes(self) -> bool:
        record, now_s = self.record, self.time_s
        if len(record.time_s) < 2:
            return False
        if approaching(record, len(record.time_s) - 1):
            self._passing_s = now_s
        rho_m = float(np.linalg.norm(record.center_m[-1][:2] - record.target_m[-1]))
        there = abs(rho_m - record.orbit_radius_m) < THROUGH_M
        turned = not record.orbit_radius_m or self._passing_s > 0.0
        return there and turned and now_s - self._passing_s > AFTER_BOXES_S
