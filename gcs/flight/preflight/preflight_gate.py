"""Decides which vehicles may start, and why others may not. Runs only on the ground, and only on request."""

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from gcs.flight.preflight.parameter_reader import ParameterReader
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.flight import NOT_CHOSEN, Flight
from gcs.flight.state.refusals import Refusals, with_alternative
from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.vehicle import Vehicle
from gcs.model.errors import GcsError, InvalidError, RefusedError
from gcs.model.lifecycle import GROUNDED, ON_THE_GROUND, Phase
from gcs.model.plan import Obstacle
from gcs.model.preflight_report import (
    Check,
    Exclusion,
    PreflightAction,
    PreflightCause,
    PreflightReport,
    Remedy,
    State,
    VehicleChecks,
    describe,
)
from gcs.model.state import Array, VehicleId
from gcs.planning.feasibility import (
    check_clearance,
    check_formation,
    check_obstacle,
    check_target,
    smallest_formation_radius_m,
)
from gcs.planning.landing_sites import column_m, describe_columns, most_overlapping
from gcs.planning.loss_times import APART_MAX_S, check_loss_times
from gcs.planning.setpoint_loss import PREDICTED_MAX, check_setpoint_loss, formation_m
from gcs.preflight.causes import ALONE, DOWN, RECEIVED, STANDBY, Finding, causes_of, in_words
from gcs.preflight.fleet import OF_THE_PATTERN, FleetReadiness, Pattern, standing
from gcs.preflight.pad_distances import ROOM, TO_THE_NEXT, room_to_wander, spacing
from gcs.preflight.vehicles import PreflightInputs, fix_words, own_checks
from gcs.safety.impact import SIMULATED, ImpactSettings
from gcs.service import CALLER, CommandRecord

log = logging.getLogger(__name__)

REASON_MAX = 200
"""Longest reason of an exclusion, in characters."""

EVALUATIONS_MIN, EVALUATIONS_MAX, EVALUATED_PAIRS = 2, 40, 144_000
"""How often a report is evaluated again to find which causes others follow from; each looks at all pairs."""

SUSPECTS = 4
"""Vehicles that are named as possible causes of a check of the fleet."""

OF_SEVERAL = frozenset({TO_THE_NEXT, ROOM, *ALONE})
"""Checks of a vehicle that depend on others."""

AGAIN_S = 1.0
"""Shortest interval between two reports: a report is expensive for large fleets."""

SWAYS_M = 0.5
"""Two vehicles may be nearer to each other than their slots by this distance."""

ON_GROUND = "all vehicles on the ground and received"
AS_CHECKED = "as it was checked, with as many vehicles"
OF_THE_SHOW: Final = frozenset(
    {"place", *OF_THE_PATTERN, "formation", "kept clear", "loss of the ground station", "obstacles"}
)
"""Checks that say nothing where the selected show is another one by now."""

STATIONS: Final = "stations"
"""Check of the other stations, of a report that is asked for at one of several."""

AIRFRAME: Final = "airframe"
"""Check of what the configuration says of the vehicles' falls, where they have to stay on some ground."""

NOT_WEIGHED: Final = (
    "control.safety.impact.airframe is not set: where vehicles would fall is computed for"
    f" {SIMULATED.mass_kg:g} kg, {SIMULATED.drag_area_m2:g} m^2 and {SIMULATED.dimension_m:g} m"
)

SELECT_AGAIN: Final = "select it again, once its check is good"
TO_DO: Final = {
    "vehicles": "include vehicles, or wait until they are received on the ground",
    RECEIVED: "check its power, its link and its ids, or leave it out",
    STANDBY: "wait until it is on the ground, with its motors off",
    DOWN: "look for it; confirm that it is down once it was seen on the ground",
    "show": "check and select the show again, name the vehicles that fly, or take the others out",
    "formation": "choose a larger radius, better receivers, or fewer vehicles",
    "target": "say where the target is now, and how it moves",
    "kept clear": "have it go away, or move the vehicles; select a lost one, then hold: it is forgotten",
    "loss times": "do as the text says, or fly vehicles with one time only",
    "loss of the ground station": "do as the text says, or choose a larger radius",
    "obstacles": "remove the obstacle, or move the pad",
    AIRFRAME: "weigh and measure the vehicle that comes farthest: set mass_kg, drag_area_m2 and dimension_m"
    " there, and start the service again",
    STATIONS: "mend it there: gcs preflight at that station has all of it",
}


