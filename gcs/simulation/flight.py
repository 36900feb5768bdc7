"""Flies a scenario in virtual time: `gcs.control.tick` controls a simulated world."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings, Memory, Task, Tasks, ellipses_of, tick, warm_up
from gcs.control.late_links import fleet_delay_s, for_late_links
from gcs.failsafe.policy import Action
from gcs.flight.commander import STOPS_WITHIN_S
from gcs.flight.ticker import garbage_between_ticks
from gcs.formation.neighbours import Sight
from gcs.model.errors import ConfigError, RefusedError
from gcs.model.plan import Formation, LawName, Obstacle, Orbit, Plan, Target
from gcs.model.state import Array, FleetState, Mask, Traits
from gcs.planning.feasibility import check_obstacle
from gcs.planning.landing_sites import distinct_sites_m
from gcs.planning.return_paths.paths import (
    PathProgress,
    ReturnPaths,
    above_place_m,
    is_above,
    keeps_to_path,
    lowest_beside_m,
    may_hand_over,
)
from gcs.planning.return_paths.planner import (
    closed_places,
    plan_return_paths,
    return_places_m,
    return_planner,
)
from gcs.planning.return_paths.planner import warm_up as warm_up_planner
from gcs.safety.floor import Floor, pairs_that_count, scaled_distance_m
from gcs.simulation import initial_states as layout
from gcs.simulation.article import fly_article
from gcs.simulation.autopilots import responses
from gcs.simulation.loss import FAR_M, Losses, ServiceFailsafes
from gcs.simulation.obstacle_worlds import draw_world
from gcs.simulation.record import NOWHERE, THROUGH_M, Record, approaching, closest_m
from gcs.simulation.scenario import (
    ArticleFlight,
    Carried,
    FormationFlight,
    GoalFlight,
    Loss,
    Scenario,
    ShowFlight,
)
from gcs.simulation.stations import Decided, SimulatedStations
from gcs.simulation.world import TOUCHDOWN_M_S, Neighbourhood, TrueWorld

HANDOVER_HEIGHT_M: Final[float] = OperationSettings.model_fields["handover_height_m"].default
AFTER_BOXES_S = 25.0
"""Duration of a flight among random boxes after the last one was passed."""

MANY = 2000
"""With more vehicles distances are searched in a tree, not pair by pair."""

LINGER_S = 5.0
"""Duration of a flight to goals after the last arrival."""


def nearest_m(position_m: Array, inside_m: float) -> tuple[float, set[tuple[int, int]]]:
    """Smallest distance of any two of (n, 3) points, and the pairs within `inside_m`, by a search tree."""
    tree = scipy.spatial.cKDTree(position_m, compact_nodes=False, balanced_tree=False)
    least_m = float(np.asarray(tree.query(position_m, k=2)[0])[:, 1].min())
    return least_m, tree.query_pairs(inside_m) if least_m < inside_m else set()


def over_links(scenario: Scenario) -> ControlSettings:
    """The settings of a service that has measured its links."""
    delay_s = (scenario.world.telemetry_delay_s + scenario.world.setpoint_delay_s) / 2
    return for_late_links(scenario.control, fleet_delay_s(np.array([delay_s]), np.ones(1, np.bool_)))


class SimulatedFlight:
    """Base of all simulated flights: receive telemetry, tick, send setpoints, record the true states."""

    def __init__(self, scenario: Scenario, start_m: Array, goal_m: Array, plan: Plan, seed: int) -> None:
        n = len(start_m)
        self.scenario, self.plan = scenario, plan
        self.settings: ControlSettings = over_links(scenario)
        self.world = TrueWorld(start_m, scenario.world, seed)
        self.record = Record(scenario, seed, start_m, goal_m, self.floor.horizontal_m)
        self.task = np.full(n, Task.NONE, dtype=np.int8)
        self.goal_m = np.array(goal_m)
        self.descending = np.zeros(n, dtype=bool)
        self.present = np.ones(n, dtype=bool)
        flight = scenario.flight
        loss = Loss() if isinstance(flight, ArticleFlight | ShowFlight) else flight.loss
        joining = flight.join if isinstance(flight, FormationFlight) else 0
        self.losses = Losses(loss, n, seed, joining=joining)
        self.record.lost_rows = frozenset(np.flatnonzero(self.losses.rows).tolist())
        self.center_moves = False
        self.stands = False  # a sphere that only assembles: each vehicle flies to its slot, and stays
        self.pads_m: Array | None = None  # (n, 3) landing positions; None: below the start
        policy = scenario.failsafes
        self.failsafes = (
            None if policy is None else ServiceFailsafes(policy, n, layout.reported_accuracy_m(scenario))
        )
        self._site_m = np.full((n, 3), np.nan)  # where vehicles come down that a failsafe lands or returns
        self._lands = np.zeros(n, dtype=bool)  # of these, the ones that land: the lowest descends first
        self._some_led = False  # whether one has been led there
        self._progress: PathProgress | None = None
        self._returning = np.arange(0)  # (k,) rows of the return's plan
        self._takeoff_height_m = 0.0  # of those
        self.memory = Memory.fresh(n, 0.0)
        alike = Traits.alike(n, layout.reported_uncertainty_m(scenario))
        self.traits = replace(alike, response=responses(scenario.world, n))
        several = scenario.stations.count > 1
        self._stations = SimulatedStations(scenario.stations, self.world, seed) if several else None

    @property
    def floor(self) -> Floor:
        return self.settings.safety.floor

    @property
    def time_s(self) -> float:
        """Virtual time since engagement."""
        return self.world.time_s

    def fly(self, on_progress: Callable[[float], None] | None = None) -> Record:
        """Fly to the end. `on_progress` is called with the share of the longest duration that is flown."""
        warm_up()
        self._closest_m([self.world.position_m])  # compiles or loads its kernel
        began_s = time.process_time()
        with garbage_between_ticks() as collect_garbage:
            while self.time_s < self.scenario.duration_s - 1e-9 and not self.finished():
                self.before_tick()
                self._tick()
                collect_garbage(self.time_s)
                if on_progress is not None:
                    on_progress(self.time_s / self.scenario.duration_s)
        self.record.busy_s = time.process_time() - began_s
        return self.record

    def before_tick(self) -> None:
        """Do what operator, commander and maneuvers would do before this tick."""

    def lost_now(self) -> None:
        """Do what follows when vehicles are taken for lost.

        Those whose landing places are closed by now leave the return's plan and land beside, as in flight.
        """
        if self._progress is None:
            return
        self.record.expected = self.record.expected & ~(self.losses.known & self.world.in_air)
        going = self._returning[(self.task[self._returning] == Task.GOAL) & ~self.descending[self._returning]]
        uncertainty_m = np.array(self.traits.uncertainty_m)
        lost = self.losses.segments_m, uncertainty_m[self.losses.segments_of]
        over_m, floor = self._takeoff_height_m, self.settings.safety.floor
        away = going[closed_places(self.record.goal_m[going], over_m, floor, uncertainty_m[going], lost)]
        if len(away):
            self.record.goal_m = goal_m = np.array(self.record.goal_m)
            goal_m[away] = self._return_places_m(away, over_m)[away]
            self._lead_down(np.isin(np.arange(len(self.task)), away), goal_m, returns=True)

    def finished(self) -> bool:
        return False

    def led(self, tasks: Tasks) -> Tasks:
        """Return the tasks as a drawn show, if one leads, has them."""
        return tasks

    def sight(self) -> Sight | None:
        """What the vehicles received from each other by now; None: the law is computed on the ground."""
        return None

    def _tick(self) -> None:
        fleet = self.world.receive()
        if self.losses.advance(self.world, fleet, self.memory, self.settings.telemetry_age_max_s):
            self.task[self.losses.known] = Task.NONE
            self.lost_now()
        self._come_down()
        paused = self.failsafes is not None and self.failsafes.paused
        tasks = Tasks(
            self.task.copy(),
            self.goal_m.copy(),
            self.world.in_air & self.present & ~self.losses.known,
            self.descending.copy(),
            self.losses.segments_m.copy(),
            center_moves=self.center_moves and not paused,
            formation_waits=paused,
            follows_planned_path=self._follows_planned_path(),
            segments_of=self.losses.segments_of,
            drift=self.losses.drift,
            silent_segments=self.losses.silent_segments,
        )
        decided = self._decide(fleet, self.led(tasks))
        self.memory = decided.memory
        self._mind_failsafes(fleet)
        self._keep(decided)
        self.world.send(decided.setpoints)
        seen_m = self.world.advance()
        self.record.closest_m.append(self._closest_m(seen_m))

    def _decide(self, fleet: FleetState, tasks: Tasks) -> Decided:
        """Compute the tick of the station, or of each of several."""
        if self._stations is not None:
            return self._stations.decide(fleet, tasks, self.plan, self.traits, self.settings)
        sight = self.sight()
        began_s = time.thread_time()
        result = tick(fleet, tasks, self.plan, self.traits, self.memory, self.settings, sight)
        memory = result.memory
        took_s = time.thread_time() - began_s
        limited = len(result.limited_by) - result.limited_by.count("")
        return Decided(result.setpoints, memory, limited, (took_s,))

    def _mind_failsafes(self, fleet: FleetState) -> None:
        """Execute what the service's failsafes request, as the commander does."""
        if self.failsafes is None:
            return
        flying = self.world.in_air & self.present & (self.task != Task.NONE)
        formed, lost, fence = self.task == Task.FORMATION, self.losses.known, self.settings.safety.fence
        for request in self.failsafes.advance(fleet, self.memory.desired_m_s, fence, flying, formed, lost):
            self.record.failsafes.append((self.time_s, request.cause.value, request.action.value))
            rows = flying if request.whole_show else np.isin(np.arange(len(flying)), request.rows)
            if request.action in {Action.HOLD, Action.PAUSE}:
                self.task[rows] = Task.GOAL
                self.goal_m[rows] = fleet.position_m[rows] + STOPS_WITHIN_S * fleet.velocity_m_s[rows]
            elif request.action is Action.LAND:
                self._lead_down(rows, self._landing_sites_m(rows))
            elif request.action is Action.RETURN and request.whole_show:
                self.return_now()
            elif request.action is Action.RETURN:
                self._lead_down(rows, self.world.home_m if self.pads_m is None else self.pads_m, returns=True)

    def return_now(self) -> None:
        """Begin the collective return on a failsafe."""

    def _landing_sites_m(self, rows: Mask) -> Array:
        """(n, 3) sites near the vehicles in `rows`, as in flight: clear of pads and other vehicles."""
        here_m = self.world.received_m
        taken_m = np.concatenate([self.world.home_m[~rows, :2], here_m[~rows, :2]])
        spacing_m = OperationSettings.model_fields["landing_site_spacing_m"].default
        sites_m = np.zeros_like(here_m)
        ellipses = ellipses_of(self.plan, self.settings, self.time_s)
        sites_m[rows, :2] = distinct_sites_m(here_m[rows, :2], taken_m, spacing_m, ellipses)
        return sites_m

    def _lead_down(self, rows: Mask, site_m: Array, *, returns: bool = False) -> None:
        """Lead vehicles above their places (n, 3) and down, as `gcs.flight.landings` does."""
        flight, least_m = self.scenario.flight, -np.inf
        if returns and isinstance(flight, FormationFlight):
            least_m = flight.takeoff_height_m
        self.task[rows], self._site_m[rows], self._some_led = Task.GOAL, site_m[rows], True
        self._lands[rows] = not returns
        self.goal_m[rows] = above_place_m(self.world.received_m[rows], site_m[rows], least_m)

    def _come_down(self) -> None:
        if not self._some_led:
            return
        here_m, led = self.world.received_m, (self.task == Task.GOAL) & np.isfinite(self._site_m[:, 0])
        lands = led & self._lands
        waits = lands & (here_m[:, 2] < lowest_beside_m(here_m[lands], self._site_m[lands]))
        self._descend(led & ~waits & ~self.descending & is_above(here_m, self._site_m), self._site_m)
        self._hand_over(led & self.descending, self._site_m)

    def _descend(self, arrived: Mask, place_m: Array) -> None:
        self.descending = self.descending | arrived
        self.goal_m[arrived] = place_m[arrived]

    def _hand_over(self, flown: Mask, place_m: Array) -> None:
        low = flown & may_hand_over(self.world.received_m, place_m, HANDOVER_HEIGHT_M)
        self.task[low] = Task.NONE
        self.world.leave_to_themselves(low, TOUCHDOWN_M_S)

    def _keep(self, decided: Decided) -> None:
        record, memory = self.record, decided.memory
        counts = self.stands or len(self.losses.segments_m) > 0
        if counts and memory.center is not None and self._progress is None:
            record.slot_m = slot_m = memory.center.position_m + memory.radius_m * memory.place
            off_m = np.linalg.norm(self.world.position_m - slot_m, axis=1)
            if memory.unfollowed_s is not None:
                off_m[memory.unfollowed_s < 0.0] += FAR_M  # held: its slot has come to it
            if not record.orbit_radius_m:  # a formation that stands cannot leave closed space behind
                kept_m = self.floor.widest_m(self.traits.uncertainty_m)
                closed = self.losses.apart_m(slot_m, self.floor) <= kept_m
                off_m[closed & (off_m > THROUGH_M)] = np.nan
            record.off_slot_m.append(off_m)
        record.tick_s.extend(decided.took_s)
        record.time_s.append(self.time_s)
        record.position_m.append(self.world.position_m.astype(np.float32))
        record.formed.append((self.task == Task.FORMATION) & self.present)
        record.in_air.append(self.world.in_air & self.present)
        record.center_m.append(NOWHERE if memory.center is None else memory.center.position_m)
        record.radius_m.append(memory.radius_m)
        record.target_m.append(np.array(self.plan.target.position_m(self.time_s)))
        record.boxes.append(tuple(map(self._placed, self.plan.obstacles)))
        record.held_by.append("" if memory.detour is None else memory.detour.held_by)
        record.limited.append(decided.limited)

    def check_box(self, box: Obstacle) -> None:
        """Check, as in flight, that a box can stand where it is now. Raises: RefusedError."""
        world, flying = self.world, np.flatnonzero(self.world.in_air & self.present).tolist()
        check_obstacle(
            self._placed(box),
            self.settings.law.avoidance,
            {world.ids[row]: world.position_m[row] for row in flying},
            {},
            velocities_m_s={world.ids[row]: world.velocity_m_s[row] for row in flying},
            braking=self.settings.safety.braking.of_slowest(self.traits.response),
        )

    def _placed(self, box: Obstacle) -> Obstacle:
        if not box.speed_m_s:
            return box  # the same at all times
        x_m, y_m = box.position_m(self.time_s)
        return replace(box, x_m=x_m, y_m=y_m, time_s=self.time_s)

    def _closest_m(self, seen_m: Sequence[Array]) -> float:
        """Smallest distance of the pairs that count at any of those positions, (n, 3) each."""
        floor, least_m, in_air = self.floor, np.inf, self.world.in_air & self.present
        limits = floor.horizontal_m / floor.vertical_m, floor.pad_height_m, floor.horizontal_m
        scale = np.array([1.0, 1.0, limits[0]])
        for position_m in seen_m:
            high = in_air.all() and (-position_m[:, 2] >= floor.pad_height_m).all()
            if len(in_air) > MANY and high:  # every pair counts
                distance_m, pairs = nearest_m(position_m * scale, floor.horizontal_m)
                self.record.violating.update(pairs)
                least_m = min(least_m, distance_m)
                continue
            distance_m, inside = closest_m(position_m, in_air, self.present, *limits)
            least_m = min(least_m, distance_m)
            if inside:
                rows = np.flatnonzero(self.present)
                first, second = pairs_that_count(position_m[rows], in_air[rows], floor)
                near = scaled_distance_m(position_m[rows], first, second, floor) < floor.horizontal_m
                found = zip(rows[first[near]].tolist(), rows[second[near]].tolist(), strict=True)
                self.record.violating.update(found)
        return least_m

    def come_home(self, takeoff_height_m: float, *, begin: bool) -> None:
        """Lead all vehicles home and down through the safety filter. Call once a tick, first with `begin`."""
        here_m = self.world.received_m
        if begin:
            self.record.changed_s = self.time_s
            flying = self.present & self.world.in_air & ~self.losses.known & np.isnan(self._site_m[:, 0])
            if not flying.any():
                return
            self.task[flying] = Task.GOAL
            self._returning = rows = np.flatnonzero(flying)
            self._takeoff_height_m = takeoff_height_m
            self.record.goal_m = self._return_places_m(rows, takeoff_height_m)
            self.record.expected = flying.copy()
            paths = self._return_paths(rows, takeoff_height_m)
            self._progress = PathProgress(paths, self.record.goal_m[rows])
        pads_m, progress, rows = self.record.goal_m, self._progress, self._returning
        if progress is None:
            return
        flown = (self.task == Task.GOAL) & self.present & np.isnan(self._site_m[:, 0])
        led = flown & ~self.descending
        progress.advance(0.0 if begin else self.world.tick_s, here_m[rows], led[rows])
        arrived = np.zeros_like(led)
        self.goal_m[rows[led[rows]]] = progress.goal_m[led[rows]]
        arrived[rows] = led[rows] & progress.arrived
        self._descend(arrived, pads_m)
        self._hand_over(flown & self.descending, pads_m)

    def _follows_planned_path(self) -> Mask | None:
        if self._progress is None:
            return None
        follows = np.zeros_like(self.descending)
        follows[self._returning] = ~self.descending[self._returning] & ~self._progress.late
        follows[self._returning[list(self._progress.return_paths.unplanned)]] = False
        return keeps_to_path(follows, self.world.received_m, self.goal_m)

    def _return_places_m(self, rows: NDArray[np.intp], takeoff_height_m: float) -> Array:
        """(n, 3) pads, or for these vehicles the places where they land instead, as in flight."""
        place_m, losses = np.array(self.world.home_m if self.pads_m is None else self.pads_m), self.losses
        uncertainty_m = np.array(self.traits.uncertainty_m)
        down = ~self.world.in_air & self.present
        taken_m = np.vstack([np.delete(place_m, rows, axis=0), self.world.received_m[down]])[:, :2]
        place_m[rows] = return_places_m(
            place_m[rows],
            taken_m,
            takeoff_height_m,
            OperationSettings.model_fields["landing_site_spacing_m"].default,
            self.settings,
            self.plan,
            self.time_s,
            uncertainty_m[rows],
            (losses.segments_m, uncertainty_m[losses.segments_of]),
        )
        return place_m

    def _return_paths(self, rows: NDArray[np.intp], takeoff_height_m: float) -> ReturnPaths:
        """Plan the return of these vehicles with the planner of real flights."""
        losses, uncertainty_m = self.losses, np.array(self.traits.uncertainty_m)
        warm_up_planner()
        began_s = time.thread_time()
        planner = return_planner(
            self.world.received_m[rows].copy(),
            self.record.goal_m[rows],
            (takeoff_height_m, HANDOVER_HEIGHT_M),
            self.settings,
            self.plan,
            self.time_s,
            uncertainty_m[rows],
            (losses.segments_m, uncertainty_m[losses.segments_of]),
        )
        paths = plan_return_paths(planner)
        self.record.planning_s = time.thread_time() - began_s
        return paths

    def vanish(self, rows: Mask) -> None:
        self.present = self.present & ~rows
        self.task[rows] = Task.NONE
        self.world.remove(rows)


