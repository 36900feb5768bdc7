"""A flight in virtual time: `gcs.control.tick` controls a simulated world, and brings all home."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.control import (
    ControlSettings,
    Memory,
    Task,
    Tasks,
    ellipses_of,
    ellipses_until,
    prepare,
    tick,
    warm_up,
)
from gcs.control.late_links import fleet_delay_s, for_late_links
from gcs.control.law_step import LawRunner
from gcs.control.round_obstacles import shut_in_by
from gcs.failsafe.policy import Action
from gcs.flight.commands.commander import STOPS_WITHIN_S
from gcs.flight.features.laws.process import BEGINS_S, LawProcess
from gcs.flight.state.ticker import garbage_between_ticks
from gcs.formation.laws.registry import SHIPPED
from gcs.formation.neighbours import Sight
from gcs.model.errors import ConfigError
from gcs.model.plan import Obstacle, Plan
from gcs.model.state import Array, FleetState, Mask, Traits
from gcs.planning.feasibility import check_obstacle
from gcs.planning.landing_sites import LANDS_WITHIN_S, distinct_sites_m
from gcs.planning.return_paths.closed_ways import closed_paths, closed_places
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
    plan_return_paths,
    return_places_m,
    return_planner,
)
from gcs.planning.return_paths.planner import warm_up as warm_up_planner
from gcs.safety.controlled_ground import ground_for_sites
from gcs.safety.floor import Floor
from gcs.safety.near_traffic import NearTraffic
from gcs.simulation import initial_states as layout
from gcs.simulation.autopilots import responses
from gcs.simulation.decide import Decided, Decider, Divide
from gcs.simulation.judged_reports import JudgedReports
from gcs.simulation.loss import FAR_M, Losses, ServiceFailsafes, Unbelieved
from gcs.simulation.record import NOWHERE, THROUGH_M, FlightRecord, closest_m, pairs_inside
from gcs.simulation.reporting import ReportingWorld
from gcs.simulation.scenario import (
    ArticleFlight,
    FormationFlight,
    Scenario,
    ScenarioLoss,
    ShowFlight,
)
from gcs.simulation.world import TOUCHDOWN_M_S, TrueWorld

HANDOVER_HEIGHT_M: Final[float] = OperationSettings.model_fields["handover_height_m"].default

MANY = 2000
"""With more vehicles distances are searched in a tree, not pair by pair."""


def nearest_m(position_m: Array, inside_m: float) -> tuple[float, set[tuple[int, int]]]:
    """Smallest distance of any two of (n, 3) points, and the pairs within `inside_m`, by a search tree."""
    tree = scipy.spatial.cKDTree(position_m, compact_nodes=False, balanced_tree=False)
    least_m = float(np.asarray(tree.query(position_m, k=2)[0])[:, 1].min())
    return least_m, tree.query_pairs(inside_m) if least_m < inside_m else set()


def over_links(scenario: Scenario) -> ControlSettings:
    """The settings of a service that has measured its links."""
    delay_s = (scenario.world.telemetry_delay_s + scenario.world.setpoint_delay_s) / 2
    return for_late_links(scenario.control, fleet_delay_s(np.array([delay_s]), np.ones(1, np.bool_)))


LAW_WAIT_S: Final = 0.5
"""How long a flight in virtual time waits for each answer of a law, in true time."""


def law_process(name: str, settings: ControlSettings, count: int, tick_s: float) -> LawProcess:
    """The process of a law that is not shipped. Raises: ConfigError when it does not begin."""
    law = LawProcess(name, settings.law.given(name), count, tick_s, LAW_WAIT_S)
    law.begin(BEGINS_S)
    if not law.ready:
        law.close()
        raise ConfigError(f"law {name}: {law.failed or 'it did not begin'}")
    return law


class SimulatedFlight:
    """Base of all simulated flights: receive telemetry, tick, send setpoints, record the true states."""

    def __init__(
        self,
        scenario: Scenario,
        start_m: Array,
        goal_m: Array,
        plan: Plan,
        seed: int,
        divide: Divide | None = None,
    ) -> None:
        n = len(start_m)
        self.scenario, self.plan = scenario, plan
        self.settings: ControlSettings = over_links(scenario)
        lies = scenario.world.lies
        self.world: TrueWorld | ReportingWorld = (
            TrueWorld(start_m, scenario.world, seed)
            if lies is None
            else ReportingWorld(start_m, scenario.world, seed, lies)
        )
        self.record = FlightRecord(scenario, seed, start_m, goal_m, self.floor.horizontal_m)
        self.task = np.full(n, Task.NONE, dtype=np.int8)
        self.goal_m = np.array(goal_m)
        self.descending = np.zeros(n, dtype=bool)
        self.present = np.ones(n, dtype=bool)
        flight, ground = scenario.flight, scenario.control.safety.fence.controlled_ground
        if ground is not None or not (isinstance(flight, ArticleFlight) or flight.site is None):
            self.record.within_m_s = []
        loss = ScenarioLoss() if isinstance(flight, ArticleFlight | ShowFlight) else flight.loss
        joining = flight.join if isinstance(flight, FormationFlight) else 0
        self.losses = Losses(loss, n, seed, joining=joining) if lies is None else Unbelieved(n, seed)
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
        self.reports = self._reports()
        self.law: LawProcess | None = None  # of a law that is not shipped, once the flight has begun
        self.decided: Decided | None = None  # by the newest tick
        self.proposed_m_s: Array | None = None  # (n, 3) for those that are `steered`; None: none are
        self._decider: Decider | None = None
        if scenario.divided.count > 1:
            if divide is None:
                words = "several flights divide its vehicles: divide=gcs.site.simulated.SimulatedStations"
                raise ConfigError(f"{scenario.name}: {words}")
            if n < scenario.divided.count:
                raise ConfigError(
                    f"{scenario.name}: vehicles = {n}: at least {scenario.divided.count}, one each"
                )
            self._decider = divide(scenario.divided, self.world, seed)

    def _reports(self) -> JudgedReports | None:
        world, space, failsafes = self.world, self.losses, self.failsafes
        if not (isinstance(world, ReportingWorld) and isinstance(space, Unbelieved)) or failsafes is None:
            return None
        self.record.liars = world.liars
        return JudgedReports(world, space, failsafes, np.array(self.traits.uncertainty_m))

    @property
    def floor(self) -> Floor:
        return self.settings.safety.floor

    @property
    def time_s(self) -> float:
        """Virtual time since engagement."""
        return self.world.time_s

    def fly(self, on_progress: Callable[[float], None] | None = None) -> FlightRecord:
        """Fly to the end. `on_progress` is called with the share of the longest duration that is flown."""
        self.get_ready()
        began_s = time.process_time()
        with garbage_between_ticks() as collect_garbage:
            while not self.is_over:
                self.step()
                collect_garbage(self.time_s)
                if on_progress is not None:
                    on_progress(self.share_flown())
        self.record.busy_s = time.process_time() - began_s
        self.close()
        return self.record

    def close(self) -> None:
        """End the processes of laws that are not shipped."""
        for runs in (self.law, self._decider):
            if runs is not None:
                runs.close()

    @property
    def _law_failed(self) -> str:
        """Why the law is not relied on any more; empty: it is."""
        if self._decider is not None:
            return self._decider.law_failed
        return "" if self.law is None else self.law.failed

    def get_ready(self) -> None:
        """Compile or load the kernels."""
        warm_up()
        prepare(self.settings.safety)
        self._closest_m([self.world.position_m])

    @property
    def is_over(self) -> bool:
        return self.time_s >= self.scenario.duration_s - 1e-9 or self.finished()

    def step(self) -> None:
        """Fly one tick."""
        self.before_tick()
        self._tick()

    def share_flown(self) -> float:
        return self.time_s / self.scenario.duration_s

    def true_target_m(self) -> Array:
        """(2,) where the target is."""
        return np.array(self.plan.target.position_m(self.time_s))

    def before_tick(self) -> None:
        """Do what operator, commander and maneuvers would do before this tick."""

    def lost_now(self) -> None:
        """Do what follows when vehicles are taken for lost.

        Vehicles whose paths they close leave the plan of the return. Those whose landing sites they close
        land at the next free sites.
        """
        if self._progress is None:
            return
        self.record.expected = self.record.expected & ~(self.losses.known & self.world.in_air)
        returning, goes = self._returning, (self.task == Task.GOAL) & ~self.descending
        uncertainty_m = np.array(self.traits.uncertainty_m)
        lost = self.losses.segments_m, uncertainty_m[self.losses.segments_of]
        over_m, floor, goal_m = self._takeoff_height_m, self.floor, np.array(self.record.goal_m)
        at = np.flatnonzero(goes[returning])
        going = returning[at]
        about = floor, uncertainty_m[going], lost
        away = going[closed_places(goal_m[going], over_m, *about)]
        if len(away):
            goal_m[away] = self._return_places_m(away, over_m)[away]
        closed = closed_paths(self._progress.return_paths, at, self._progress.time_s, *about)
        leaves = np.isin(np.arange(len(goes)), np.union1d(away, going[closed]))
        if leaves.any():
            self.record.goal_m = goal_m
            self._lead_down(leaves, goal_m, returns=True)

    def finished(self) -> bool:
        return False

    @property
    def steered(self) -> Mask:
        """(n,) vehicles that `proposed_m_s` may steer: none that a failsafe or the return leads."""
        return np.asarray(self.task == Task.FORMATION)

    def led(self, tasks: Tasks) -> Tasks:
        """Return the tasks as a drawn show, if one leads, has them."""
        return tasks

    def sight(self) -> Sight | None:
        """What the vehicles received from each other by now; None: the law is computed on the ground."""
        return None

    def near_traffic(self) -> NearTraffic | None:
        """Traffic that vehicles keep clear of in this tick; None: there is none."""
        return None

    def _tick(self) -> None:
        fleet = self.world.receive(self.memory.asked_m_s)
        if self.reports is not None:
            self.traits = self.reports.widened(self.traits, self.floor.deviations)
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
            center_moves=self.center_moves and not paused and not self._law_failed,
            formation_waits=paused,
            follows_planned_path=self._follows_planned_path(),
            segments_of=self.losses.segments_of,
            drift=self.losses.drift,
            silent_segments=self.losses.silent_segments,
            near_traffic=self.near_traffic(),
        )
        if self.reports is not None:
            tasks = self.reports.with_standing(tasks, fleet)
        decided = self._decide(fleet, self.led(tasks))
        self.decided, self.memory = decided, decided.memory
        self._mind_failsafes(fleet)
        self._keep(decided)
        self.world.send(decided.setpoints)
        seen_m = self.world.advance()
        if self.reports is not None:
            self.reports.note(self.time_s, self.task, decided.setpoints)
        self.record.closest_m.append(self._closest_m(seen_m))

    def _decide(self, fleet: FleetState, tasks: Tasks) -> Decided:
        """Compute the tick of the flight, or of each of several."""
        if self._decider is not None:
            decided = self._decider.decide(fleet, tasks, self.plan, self.traits, self.settings)
            self._note_law()
            return decided
        sight = self.sight()
        began_s = time.thread_time()
        proposed_m_s = self.proposed_m_s
        if proposed_m_s is not None:
            proposed_m_s = np.where(self.steered[:, None], proposed_m_s, np.nan)
        result = tick(
            fleet,
            tasks,
            self.plan,
            self.traits,
            self.memory,
            self.settings,
            sight,
            runner=self._runner(),
            proposed_m_s=proposed_m_s,
        )
        memory = result.memory
        took_s = time.thread_time() - began_s
        self._note_law()
        return Decided(result.setpoints, memory, result.limited_by, (took_s,))

    def _note_law(self) -> None:
        if self._law_failed and self.record.law_failed is None:
            self.record.law_failed = round(self.time_s, 3), self._law_failed

    def _runner(self) -> LawRunner | None:
        """What computes a law that is not shipped. Raises: ConfigError when its process does not begin."""
        name = self.plan.formation.law
        if name in SHIPPED:
            return None
        if self.law is None:
            self.law = law_process(name, self.settings, len(self.task), self.world.tick_s)
        return self.law.velocity

    def _mind_failsafes(self, fleet: FleetState) -> None:
        """Execute what the service's failsafes request, as the commander does."""
        if self.failsafes is None:
            return
        flying = self.world.in_air & self.present & (self.task != Task.NONE)
        formed, lost, fence = self.task == Task.FORMATION, self.losses.known, self.settings.safety.fence
        reports = self.reports
        judged = None if reports is None else reports.judged(fleet, self.settings.telemetry_age_max_s)
        about = fence, flying, formed, lost, judged
        for request in self.failsafes.advance(fleet, self.memory.desired_m_s, *about):
            self.record.failsafes.append((self.time_s, request.cause.value, request.action.value))
            rows = flying if request.whole_show else np.isin(np.arange(len(flying)), request.rows)
            if reports is not None and request.action is Action.HOLD:
                reports.hold(rows, self.task)
            elif request.action in {Action.HOLD, Action.PAUSE}:
                self.task[rows] = Task.GOAL
                self.goal_m[rows] = fleet.position_m[rows] + STOPS_WITHIN_S * fleet.velocity_m_s[rows]
            elif request.action is Action.LAND:
                rows = rows if reports is None else reports.land(rows, self.task, fleet)
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
        ellipses = ellipses_until(self.plan, self.settings, self.time_s, self.time_s + LANDS_WITHIN_S)
        fence, impact = self.settings.safety.fence, self.settings.safety.impact
        areas = fence.areas
        ground = ground_for_sites(fence.controlled_ground, impact, float(-here_m[rows, 2].min(initial=0.0)))
        sites_m[rows, :2] = distinct_sites_m(here_m[rows, :2], taken_m, spacing_m, ellipses, areas, ground)
        return sites_m

    def _lead_down(self, rows: Mask, site_m: Array, *, returns: bool = False) -> None:
        """Lead vehicles above their places (n, 3) and down, as `gcs.flight.maneuvers.landings` does."""
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
        low = may_hand_over(self.world.received_m, place_m, HANDOVER_HEIGHT_M)
        low = flown & (low | ~self.world.in_air)  # or reported as landed, also beside its place
        self.task[low] = Task.NONE
        self.world.leave_to_themselves(low, TOUCHDOWN_M_S)

    def _keep(self, decided: Decided) -> None:
        record, memory = self.record, decided.memory
        counts = self.stands or len(self.losses.segments_m) > 0 or self.record.way_s is not None
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
        if record.within_m_s is not None:
            record.within_m_s.append(self.world.velocity_m_s.copy())
        record.tick_s.extend(decided.took_s)
        record.time_s.append(self.time_s)
        record.position_m.append(self.world.position_m.astype(np.float32))
        record.formed.append((self.task == Task.FORMATION) & self.present)
        record.in_air.append(self.world.in_air & self.present)
        record.center_m.append(NOWHERE if memory.center is None else memory.center.position_m)
        record.radius_m.append(memory.radius_m)
        record.target_m.append(self.true_target_m())
        record.boxes.append(tuple(map(self._placed, self.plan.obstacles)))
        record.held_by.append("" if memory.detour is None else memory.detour.held_by)
        record.limited.append(len(decided.limited_by) - decided.limited_by.count(""))
        if record.details is not None:
            record.details.velocity_m_s.append(self.world.velocity_m_s.astype(np.float32))
            record.details.setpoint_m_s.append(self.world.of_all(decided.setpoints).astype(np.float32))
            record.details.limited_by.append(decided.limited_by)
            record.details.task.append(self.task.copy())

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
                near = pairs_inside(position_m, in_air, self.present, *limits, inside)
                self.record.violating.update((first, second) for first, second in near.tolist())
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
            ellipses = ellipses_of(self.plan, self.settings, self.time_s)
            shut = rows[shut_in_by(ellipses, here_m[rows], self.record.goal_m[rows], self.settings)]
            if len(shut):  # as in flight they leave the plan
                self._lead_down(np.isin(np.arange(len(flying)), shut), self.record.goal_m, returns=True)
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
        spacing_m = OperationSettings.model_fields["landing_site_spacing_m"].default
        down, here_m = ~self.world.in_air & self.present, self.world.received_m
        beside = down & (np.linalg.norm((here_m - place_m)[:, :2], axis=1) > spacing_m / 2.0)
        others_m = np.delete(place_m if self._progress is None else self.record.goal_m, rows, axis=0)
        taken_m = np.vstack([np.delete(place_m, rows, axis=0), others_m, here_m[down]])[:, :2]
        place_m[rows] = return_places_m(
            place_m[rows],
            taken_m,
            takeoff_height_m,
            spacing_m,
            self.settings,
            ellipses_of(self.plan, self.settings, self.time_s),
            uncertainty_m[rows],
            (losses.segments_m, uncertainty_m[losses.segments_of]),
            stands_m=here_m[beside, :2],
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