class Cleared(NamedTuple):
    """Vehicles that may start, and why the others may not."""

    chosen: list[VehicleId]
    left_out: dict[VehicleId, str]


Question: TypeAlias = tuple[tuple[VehicleId, ...] | None, ShowRun | None, frozenset[VehicleId]]
"""What a report answers: the vehicles that are to fly, the selected show, and the excluded vehicles."""


@dataclass(eq=False)
class PreflightGate:
    """Runs all checks before a start, and excludes vehicles from it. Implements `gcs.service.Preflight`."""

    flight: Flight
    refusals: Refusals
    parameter_reader: ParameterReader
    show_player: ShowPlayer
    _last: tuple[float, Question, PreflightReport] | None = None  # the newest report, and its time
    _passed: frozenset[tuple[VehicleId, str]] = frozenset()  # vehicles and checks, of the newest report

    @with_alternative
    def report(self, vehicles: Sequence[VehicleId] | None = None) -> PreflightReport:
        """As of the port: made within the last second; in the air it is the report from before take-off."""
        flight = self.flight
        for name in vehicles or ():
            flight.vehicles.named(name)
        if flight.show.phase not in ON_THE_GROUND or flight.vehicles.airborne:
            if self._last is None:
                raise RefusedError(f"preflight is for the ground, and the show is {flight.show.phase}")
            return replace(self._last[2], in_flight=self._in_flight())
        made_s, question, report = self._last or (-np.inf, None, None)
        same = question == self._question(vehicles) and flight.newest.state.time_s - made_s < AGAIN_S
        if same and report is not None:
            return report
        show_run = self.flight.show.run
        return self._made(vehicles, None if show_run is None else show_run.hash)

    @property
    def left_out(self) -> frozenset[VehicleId]:
        """Vehicles that operators have taken out of the show."""
        return frozenset(self.flight.excluded)

    def outlook(self) -> str:
        """Why a start of all that are not left out would be refused now, in short; empty: it would not.

        For looks at regular intervals: no parameters are read again because of one.
        """
        made_s, question, report = self._last or (-np.inf, None, None)
        is_new = self.flight.newest.state.time_s - made_s < AGAIN_S and question == self._question(None)
        if report is None or not is_new:
            show_run, before = self.flight.show.run, self._last
            report = self._made(None, None if show_run is None else show_run.hash, reads_again=False)
            self._last = before  # a report that is asked for has the parameters read again
        return report.in_short

    def _question(self, desired: Sequence[VehicleId] | None) -> Question:
        meant = None if desired is None else tuple(desired)
        return meant, self.flight.show.run, frozenset(self.flight.excluded)

    def _in_flight(self) -> str:
        flight = self.flight
        flies = f"{len(flight.vehicles.airborne)} of {len(flight.vehicles)} vehicles fly"
        return f"the show is {flight.show.phase}, {flies}; a start is refused until all are down"

    def _made(
        self, desired: Sequence[VehicleId] | None, show_hash: str | None, *, reads_again: bool = True
    ) -> PreflightReport:
        """Look at everything, for a start with this hash; `reads_again` as of `ParameterReader.checks`."""
        meant, left_out = self.meant(desired)
        chosen = [name for name in meant if self.flight.vehicles[name].phase is Phase.STANDBY]
        fleet = [_all_vehicles(chosen, meant)]
        look_at_show = partial(self._show, show_hash=show_hash, desired=desired)
        if show_hash is not None or self.flight.show.run is not None:
            fleet.append(look_at_show(meant))
        looked = self._look(chosen, reads_again=reads_again)
        for name, check in self._absences(meant).items():
            looked.of[name].insert(0, check)
        fleet += looked.fleet
        for name, limit, look in self._setpoint_loss_checks(chosen):
            fleet.append(self._with_suspects(_tried(name, limit, look), chosen))
        failing = [check.name for check in fleet if not check.passes]
        causes = self._causes(meant, chosen, looked, frozenset(failing), look_at_show)
        report = self._report(Cleared(meant, left_out), fleet, looked, causes)
        self._last = self.flight.newest.state.time_s, self._question(desired), report
        return report

    def _causes(
        self,
        meant: Sequence[VehicleId],
        chosen: Sequence[VehicleId],
        looked: FleetReadiness,
        failing: Collection[str],
        look_at_show: Callable[..., Check],
    ) -> tuple[PreflightCause, ...]:
        """Fold what fails: a check about several vehicles is evaluated again without some of them."""
        fails = {name: [check for check in looked.of[name] if not check.passes] for name in meant}
        if not failing and not any(fails.values()):
            return ()
        inputs, pattern, outdated = self._inputs(), self._pattern(), self.show_player.outdated
        own = {name: [check for check in of if check.name not in OF_SEVERAL] for name, of in fails.items()}

        def related(out: frozenset[VehicleId]) -> list[Finding]:
            kept = [name for name in chosen if name not in out]
            left = [name for name in meant if name not in out]
            findings: list[Finding] = []
            near = spacing(inputs, kept, kept)
            stand, room = standing(inputs, kept, pattern), room_to_wander(inputs, kept, pattern)
            for name in kept:
                of = [*near[name], *stand.of[name], *([room[name]] if name in room else [])]
                findings += [(name, check) for check in of]
            fleet = [_all_vehicles(kept, left), *stand.fleet] if left or not out else []
            fleet += self._of_the_flight()
            if "show" in failing:  # without vehicles a show says nothing about them
                fliers, also_out = (left, len(out)) if left else (meant, 0)
                fleet.append(look_at_show(fliers, also_out=also_out))
            for name, limit, look in self._setpoint_loss_checks(kept):
                if name in failing:
                    fleet.append(self._with_suspects(_tried(name, limit, look), kept))
            findings += [(None, check) for check in fleet]
            failed = [each for each in findings if not each[1].passes]
            return [*map(_of_another_show, failed)] if outdated else failed

        causes = causes_of(own, related, partial(self._mended, chosen), _evaluations(len(chosen)))
        return tuple(sorted(causes, key=lambda cause: not (outdated and cause.check == "show")))

    def _with_suspects(self, check: Check, chosen: Sequence[VehicleId]) -> Check:
        """Name the vehicles that may be why a check of the fleet fails: the least certain, or the odd one."""
        if check.passes or check.name not in {"formation", "loss times", "loss of the ground station"}:
            return check
        values = self.flight.newest.uncertainty_m([self.flight.vehicles[name] for name in chosen])
        if check.name != "formation":
            values = np.array([self.flight.vehicles[name].without_setpoints.flies_on_s for name in chosen])
        unlike = np.argsort(-np.abs(values - np.median(values)), kind="stable")[:SUSPECTS]
        return replace(check, depends_on=tuple(chosen[row] for row in unlike.tolist()))

    def _mended(
        self, chosen: Sequence[VehicleId], name: str, out: frozenset[VehicleId]
    ) -> PreflightAction | None:
        """What mends a check of the fleet, but for leaving vehicles out."""
        kept, plan = [each for each in chosen if each not in out], self.flight.in_force.plan
        if name == "obstacles":
            blocked = [box for box in self.show_player.obstacles() if self._blocks(box, kept)]
            if blocked and blocked[0].id in {box.id for box in plan.obstacles}:
                label = f"Remove obstacle {blocked[0].id}"
                return PreflightAction(Remedy.REMOVE_OBSTACLE, label, "", obstacle=blocked[0].id)
        if name == "formation" and self.flight.show.run is None:
            uncertainty_m = self.flight.in_formation_m([self.flight.vehicles[each] for each in kept])
            safety = self.flight.in_force.control.safety
            radius_m = smallest_formation_radius_m(len(uncertainty_m), safety, uncertainty_m)
            formation = replace(plan.formation, radius_m=radius_m)
            check = _tried(
                name, "", lambda: check_formation(formation, len(uncertainty_m), safety, uncertainty_m)
            )
            if check.passes and radius_m > plan.formation.radius_m:
                return PreflightAction(
                    Remedy.SET_RADIUS, f"Set the radius to {radius_m:g} m", "", radius_m=radius_m
                )
        return None

    def _blocks(self, obstacle: Obstacle, vehicles: Sequence[VehicleId]) -> bool:
        pads_m = {name: self.flight.newest.position_m(self.flight.vehicles[name]) for name in vehicles}
        avoidance = self.flight.in_force.control.law.avoidance
        return not _tried("obstacles", "", lambda: check_obstacle(obstacle, avoidance, {}, pads_m)).passes

    def _report(
        self,
        cleared: Cleared,
        fleet: Sequence[Check],
        looked: FleetReadiness,
        causes: tuple[PreflightCause, ...],
    ) -> PreflightReport:
        show, flying = self.flight.show.run, set(cleared.chosen)
        return PreflightReport(
            unix_time_s=self.flight.unix_s(),
            show=None if show is None else show.name,
            show_hash=None if show is None else show.hash,
            fleet=tuple(fleet),
            vehicles=tuple(
                VehicleChecks(
                    name,
                    name in flying,
                    cleared.left_out.get(name, ""),
                    tuple(checks),
                    self.flight.vehicles[name].autopilot.name,
                    self.flight.version(name),
                )
                for name, checks in looked.of.items()
            ),
            not_checked=tuple(looked.not_checked),
            causes=causes,
        )

    def need(self, show_hash: str | None, desired: Sequence[VehicleId] | None) -> Cleared:
        """Return the vehicles that fly and those that do not, before a start.

        Raises: RefusedError, UnknownError with all reasons against the start, causes first.
        """
        for name in desired or ():
            self.flight.vehicles.named(name)
            if name in self.flight.excluded:
                raise RefusedError(f"{name} was {self.flight.excluded[name]}; include it first")
        before, report = self._last, self._made(desired, show_hash)
        if not report.passes:
            self._last = before  # that one is of the selected show's hash
            raise RefusedError(in_words(report))
        cleared = self.meant(desired)
        self._check_vertical_overlap(cleared.chosen)
        return cleared

    def need_alone(self, vehicle_id: VehicleId) -> None:
        """Check one vehicle at its turn to take off. Raises: RefusedError with all reasons against it."""
        flying = {vehicle_id, *self.flight.show.accepted}
        checks = self._alone(self._inputs(), [vehicle_id], flying)[vehicle_id]
        if text := describe((vehicle_id, check) for check in checks):
            raise RefusedError(text)
        self._check_obstacles([vehicle_id])  # one may have come to its pad since the start

    def _show(
        self,
        chosen: Sequence[VehicleId],
        *,
        show_hash: str | None,
        desired: Sequence[VehicleId] | None,
        also_out: int = 0,
    ) -> Check:
        out, player = len(self.flight.excluded) + also_out, self.show_player
        start = partial(player.check_start, chosen, show_hash, named=desired is not None, taken_out=out)
        check = _tried("show", AS_CHECKED, start)
        return replace(check, to_do=SELECT_AGAIN) if player.outdated else check

    def _look(self, chosen: Sequence[VehicleId], *, reads_again: bool) -> FleetReadiness:
        """Inspect the vehicles that are to fly together, and each of all vehicles alone."""
        inputs = self._inputs()
        alone = self._alone(inputs, list(self.flight.vehicles), chosen, reads_again=reads_again)
        pattern = self._pattern()
        stand = standing(inputs, chosen, pattern)
        room = room_to_wander(inputs, chosen, pattern)
        for name, check in room.items():
            alone[name].append(check)
        for name, checks in stand.of.items():
            alone[name] += checks
        self._passed = frozenset(
            (name, each.name) for name, checks in alone.items() for each in checks if each.passes
        )
        operation, settings = self.flight.config.operation, self.flight.config.preflight
        unlooked = {
            "parameters, speed limits, own fence: operation.require_parameters is false": (
                not operation.require_parameters
            ),
            "loss times, loss of the ground station: operation.require_safe_setpoint_loss is false": (
                not operation.require_safe_setpoint_loss
            ),
            "fix, accuracy: preflight.require_fix is false": not settings.require_fix,
            "room to wander: preflight.wander_m is 0": settings.wander_m == 0.0,
            "clock: preflight.clock_max_s is null": settings.clock_max_s is None,
        }
        not_checked = [text for text, is_off in unlooked.items() if is_off] + self.parameter_reader.risks()
        not_checked += self._ways_of_autopilots()
        fleet = [*stand.fleet, *self._of_the_flight()]
        return FleetReadiness(fleet, alone, [*stand.not_checked, *not_checked])

    def _of_the_flight(self) -> list[Check]:
        """Checks that do not depend on which vehicles fly."""
        flight, safety = self.flight, self.flight.in_force.control.safety
        of_features = chain.from_iterable(each.checks(flight.instant) for each in flight.features)
        if safety.fence.controlled_ground is None:
            return [*of_features]
        return [_weighed(safety.impact), *of_features]

    def _ways_of_autopilots(self) -> list[str]:
        """Name what the show's check warns of, and returns of autopilots above the fence."""
        flight, show = self.flight, self.flight.show.run
        warnings = [] if show is None or show.figures is None else list(show.figures.warnings)
        highest_m = float(flight.config.return_heights_m.max(initial=0.0))
        fence_m = flight.in_force.control.safety.fence.height_max_m
        if flight.config.operation.setpoint_loss_action == "return" and highest_m > fence_m:
            text = (
                f"autopilots return by themselves at up to {highest_m:g} m, above the fence at {fence_m:g} m"
            )
            warnings.append(text)
        return warnings

    def _alone(
        self,
        inputs: PreflightInputs,
        vehicles: Sequence[VehicleId],
        flying: Collection[VehicleId],
        *,
        reads_again: bool = True,
    ) -> dict[VehicleId, list[Check]]:
        near = spacing(inputs, vehicles, flying)
        meant = self.flight.config.operation.require_parameters
        return {
            name: [
                *own_checks(inputs, name),
                *near[name],
                *(self.parameter_reader.checks(name, reads_again=reads_again) if meant else ()),
                *chain.from_iterable(
                    each.vehicle_checks(self.flight.vehicles[name], self.flight.instant)
                    for each in self.flight.features
                ),
            ]
            for name in vehicles
        }

    def _inputs(self) -> PreflightInputs:
        flight, operation = self.flight, self.flight.config.operation
        show = flight.show.run
        figures = None if show is None else show.figures
        return PreflightInputs(
            fleet=flight.newest.state,
            rows={name: vehicle.row for name, vehicle in flight.vehicles.items()},
            telemetry=flight.newest.telemetry,
            conflicts={name: text for link in flight.links for name, text in link.conflicts.items()},
            foreign={name: text for link in flight.links for name, text in link.foreign.items()},
            without_autopilot={
                name: absent for link in flight.links for name, absent in link.without_autopilot.items()
            },
            uncertainty_m=flight.uncertainty_on_pads_m,
            age_max_s=flight.in_force.control.telemetry_age_max_s,
            floor=flight.in_force.control.safety.floor,
            fence=flight.in_force.control.safety.fence,
            positioning=flight.config.positioning,
            settings=flight.config.preflight,
            passed=self._passed,
            pads_within_m=operation.pads_within_m if operation.require_parameters else np.inf,
            battery_need=0.0 if show is None else None if figures is None else figures.battery_need,
            speed_need_m_s=0.0 if figures is None else figures.speed_max_m_s,
            speed_max_m_s=flight.newest.traits.speed_max_m_s,
            heights=flight.heights.found,
            moved=flight.places.found,
            complaints={name: self._complaints(vehicle) for name, vehicle in flight.vehicles.items()},
            others=flight.elsewhere.placed(),
            frame=flight.config.frame,
            ahead_s=self._ahead_s,
        )

    def _complaints(self, vehicle: Vehicle) -> list[str]:
        """Why its autopilot would not arm, in its own words."""
        (prefix, lasts_s), newest = vehicle.autopilot.complains, self.flight.newest
        texts = (each for each in newest.telemetry.texts[vehicle.row] if each.text.startswith(prefix))
        return [
            each.text.removeprefix(prefix) for each in texts if newest.state.time_s - each.time_s <= lasts_s
        ]

    @property
    def _ahead_s(self) -> float:
        """Our Unix time minus the loop's clock."""
        return self.flight.unix_s() - self.flight.newest.state.time_s

    def _pattern(self) -> Pattern | None:
        """Return the selected show's pads, in the order of the fleet; without a show the configured ones."""
        flight, config = self.flight, self.flight.config
        heading_deg = config.show_frame.heading_deg
        if flight.show.run is not None:
            show, name = flight.show.run.timeline.show, flight.show.run.name
            drawn = "" if show.drawing is None else name
            return Pattern(show.start_places_m[:, :2], self.show_player.pads(), heading_deg, drawn)
        places = config.preflight.start_places
        if not places:
            return None
        places_m = np.array([[place.x_m, place.y_m] for place in places.values()])
        return Pattern(places_m, {name: row for row, name in enumerate(places)}, heading_deg)

    def _setpoint_loss_checks(
        self, chosen: Sequence[VehicleId]
    ) -> Iterator[tuple[str, str, Callable[[], None]]]:
        """Yield the checks of what would go wrong in the air, as far as it can be predicted; each raises."""
        flight, operation = self.flight, self.flight.config.operation
        if not chosen or not all(
            np.isfinite(flight.newest.position_m(flight.vehicles[name])).all() for name in chosen
        ):
            return
        yield ("formation", "a sphere that has room for all vehicles", lambda: self._check_formations(chosen))
        if flight.show.run is None:
            yield "target", "where the formation can follow it", self._check_target
        if flight.newest.kept_clear or flight.in_force.plan.target.clearance_m:
            yield "kept clear", "no target is too near to a pad", lambda: self._check_pads(chosen)
        if operation.require_safe_setpoint_loss:
            alone = [flight.vehicles[name].without_setpoints for name in chosen]
            flies_on_s = np.array([each.flies_on_s for each in alone])
            limit = f"at most {APART_MAX_S:g} s apart"
            elsewhere_s = None if flight.elsewhere.alone else operation.setpoint_loss_s
            yield "loss times", limit, partial(check_loss_times, chosen, flies_on_s, elsewhere_s)
        if operation.require_safe_setpoint_loss and self.show_player.plans():
            rows = [flight.vehicles[name].row for name in chosen]
            look = partial(
                check_setpoint_loss,
                tuple(chosen),
                flight.newest.state.position_m[rows],
                self.show_player.plans(),
                flight.in_force.control,
                flight.newest.traits.uncertainty_m[rows],
                operation.setpoint_loss_action,
                flight.uncontrolled.without_setpoints.returns_at_m(flight.config.return_heights_m)[rows],
                self._fly_on_s(chosen),
            )
            yield "loss of the ground station", "no two vehicles are brought together", look
        yield "obstacles", "none on a pad", lambda: self._check_obstacles(chosen)

    def _fly_on_s(self, chosen: Sequence[VehicleId]) -> Array:
        """(n,) how long each flies on without setpoints, with its stop from the speed of the law."""
        alone = [self.flight.vehicles[name].without_setpoints for name in chosen]
        fastest_m_s = self.flight.in_force.control.law.speed_m_s
        return np.array([each.flies_on_s + each.stop_s(fastest_m_s) for each in alone])

    def _check_formations(self, chosen: Sequence[VehicleId]) -> None:
        """Check every sphere of the flight for the accuracy that these vehicles report now."""
        flight = self.flight
        uncertainty_m = flight.in_formation_m([flight.vehicles[name] for name in chosen])
        for cue, plan in self.show_player.plans():
            try:
                check_formation(
                    plan.formation, len(uncertainty_m), flight.in_force.control.safety, uncertainty_m
                )
            except InvalidError as error:
                by_own = error.field == "radius_m" and flight.elsewhere.alone
                whose = self._least_certain(chosen) if by_own else ""
                if not cue:
                    raise InvalidError(error.field, error.value, error.allowed + whose) from None
                raise RefusedError(f"at '{cue}': {error}{whose}") from None

    def _check_target(self) -> None:
        """Check that the target is where it can be followed: it has moved on since it was set."""
        plan, now_s = self.flight.in_force.plan, self.flight.newest.state.time_s
        x_m, y_m = plan.target.position_m(now_s)
        target = replace(plan.target, x_m=x_m, y_m=y_m, time_s=now_s)
        try:
            check_target(target, plan.orbit, plan.formation, self.flight.in_force.control)
        except InvalidError as error:
            raise RefusedError(f"the target has moved out of reach: {error}") from None

    def _check_pads(self, chosen: Sequence[VehicleId]) -> None:
        flight = self.flight
        pads_m = {name: flight.newest.position_m(flight.vehicles[name]) for name in chosen}
        for name, target in [*flight.newest.kept_clear.items(), ("", flight.in_force.plan.target)]:
            check_clearance(name, target.held(flight.newest.state.time_s), pads_m)

    def _least_certain(self, chosen: Sequence[VehicleId]) -> str:
        """Which vehicle's receiver decides the least radius, in words."""
        inputs = self._inputs()
        name = max(chosen, key=lambda name: float(inputs.uncertainty_m[inputs.rows[name]]))
        return f"; the least certain is {name}, with {fix_words(inputs, inputs.rows[name])}"

    def _check_obstacles(self, chosen: Sequence[VehicleId]) -> None:
        flight = self.flight
        pads_m = {name: flight.newest.position_m(flight.vehicles[name]) for name in chosen}
        for obstacle in self.show_player.obstacles():
            check_obstacle(obstacle, flight.in_force.control.law.avoidance, {}, pads_m)

    def _check_vertical_overlap(self, chosen: Sequence[VehicleId]) -> None:
        """Store how many pairs will be stacked, as far as it can be predicted."""
        flight, show_run = self.flight, self.flight.show.run
        rows = [flight.vehicles[name].row for name in chosen]
        width_m = column_m(flight.in_force.control.safety.floor, flight.newest.traits.uncertainty_m[rows])
        plans = [plan for _, plan in self.show_player.plans()]
        plan = min(plans, key=lambda each: each.formation.radius_m, default=None)  # None: drawn all along
        pairs = () if show_run is None or show_run.figures is None else show_run.figures.columns
        ids = flight.elsewhere.shows.starting(chosen)
        rehearsed = [
            f"{ids[pair.upper - 1]} above {ids[pair.lower - 1]} at '{pair.cue}'"
            for pair in pairs
            if max(pair.upper, pair.lower) <= len(ids)  # fewer may be named than were rehearsed
        ]
        words = ""
        if plan is not None and len(chosen) <= PREDICTED_MAX:
            formed_m = formation_m(
                tuple(chosen), flight.newest.state.position_m[rows], plan, flight.in_force.control
            )
            words = describe_columns(most_overlapping(formed_m, width_m + SWAYS_M), rehearsed)
        elif rehearsed:
            words = describe_columns(0, rehearsed)
        if words and words != flight.columns:
            log.info("columns_overlap", extra={"reason": words})
        flight.columns = words

    # participants

    def meant(self, desired: Sequence[VehicleId] | None) -> Cleared:
        """Return the vehicles that are to fly, whatever they do now, and why the others are not."""
        flight, meant = self.flight, list[VehicleId]()
        left_out: dict[VehicleId, str] = {}
        for name, vehicle in flight.vehicles.items():
            if name in flight.excluded:
                left_out[name] = str(flight.excluded[name])
            elif desired is not None and name not in desired:
                left_out[name] = NOT_CHOSEN
            elif not flight.elsewhere.owned[vehicle.row]:
                left_out[name] = f"{vehicle.phase}: {vehicle.reason}"
            else:
                meant.append(name)
        return Cleared(meant, left_out)

    def _absences(self, meant: Sequence[VehicleId]) -> dict[VehicleId, Check]:
        """Why vehicles that are to fly cannot start: they are silent, or not on the ground."""
        newest, absences = self.flight.newest, dict[VehicleId, Check]()
        for name in meant:
            vehicle = self.flight.vehicles[name]
            problem = f"{vehicle.phase}: {vehicle.reason.removesuffix('.')}"
            if vehicle.phase is Phase.OFFLINE:
                silent_s = newest.state.time_s - float(newest.telemetry.life_time_s[vehicle.row])
                value_s = silent_s if np.isfinite(silent_s) else None
                absences[name] = Check(
                    RECEIVED, State.FAIL, value_s, "s", "on the ground", problem, TO_DO[RECEIVED]
                )
            elif vehicle.phase is not Phase.STANDBY:
                kind = DOWN if vehicle.phase in {Phase.LOST, Phase.KILLED} else STANDBY
                absences[name] = Check(
                    kind, State.FAIL, None, "", "standby", f"{problem}; only standby can start", TO_DO[kind]
                )
        return absences

    @with_alternative
    def exclude(self, vehicle_id: VehicleId, reason: str) -> CommandRecord:
        if len(reason) > REASON_MAX:
            raise InvalidError("reason", reason[:20], f"at most {REASON_MAX} characters")
        self.flight.show.need_no_countdown()
        self._need_ground(vehicle_id)
        exclusion = Exclusion(CALLER.get(), reason, self.flight.unix_s())
        self.flight.excluded[vehicle_id] = exclusion
        log.warning("excluded", extra={"vehicle": vehicle_id, "by": exclusion.by, "reason": reason})
        return self.flight.book.done("exclude", [vehicle_id], reason=str(exclusion))

    @with_alternative
    def include(self, vehicle_id: VehicleId) -> CommandRecord:
        self.flight.show.need_no_countdown()
        self._need_ground(vehicle_id)
        exclusion = self.flight.excluded.pop(vehicle_id, None)
        if exclusion is None:
            raise RefusedError(f"{vehicle_id} was not taken out of the show")
        since_s = self.flight.places.found.since_s + self._ahead_s
        confirmed = since_s <= exclusion.unix_time_s  # what happened later was not seen by the operator
        confirmed &= np.arange(len(since_s)) == self.flight.vehicles[vehicle_id].row
        self.flight.places.forget(confirmed)
        log.info("included", extra={"vehicle": vehicle_id, "by": CALLER.get()})
        return self.flight.book.done("include", [vehicle_id])

    def _need_ground(self, vehicle_id: VehicleId) -> None:
        vehicle, flight = self.flight.vehicles.named(vehicle_id), self.flight
        if flight.show.phase not in ON_THE_GROUND or flight.vehicles.airborne:
            raise RefusedError(
                f"vehicles can be excluded or included only on the ground (the show is {flight.show.phase})"
            )
        if vehicle.phase not in GROUNDED:
            because = vehicle.reason.removesuffix(".")
            raise RefusedError(f"{vehicle_id} is {vehicle.phase}: {because}; it is not on the ground")