class FormationRun(SimulatedFlight):
    """A formation engaged at once; target, leaving, joining and return follow the scenario."""

    def __init__(self, scenario: Scenario, flight: FormationFlight, count: int, seed: int) -> None:
        self.flight = flight
        self._random = np.random.default_rng([seed, 1])
        total = count + flight.join
        flight, radius_m = layout.accepted(scenario, flight, total)
        start_m = layout.formation_start_m(flight, radius_m, total, self._random)
        height_m = flight.height_m or flight.takeoff_height_m + 5.0 + radius_m
        orbit = Orbit(**flight.orbit.model_dump())
        self._boxes = [  # and when each becomes known
            (Obstacle(f"box {number}", **box.model_dump()), 0.0) for number, box in enumerate(flight.boxes, 1)
        ]
        self._target_m = np.array([flight.target.x_m, flight.target.y_m])
        if flight.random_obstacles is not None:
            avoidance = scenario.control.law.avoidance
            drawn = draw_world(self._random, flight.random_obstacles, avoidance, radius_m)
            orbit = Orbit(drawn.orbit_radius_m, drawn.speed_m_s)
            self._boxes = list(zip(drawn.boxes, drawn.appear_s, strict=True))
            self._target_m = np.array(drawn.target_m)
            start_m = start_m + np.array([drawn.orbit_radius_m, 0.0, 0.0])
        plan = Plan(Formation(radius_m, height_m, law=flight.law), orbit)
        super().__init__(scenario, start_m, np.full((total, 3), np.nan), plan, seed)
        if flight.pads == "shuffled":
            grid_m = layout.grid_m(total, flight.spacing_m, 0.0)
            self.pads_m = grid_m[self._random.permutation(total)]
        self.record.orbit_radius_m = orbit.radius_m
        self.task[:count] = Task.FORMATION
        self._joining = np.arange(total) >= count
        self._changed = self._ended = self._returns = False
        self._passing_s = 0.0
        self._path_m: tuple[Array, Array] | None = None  # start and displacement of a carried vehicle
        rows = np.arange(total)
        charge = np.array(flight.charges)[rows % len(flight.charges)]
        self.record.charge = charge
        speeds_m_s = np.array(flight.speeds_m_s or (np.inf,))
        self.traits = replace(self.traits, charge=charge, speed_max_m_s=speeds_m_s[rows % len(speeds_m_s)])
        self._neighbourhood = (
            None
            if flight.radio is None
            else Neighbourhood(
                flight.radio, scenario.control.law.neighbours, charge, radius_m, self.world.tick_s, seed
            )
        )
        self._target_m_s = np.array([flight.target.velocity_x_m_s, flight.target.velocity_y_m_s])
        self._target_stands = not (flight.target.turns or self._target_m_s.any())
        changes = flight.spins or self._boxes or flight.carried or flight.join or flight.leave_share
        only_assembles = self._target_stands and flight.ending == "none" and not changes
        self.stands = only_assembles and flight.law is LawName.SLOTS and not orbit.radius_m

    def before_tick(self) -> None:
        flight, now_s = self.flight, self.time_s
        self.center_moves = now_s >= flight.center_moves_from_s and not self._ended
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

    def sight(self) -> Sight | None:
        """What the radio, if the scenario has one, has delivered by now."""
        if self._neighbourhood is None:
            return None
        present = self.world.in_air & self.present
        return self._neighbourhood.exchange(self.time_s, *self.world.estimate(), present, self.memory.center)

    def _move_target(self) -> None:
        now_s, dt_s = self.time_s, self.world.tick_s
        if self._target_stands and now_s > 0.0:
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

    def _end(self) -> None:
        """End the flight: a return through the filter, or what the autopilots do without setpoints."""
        if self._returns or self.flight.ending == "return":
            self.come_home(self.flight.takeoff_height_m, begin=not self._ended)
        elif not self._ended:
            flying = self.present & self.world.in_air
            self.task[:] = Task.NONE
            self.world.fly_alone(flying, self.flight.ending)
        self._ended = True

    def finished(self) -> bool:
        """Whether all have landed; among random boxes, whether the last approach was `AFTER_BOXES_S` ago."""
        random = self.flight.random_obstacles
        if random is not None and random.arrives:
            return self._past_all_boxes()
        return self._ended and not (self.record.in_air[-1] & ~self.losses.known).any()

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


