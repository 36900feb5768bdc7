"""Selects shows, and updates the plan from the selected show every tick."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import nan
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.control.area_graphs import prepare_ways
from gcs.flight.shows.show_begin import ShowBegin
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.refusals import Refusals, with_alternative
from gcs.flight.state.running_show import ShowFleet, ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.errors import RefusedError
from gcs.model.interrupted_flight import Written
from gcs.model.lifecycle import ON_THE_GROUND, Phase, ShowPhase
from gcs.model.plan import MAX_OBSTACLES, Obstacle, Plan, Target
from gcs.model.state import VehicleId
from gcs.planning.feasibility import check_obstacle, check_target
from gcs.service import SelectedShow
from gcs.shows import Flaw, Show, ShowClock, Timeline
from gcs.shows.area_checks import count_flaws
from gcs.shows.format import control_of
from gcs.shows.library import ShowLibrary
from gcs.shows.loading import service_flaws
from gcs.shows.placement import standing_on

log = logging.getLogger(__name__)

ON_PAD: Final = 0.25
"""So near to a pad, as a share of their spacing, a vehicle stands on it."""


@dataclass(eq=False)
class ShowPlayer:
    """Selects shows, and has the selected show decide the plan. Implements `gcs.service.Player`."""

    newest: Newest
    in_force: InForce
    show: ShowState
    vehicles: FlightVehicles
    config: Config
    elsewhere: Callable[[], Elsewhere]
    begin: ShowBegin
    refusals: Refusals
    show_library: ShowLibrary

    def __post_init__(self) -> None:
        self.show_library.misfits = self.misfits
        self._reported: Plan = self.in_force.plan  # the plan without a show
        self.waits: tuple[str, ...] = ()  # why obstacles of the show have not appeared yet
        self._held: Target | None = None  # replaces a live target not renewed since `_reported_s`
        self._reported_s = 0.0

    # on the ground

    @with_alternative
    def select(self, name: str, show_hash: str) -> SelectedShow:
        self.show.need_no_countdown()
        self.need_ground("select a show")
        timeline = self.fitting(name, self.show_library.cleared(name, show_hash))
        return self.take(ShowRun(name, timeline, figures=self.show_library.checked(name).figures))

    def find(self, name: str, show_hash: str) -> Timeline:
        """Return a show that was flown before, by its hash, which proves its check. Reads the file.

        Raises: UnknownError; RefusedError when it has changed since, or does not fit this service.
        """
        return self.fitting(name, self.show_library.recorded(name, show_hash))

    def resume(self, written: Written, plan: Plan) -> None:
        """Select an interrupted show, to go on from its time once it is resumed.

        From `plan` it takes the obstacles that are not the show's, and the heading.

        Raises: as `find`.
        """
        timeline = self.find(written.name, written.hash)
        clock = ShowClock(min(max(written.clock_s, 0.0), timeline.duration_s))
        begun, parts = clock.begins_s > 0.0, dict(written.parts)
        show_run = ShowRun(written.name, timeline, clock, started=True, begun=begun, parts=parts)
        own = tuple(box for box in plan.obstacles if box.id not in show_run.obstacle_ids)
        self.in_force.plan = replace(self.in_force.plan, obstacles=own, yaw=plan.yaw)
        self.take(show_run)

    def fitting(self, name: str, timeline: Timeline) -> Timeline:
        """Return the timeline. Raises: RefusedError when it does not fit this service."""
        areas = self.config.control.safety.fence.areas
        _refuse(name, [*self._own_misfits(timeline.show), *count_flaws(timeline, areas)])
        return timeline

    def misfits(self, show: Show) -> list[Flaw]:
        """Every reason to refuse a valid show at this time: limits, fleet, take-off, obstacles."""
        return [*self._own_misfits(show), *self._clashes(show)]

    def _own_misfits(self, show: Show) -> list[Flaw]:
        config, others = self.config, self.elsewhere().shows
        count = len(self.vehicles) + others.count
        return [
            *others.misfits(show),
            *service_flaws(show, config.frame, config.control, config.operation, count),
        ]

    def _clashes(self, show: Show) -> Iterator[Flaw]:
        """Yield the conflicts of the show's obstacles with those of operators."""
        own, its = self._reported_obstacles, {box.id for cue in show.timeline for box in cue.obstacles.appear}
        twice = sorted(its & {box.id for box in own})
        if twice:
            text = f"it has obstacles of its own called {', '.join(twice)}: remove those that stand"
            yield Flaw(("timeline",), text)
        if len(own) + len(its) > MAX_OBSTACLES:
            text = f"{len(own)} obstacles stand, and its {len(its)}: at most {MAX_OBSTACLES} together"
            yield Flaw(("timeline",), text)

    def take(self, show_run: ShowRun) -> SelectedShow:
        """Let the show lead. Raises: RefusedError when its obstacles conflict with those of operators."""
        name = show_run.name
        show, own = show_run.timeline.show, self._reported_obstacles
        _refuse(name, [*self._clashes(show)])
        self.adopt(show_run)
        self.begin.forget("another show is selected")
        self.in_force.plan = replace(self.in_force.plan, obstacles=own)
        self.lead()
        log.info("show_selected", extra={"show": name, "hash": show_run.hash})
        return show_run.view(self.newest.state.time_s)

    def adopt(self, show_run: ShowRun | None) -> None:
        """Have a show, its limits and its fence, or none; the flight that leads decides the plan.

        Raises: RefusedError, as `control_of`: nothing has changed then.
        """
        if show_run is None:
            self.show.run, self.in_force.control = None, self.config.control
            return
        timeline = show_run.timeline
        control = control_of(timeline.show, self.config.control, timeline.areas)
        if self.show.run is None:
            self._reported = self.in_force.plan
        self.show.run, self.in_force.control = show_run, control
        if self.show.phase in ON_THE_GROUND and not self.vehicles.airborne:  # it takes up to seconds
            prepare_ways(self.config.control.safety, control.safety)

    @with_alternative
    def deselect(self) -> None:
        self.show.need_no_countdown()
        self.need_ground("deselect the show")
        if self.show.run is None:
            return
        own, yaw = self._own_obstacles(self.show.run), self.in_force.plan.yaw
        self.show.run, self.in_force.control, self.waits = None, self.config.control, ()
        target = replace(self._reported.target, time_s=self.newest.state.time_s)
        self.in_force.plan = replace(self._reported, target=target, obstacles=own, yaw=yaw)

    @with_alternative
    def seek(self, cue: str) -> SelectedShow:
        self.show.need_no_countdown()
        show_run = self.show.run
        if show_run is None:
            raise RefusedError("no show is selected: seek is for one that is")
        grounded = self.show.phase in ON_THE_GROUND and not self.vehicles.airborne
        show_run.clock = show_run.clock.seek(show_run.timeline, cue, grounded=grounded)
        self.lead()
        return show_run.view(self.newest.state.time_s)

    def begin_at(self, at_unix_time_s: float) -> SelectedShow:
        self.begin.begin_at(at_unix_time_s)
        return self.selected()

    def cancel_begin(self) -> SelectedShow:
        self.begin.cancel()
        return self.selected()

    def follow_external_clock(self, follow: bool) -> None:
        self.begin.follow_external_clock(follow)

    def selected(self) -> SelectedShow:
        """The selected show. Raises: RefusedError without one."""
        if self.show.run is None:
            raise RefusedError("no show is selected")
        return self.show.run.view(self.newest.state.time_s)

    @property
    def outdated(self) -> str:
        """Why the selected show must be selected again, in words; empty: it need not. Reads its file."""
        show_run = self.show.run
        if show_run is None or show_run.received:
            return ""
        return self.show_library.outdated(show_run.name, show_run.hash)

    def check_start(
        self, chosen: Sequence[VehicleId], show_hash: str | None, *, named: bool, taken_out: int = 0
    ) -> None:
        """Check whether `chosen` may start the selected show with the hash and the names of a command.

        `taken_out` is the number of vehicles that an operator excluded. Raises: RefusedError.
        """
        show_run = self.show.run
        if show_run is None:
            if show_hash is not None:
                raise RefusedError("no show is selected: select one, or start without a show's hash")
            return
        if outdated := self.outdated:
            raise RefusedError(outdated)
        if show_hash is None:
            raise RefusedError(
                f"show {show_run.name!r} is selected: start with its hash {show_run.hash}, or deselect it"
            )
        if show_hash != show_run.hash:
            raise RefusedError(
                f"show {show_run.name!r} is selected with the hash {show_run.hash}, not {show_hash[:64]!r}"
            )
        if not show_run.received:
            self.show_library.cleared(show_run.name, show_hash)
        needed, spares = show_run.timeline.show.fleet.vehicles, show_run.spares_most
        count = len(chosen) + self.elsewhere().shows.start_too(named=named)
        if count > needed + spares or (count + taken_out < needed and not named):
            fix = "name the vehicles that fly" + (", to take the others out" if count < needed else "")
            more = f" and {spares} spares" if spares else ""
            text = f"show {show_run.name!r} is for {needed} vehicles{more}, {count} would start: {fix}"
            raise RefusedError(text)

    def give_parts(self, chosen: Sequence[VehicleId]) -> Sequence[VehicleId]:
        """Start the selected show, if there is one. Returns: those that take off; the others are spares."""
        show_run = self.show.run
        if show_run is None:
            return chosen
        others, seen = self.elsewhere().shows, self.seen()
        show_run.started, show_run.parts = True, {}
        if not others.leads:
            return chosen
        flies, count = chosen, show_run.timeline.show.fleet.vehicles
        if show_run.spares_most:
            flies, show_run.spares = chosen[:count], tuple(chosen[count:])
        row_of = {name: row for row, name in enumerate(seen.ids) if np.isfinite(seen.position_m[row]).all()}
        parts = [name for name in others.starting(flies) if name in row_of][:count]
        show_run.assign(parts, seen.position_m[[row_of[name] for name in parts]])
        return flies

    def pads(self) -> dict[VehicleId, int]:
        """Row of each vehicle's pad among those of the selected show.

        The fleet's order decides, unless a drawing leaves it open and most vehicles stand on some pad.
        """
        show_run = self.show.run
        if show_run is None:
            return {}
        show, rows = show_run.timeline.show, self.elsewhere().shows.rows([*self.vehicles])
        in_order = {name: row for name, row in rows.items() if row < len(show.start_places_m)}
        return self._stood_on(show) or in_order

    def _stood_on(self, show: Show) -> dict[VehicleId, int]:
        """Row of the pad on which each vehicle stands; empty: the fleet's order decides."""
        if show.drawing is None or show.drawing.pads != "nearest":
            return {}
        vehicles, pads_m = self.vehicles, show.start_places_m[:, :2]
        rows = [vehicle.row for vehicle in vehicles.values()]
        near_m = ON_PAD * show.fleet.pads.spacing_m
        stands = standing_on(pads_m, self.newest.state.position_m[rows, :2], near_m)
        on = {name: pad for name, pad in zip(vehicles, stands.tolist(), strict=True) if pad >= 0}
        return on if 2 * len(on) > min(len(vehicles), len(pads_m)) else {}

    def plans(self) -> Sequence[tuple[str, Plan]]:
        """Plans to be flown in order, with the names of their cues."""
        show_run = self.show.run
        return [("", self.in_force.plan)] if show_run is None else show_run.timeline.stages()

    def obstacles(self) -> tuple[Obstacle, ...]:
        show_run, plan = self.show.run, self.in_force.plan
        if show_run is None:
            return plan.obstacles
        return (*self._own_obstacles(show_run), *show_run.obstacles)

    def need_ground(self, what: str) -> None:
        if self.show.phase not in ON_THE_GROUND or self.vehicles.airborne:
            raise RefusedError(
                f"cannot {what} while the show is {self.show.phase}: stop it, and wait for landed"
            )
        if why := self.elsewhere().shows.why_busy:
            raise RefusedError(f"cannot {what} {why}")

    # in the air

    def lead(self) -> None:
        """Have the show decide formation, orbit, target and its own obstacles; called once a tick."""
        if self.elsewhere().shows.follow():
            return
        self.begin.look()
        show_run = self.show.run
        if show_run is None:
            return
        seen, now_s = self.seen(), self.newest.state.time_s
        show_run.follow_drawing(seen, now_s, assembling=self.show.phase is ShowPhase.ASSEMBLING)
        desired = show_run.desired(now_s)
        standing = {box.id for box in self.in_force.plan.obstacles}
        own = self._own_obstacles(show_run)
        admitted, waits = [], []
        for box in desired.obstacles:
            why = "" if box.id in standing else self._in_the_way(box)
            if why:
                waits.append(why)
            else:
                admitted.append(box)
        self.waits = tuple(waits)
        self._report_lags(show_run, seen.ids)
        self.in_force.plan = replace(desired, obstacles=(*own, *admitted), yaw=self.in_force.plan.yaw)

    def seen(self) -> ShowFleet:
        """The vehicles among which the show is played, at this tick."""
        formed = np.array([phase is Phase.FORMATION for phase in self.vehicles.phases], dtype=np.bool_)
        own = ShowFleet(self.newest.state.ids, self.newest.state.position_m, formed, len(formed))
        return self.elsewhere().shows.joined(own)

    def _report_lags(self, show_run: ShowRun, vehicle_ids: Sequence[VehicleId]) -> None:
        """Log once, when a show with drawn parts has ended, how well each vehicle followed its trajectory."""
        over = self.show.phase not in {ShowPhase.RUNNING, ShowPhase.PAUSED, ShowPhase.ASSEMBLING}
        if not over or show_run.lags_reported or show_run.errors is None:
            return
        show_run.lags_reported = True
        log.info(
            "show_tracked",
            extra={
                "show": show_run.name,
                "reason": f"off the trajectories, m rms (max): {show_run.lags(vehicle_ids)}",
                "rms_m": round(show_run.errors.fleet_rms_m, 3),
                "max_m": round(float(show_run.errors.max_m.max()), 3),
            },
        )

    def _in_the_way(self, box: Obstacle) -> str:
        """Why an obstacle of the show cannot stand yet: airborne vehicles, also those flown elsewhere."""
        moving = self.elsewhere().airborne_m()
        for vehicle in self.vehicles.airborne:
            moving[vehicle.id] = (
                self.newest.position_m(vehicle),
                self.newest.state.velocity_m_s[vehicle.row],
            )
        try:
            check_obstacle(
                box,
                self.in_force.control.law.avoidance,
                {name: position_m for name, (position_m, _) in moving.items()},
                {},
                velocities_m_s={name: velocity_m_s for name, (_, velocity_m_s) in moving.items()},
                braking=self.in_force.control.safety.braking.of_slowest(self.newest.traits.response),
            )
        except RefusedError as error:
            return f"{error}; it waits"
        return ""

    @property
    def _reported_obstacles(self) -> tuple[Obstacle, ...]:
        show_run = self.show.run
        return self.in_force.plan.obstacles if show_run is None else self._own_obstacles(show_run)

    def _own_obstacles(self, show_run: ShowRun) -> tuple[Obstacle, ...]:
        """Obstacles set by operators that are not the show's."""
        ids = show_run.obstacle_ids
        return tuple(box for box in self.in_force.plan.obstacles if box.id not in ids)

    # changes during a show

    def need_free(self, what: str) -> None:
        show_run = self.show.run
        if show_run is not None:
            raise RefusedError(
                f"show {show_run.name!r} decides the {what}: it can be paused or stopped, and deselected"
                " once all vehicles are down"
            )

    def need_own_obstacle(self, obstacle_id: str) -> None:
        show_run = self.show.run
        if show_run is not None and obstacle_id in show_run.obstacle_ids:
            self.need_free(f"obstacle {obstacle_id}")

    @property
    def reserved(self) -> int:
        """Number of the show's obstacles that have not appeared."""
        show_run = self.show.run
        if show_run is None:
            return 0
        return len(show_run.obstacle_ids - {box.id for box in self.in_force.plan.obstacles})

    @property
    def target_age_s(self) -> float:
        """Age of the newest update of a live cue's target; NaN if none is expected or none was sent."""
        show_run = self.show.run
        if show_run is None or show_run.live is None or not show_run.clock.runs:
            return nan
        if not self.elsewhere().shows.leads:
            return nan
        reported_s = self._reported_s if show_run.live is self._held else show_run.live.time_s
        return self.newest.state.time_s - reported_s

    def hold_target(self) -> None:
        """Hold a live target that is not updated at its present position, until its next update."""
        show_run = self.show.run
        if show_run is None or show_run.live is None or show_run.live is self._held:
            return
        now_s, live = self.newest.state.time_s, show_run.live
        self._reported_s = live.time_s
        self._held = show_run.live = live.held(now_s)

    def set_target(self, target: Target, *, checked: bool = True) -> None:
        """Set a target, without a show or for a live cue. Raises: RefusedError, InvalidError if `checked`."""
        show_run = self.show.run
        if show_run is not None and not show_run.is_live(target.time_s):
            self.need_free(f"target at cue {show_run.cue(target.time_s)!r}")
        if checked:
            check_target(
                target, self.in_force.plan.orbit, self.in_force.plan.formation, self.in_force.control
            )
        if show_run is not None:
            show_run.live = target
        self.in_force.plan = replace(self.in_force.plan, target=target)


def _refuse(name: str, flaws: Sequence[Flaw]) -> None:
    if flaws:
        reported = "; ".join(flaw.text for flaw in flaws)
        raise RefusedError(f"show {name!r} does not fit this service: {reported}")