def _weighed(impact: ImpactSettings) -> Check:
    """Whether it is known how the vehicles fall; what is not known does not pass."""
    limit = "mass_kg, drag_area_m2, dimension_m"
    if (frame := impact.airframe) is None:
        return Check(AIRFRAME, State.UNKNOWN, limit=limit, problem=NOT_WEIGHED, to_do=TO_DO[AIRFRAME])
    return Check(AIRFRAME, State.PASS, frame.mass_kg, "kg", limit)


def _evaluations(count: int) -> int:
    """40 for 60 vehicles, 3 for 200."""
    return min(EVALUATIONS_MAX, max(EVALUATIONS_MIN, EVALUATED_PAIRS // max(1, count * count)))


def _of_another_show(finding: Finding) -> Finding:
    """Have what an outdated show asks for follow from that."""
    name, check = finding
    if check.name not in OF_THE_SHOW:
        return finding
    return name, replace(check, depends_on=(*check.depends_on, "show"))


def _all_vehicles(chosen: Sequence[VehicleId], meant: Sequence[VehicleId]) -> Check:
    if len(chosen) == len(meant) > 0:
        return Check("vehicles", State.PASS, len(chosen), "vehicles", ON_GROUND)
    problem = f"{len(chosen)} of {len(meant)} are received on the ground" if meant else "no vehicle is left"
    return Check("vehicles", State.FAIL, len(chosen), "vehicles", ON_GROUND, problem, TO_DO["vehicles"])


def _tried(name: str, limit: str, look: Callable[[], None]) -> Check:
    try:
        look()
    except GcsError as error:
        return Check(name, State.FAIL, limit=limit, problem=str(error), to_do=TO_DO[name])
    return Check(name, State.PASS, limit=limit)