class GoalRun(SimulatedFlight):
    """A flight of every vehicle to a goal of its own."""

    def __init__(self, scenario: Scenario, flight: GoalFlight, count: int, seed: int) -> None:
        self.flight = flight
        self._random = np.random.default_rng([seed, 1])
        start_m, goal_m = layout.goals_m(flight, count, self._random)
        middle_m = start_m.mean(axis=0)
        plan = Plan(Formation(10.0, float(-middle_m[2])))
        super().__init__(scenario, start_m, goal_m, plan, seed)
        self.task[:] = Task.GOAL
        self._since_s = np.inf

    def lost_now(self) -> None:
        kept_m = self.floor.widest_m(self.traits.uncertainty_m) + self.flight.arrived_m
        clear = self.losses.apart_m(self.record.goal_m, self.floor) > kept_m
        self.record.expected = ~self.losses.known & clear

    def finished(self) -> bool:
        expected = self.record.expected
        away_m = np.linalg.norm(self.world.position_m - self.record.goal_m, axis=1)[expected].max(initial=0.0)
        self._since_s = min(self._since_s, self.time_s) if away_m < self.flight.arrived_m else np.inf
        return self.time_s - self._since_s > LINGER_S


def fly(
    scenario: Scenario, count: int, seed: int, on_progress: Callable[[float], None] | None = None
) -> Record:
    """Fly a scenario once; `on_progress` as of `SimulatedFlight.fly`.

    Raises: ConfigError when its start positions or goals are impossible.
    """
    scenario = scenario.in_world_of(seed)
    if isinstance(scenario.flight, FormationFlight):
        return FormationRun(scenario, scenario.flight, count, seed).fly(on_progress)
    if isinstance(scenario.flight, GoalFlight):
        return GoalRun(scenario, scenario.flight, count, seed).fly(on_progress)
    if isinstance(scenario.flight, ShowFlight):
        raise ConfigError(f"{scenario.name}: it flies a show: gcs show plot draws one")
    return fly_article(scenario, scenario.flight, count, seed)
