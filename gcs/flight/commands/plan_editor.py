"""Changes of the plan: by operators, and from the record of an interrupted flight. All are checked first."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from gcs.flight.features.targets import Targets
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.formation.laws.registry import place_of
from gcs.model.errors import GcsError, RefusedError, UnknownError
from gcs.model.interrupted_flight import TAKEN_OVER_FROM, Interruption, Offer
from gcs.model.lifecycle import ON_THE_GROUND, Phase
from gcs.model.plan import MAX_OBSTACLES, Formation, Obstacle, Orbit, Plan, Target, Yaw, plan_of
from gcs.model.preflight_report import Exclusion
from gcs.model.state import Array, VehicleId
from gcs.model.target_fix import TargetFix
from gcs.planning.feasibility import check_formation, check_orbit, check_radius, check_target, followed

log = logging.getLogger(__name__)

Part = TypeVar("Part", Formation, Orbit, Yaw)


@dataclass(eq=False)
class PlanEditor:
    """Changes the plan of a flight, or refuses the change. Implements `gcs.service.PlanChanges`."""

    in_force: InForce
    show: ShowState
    vehicles: FlightVehicles
    excluded: Mapping[VehicleId, Exclusion]
    in_formation_m: Callable[[Sequence[Vehicle]], Array]  # uncertainty of these, and of those elsewhere
    show_player: ShowPlayer
    maneuvers: Maneuvers
    targets: Targets
    now_s: Callable[[], float]

    @property
    def current(self) -> Plan:
        return self.in_force.plan

    def _taking_part(self) -> list[Vehicle]:
        return [*self.vehicles.airborne, *self.maneuvers.waiting]

    def _to_fly(self) -> list[Vehicle]:
        """Vehicles that the formation must have room for: on the ground, those online and not excluded."""
        online = (vehicle for vehicle in self.vehicles.values() if vehicle.phase is not Phase.OFFLINE)
        included = [vehicle for vehicle in online if vehicle.id not in self.excluded]
        flying = included if self.show.phase in ON_THE_GROUND else self._taking_part()
        return flying or list(self.vehicles.values())

    def set_formation(self, formation: Formation, fields: Sequence[str] = ()) -> None:
        """Change radius, height and, on the ground, the law; a refusal names values that are accepted."""
        self.show_player.need_free("formation")
        was = self.in_force.plan.formation
        formation = _changed(was, formation, fields)
        if formation.law != was.law:
            place_of(formation.law)
            self.show.need_no_countdown()
            self.show_player.need_ground("change the law")
            if formation == replace(
                was, law=formation.law
            ):  # the radius stays, also where receivers are worse
                self.in_force.plan = replace(self.in_force.plan, formation=formation)
                return
        flying, target, control = self._to_fly(), self._followed(), self.in_force.control
        if formation.height_m == was.height_m and formation.radius_m > was.radius_m:
            check_radius(
                formation.radius_m, formation.height_m, target, self.in_force.plan.orbit, control.safety
            )
        uncertainty_m = self.in_formation_m(flying)
        if formation.radius_m == was.radius_m and formation.height_m <= was.height_m:
            # the radius stays, also where receivers are worse
            uncertainty_m = np.zeros_like(uncertainty_m)
        check_formation(formation, len(uncertainty_m), control.safety, uncertainty_m)
        check_target(
            target,
            self.in_force.plan.orbit,
            formation,
            control,
            changed="formation",
            instead_of=(self.in_force.plan.orbit, was),
        )
        self.in_force.plan = replace(self.in_force.plan, formation=formation)

    def set_orbit(self, orbit: Orbit, fields: Sequence[str] = ()) -> None:
        self.show_player.need_free("orbit")
        was, control = self.in_force.plan.orbit, self.in_force.control
        orbit = _changed(was, orbit, fields)
        check_orbit(orbit, control.law)
        formation = self.in_force.plan.formation
        check_target(
            self._followed(), orbit, formation, control, changed="orbit", instead_of=(was, formation)
        )
        self.in_force.plan = replace(self.in_force.plan, orbit=orbit)

    def set_target(self, target: Target) -> None:
        followed = self.show.run is None and target.speed_m_s > 0.0
        self.show_player.set_target(replace(target, time_s=self.now_s(), followed=followed))
        self.targets.select("")

    def select_target(self, name: str) -> None:
        self.targets.select(name)

    def hold_target(self) -> None:
        """Hold the target; on the ground a show that leads keeps its own, and none is followed later."""
        now_s, run = self.now_s(), self.show.run
        if self.show.phase not in ON_THE_GROUND or run is None or run.is_live(now_s):
            self.show_player.set_target(self.in_force.plan.target.held(now_s), checked=False)
        self.targets.select("")

    def report_target(self, name: str, fix: TargetFix) -> None:
        self.targets.report(name, fix)

    def _followed(self) -> Target:
        now_s = self.now_s()
        return followed(self.in_force.plan, now_s, self.in_force.control.safety.fence)

    def set_yaw(self, yaw: Yaw, fields: Sequence[str] = ()) -> None:
        self.in_force.plan = replace(self.in_force.plan, yaw=_changed(self.in_force.plan.yaw, yaw, fields))

    def add_obstacle(self, obstacle: Obstacle) -> None:
        self.show_player.need_own_obstacle(obstacle.id)
        if any(box.id == obstacle.id for box in self.in_force.plan.obstacles):
            raise RefusedError(f"there is an obstacle {obstacle.id} already; change or remove it")
        if len(self.in_force.plan.obstacles) + self.show_player.reserved >= MAX_OBSTACLES:
            raise RefusedError(f"there are {MAX_OBSTACLES} obstacles already, the most possible; remove one")
        self._place_obstacle(obstacle)

    def change_obstacle(self, obstacle: Obstacle) -> None:
        self._need_obstacle(obstacle.id)
        self._place_obstacle(obstacle)

    def remove_obstacle(self, obstacle_id: str) -> None:
        self._need_obstacle(obstacle_id)
        self._set_obstacles([box for box in self.in_force.plan.obstacles if box.id != obstacle_id])

    def _need_obstacle(self, obstacle_id: str) -> None:
        self.show_player.need_own_obstacle(obstacle_id)
        ids = [obstacle.id for obstacle in self.in_force.plan.obstacles]
        if obstacle_id not in ids:
            raise UnknownError(f"there is no obstacle {obstacle_id}; there are {', '.join(ids) or 'none'}")

    def _place_obstacle(self, obstacle: Obstacle) -> None:
        """An obstacle that is there is a fact, whoever is near: it is never refused."""
        others = [box for box in self.in_force.plan.obstacles if box.id != obstacle.id]
        self._set_obstacles([*others, replace(obstacle, time_s=self.now_s())])

    def _set_obstacles(self, obstacles: Sequence[Obstacle]) -> None:
        self.in_force.plan = replace(self.in_force.plan, obstacles=tuple(obstacles))


def _changed(was: Part, desired: Part, fields: Sequence[str]) -> Part:
    """`was` with these fields of `desired`; without fields, all of `desired`."""
    return replace(was, **{name: getattr(desired, name) for name in fields}) if fields else desired


def merged_obstacles(
    recorded: Sequence[Obstacle], configured: Sequence[Obstacle], now: Sequence[Obstacle]
) -> tuple[Obstacle, ...]:
    """Merge the interrupted flight's obstacles with an operator's changes since the restart.

    The newest command counts; `configured` are those with which this service began.
    """
    before, standing = {box.id: box for box in configured}, {box.id for box in now}
    changed = [box for box in now if before.get(box.id) != box]
    decided = {box.id for box in changed} | (before.keys() - standing)
    return (*(box for box in recorded if box.id not in decided), *changed)


@dataclass(eq=False)
class RestoredPlan:
    """Restores the plan of an interrupted flight, once for each offer. Changed on the event loop only."""

    in_force: InForce
    show: ShowState
    newest: Newest
    unix_s: Callable[[], float]
    show_player: ShowPlayer
    targets: Targets

    def __post_init__(self) -> None:
        self._configured = self.in_force.plan
        self._restored: set[Offer] = set()

    @property
    def is_taken_over(self) -> bool:
        return Offer.TAKE_OVER in self._restored

    def forget(self) -> None:
        """Forget the interruption: a later one is restored anew."""
        self._restored.clear()

    def why_not(self, interruption: Interruption) -> str:
        """Why no vehicle can return to the formation; empty when they can."""
        if interruption.show not in TAKEN_OVER_FROM:
            return f"take-over is not offered: the show was {interruption.show}"
        try:
            if interruption.stalled_s is not None and interruption.plan is None:
                return ""  # the plan that was flown still applies
            if interruption.written is not None:
                self.show_player.find(interruption.written.name, interruption.written.hash)
            else:
                self._checked(interruption)
        except GcsError as error:
            return f"take-over is not offered: {error}"
        return ""

    def restore(self, interruption: Interruption, offer: Offer) -> None:
        """Restore the whole plan to take over, or its obstacles to return the vehicles.

        Raises: RefusedError if a take-over cannot fly it; a return is never refused.
        """
        if interruption.plan is None and interruption.stalled_s is not None:
            return  # the service has kept it
        if not self._restored.isdisjoint({offer, Offer.TAKE_OVER}):
            return
        if offer is Offer.BRING_HOME:
            self._restore_obstacles(interruption)
        else:
            plan = self._restored_target(interruption, self._checked(interruption))
            if interruption.written is None:
                self.in_force.plan = plan
            elif self.show.run is None:
                self.show_player.resume(interruption.written, plan)
        self._restored.add(offer)

    def _restored_target(self, interruption: Interruption, plan: Plan) -> Plan:
        """Select the target that was followed, unless an operator has; without one the formation holds."""
        raw = {} if interruption.plan is None else interruption.plan
        name, now_s = str(raw.get("followed", "")), self.newest.state.time_s
        if not name or self.targets.selected or self.in_force.plan.target != self._configured.target:
            return plan
        try:
            self.targets.resume(name, plan.target.time_s)
        except UnknownError as error:
            log.warning("target_not_restored", extra={"target": name, "reason": str(error)})
            return replace(plan, target=plan.target.held(now_s))
        return plan

    def _restore_obstacles(self, interruption: Interruption) -> None:
        """Restore as many obstacles as are allowed; an unreadable record has none."""
        if interruption.plan is None or self.show.run is not None:
            return
        try:
            recorded = self._recorded(interruption).obstacles
        except RefusedError as error:
            log.warning("obstacles_not_restored", extra={"reason": str(error)})
            return
        merged = merged_obstacles(recorded, self._configured.obstacles, self.in_force.plan.obstacles)
        if len(merged) > MAX_OBSTACLES:
            reason = f"{len(merged)} obstacles, at most {MAX_OBSTACLES} stand: the oldest are left out"
            log.warning("obstacles_not_restored", extra={"reason": reason})
        self.in_force.plan = replace(self.in_force.plan, obstacles=merged[-MAX_OBSTACLES:])

    def _recorded(self, interruption: Interruption) -> Plan:
        """The recorded plan, with target and obstacles moved to now. Raises: RefusedError if unreadable."""
        if interruption.plan is None:
            raise RefusedError("what was flown is not in the record")
        now_s = self.newest.state.time_s
        try:
            shift_s = now_s - (self.unix_s() - interruption.unix_s) - float(interruption.plan["time_s"])
            return plan_of(interruption.plan, shift_s)
        except (GcsError, KeyError, TypeError, ValueError) as error:
            raise RefusedError(f"the plan of the record cannot be read: {error!r}") from None

    def _merged(self, interruption: Interruption) -> Plan:
        """The recorded plan with an operator's changes since the restart. Raises: RefusedError."""
        recorded, configured, now = self._recorded(interruption), self._configured, self.in_force.plan
        merged = merged_obstacles(recorded.obstacles, configured.obstacles, now.obstacles)
        if len(merged) > MAX_OBSTACLES:
            text = f"{len(merged)} obstacles, with those of the interrupted flight; at most {MAX_OBSTACLES}"
            raise RefusedError(f"{text}: remove {len(merged) - MAX_OBSTACLES}")
        return Plan(
            formation=replace(
                recorded.formation if now.formation == configured.formation else now.formation,
                law=recorded.formation.law,  # not changed in flight
            ),
            orbit=recorded.orbit if now.orbit == configured.orbit else now.orbit,
            target=recorded.target if now.target == configured.target else now.target,
            obstacles=merged,
            yaw=recorded.yaw if now.yaw == configured.yaw else now.yaw,
        )

    def _checked(self, interruption: Interruption) -> Plan:
        """The merged plan, if it may be flown. Raises: RefusedError."""
        plan, control = self._merged(interruption), self.in_force.control
        if interruption.written is not None:
            return plan  # checked as a whole, under its own limits
        try:
            # As configured, not as reported: a worse accuracy must not leave flying vehicles uncontrolled.
            check_formation(plan.formation, max(1, len(interruption.vehicles)), control.safety)
            check_orbit(plan.orbit, control.law)
            target = followed(plan, self.newest.state.time_s, control.safety.fence)
            target, flown = replace(target, clearance_m=0.0), (plan.orbit, plan.formation)
            check_target(target, *flown, control, instead_of=flown)  # the areas' walls keep it as it was
        except GcsError as error:
            raise RefusedError(f"what was flown cannot be flown now: {error}") from None
        return plan
