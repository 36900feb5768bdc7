"""Executes fleet-wide commands, of operators and of failsafes."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Final

from gcs.flight.commands.plan_editor import RestoredPlan
from gcs.flight.commands.recovery import FlightRecovery
from gcs.flight.commands.spares import Spares
from gcs.flight.commands.stall_recovery import AwaitedVehicles, StallRecovery
from gcs.flight.commands.start import Starting
from gcs.flight.commands.start_outlook import StartOutlook
from gcs.flight.commands.vehicle_commands import VehicleCommands
from gcs.flight.maneuvers.collective_return import CollectiveReturn
from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.maneuvers import Done, Maneuvers
from gcs.flight.preflight.go import CrewGo
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.flight.shows.show_player import ShowPlayer
from gcs.flight.state.flight import Flight
from gcs.flight.state.refusals import Refusals, with_alternative
from gcs.flight.state.vehicle import Vehicle
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.interrupted_flight import Interruption, Offer
from gcs.model.lifecycle import ON_THE_GROUND, Event, Phase, ShowEvent, ShowPhase, advance_show
from gcs.model.plan import Formation
from gcs.model.state import Array, VehicleId
from gcs.service import CommandRecord, Outcome, ShowAction

DOWN: Final = {ShowEvent.STOP: "all vehicles return home", ShowEvent.ABORT: "all vehicles come down"}
"""What a command that ends the show does, in words."""

STOPS_WITHIN_S = 0.8
"""On pause, each vehicle's goal is the position that its velocity reaches in this time."""


class Commander(VehicleCommands):
    """Turns fleet-wide commands into maneuvers. Implements `gcs.service.Commands`."""

    def __init__(
        self,
        flight: Flight,
        refusals: Refusals,
        places: LandingPlaces,
        maneuvers: Maneuvers,
        show_player: ShowPlayer,
        preflight_gate: PreflightGate,
        planning: Executor,
        plans: RestoredPlan,
        go: CrewGo,
        interruption: Interruption | None = None,
    ) -> None:
        """`planning` runs the planner of the collective return, outside the tick.

        `interruption` is a flight that was interrupted before this service began.
        """
        super().__init__(flight, refusals, places, maneuvers)
        self._planning = planning
        self._commanded: ShowEvent | None = None  # newest command to all, if vehicles may be awaited
        self.collective_return: CollectiveReturn | None = None  # the newest
        newest, vehicles, show, book = flight.newest, flight.vehicles, flight.show, flight.book
        self.starting = Starting(
            newest,
            vehicles,
            show,
            book,
            flight.unix_s,
            asyncio.get_running_loop().time,
            flight.config.operation.takeoff_stagger_s,
            maneuvers,
            preflight_gate,
            show_player,
            flight.start_hashes,
            go,
        )
        self.outlook = StartOutlook(
            newest,
            vehicles,
            show,
            self.starting,
            preflight_gate,
            lambda: flight.elsewhere,
            lambda: go.missing,
        )
        self.spares = Spares(newest, vehicles, show, book, places, maneuvers, preflight_gate)
        frame, space = flight.config.show_frame, flight.uncontrolled
        self.recovery = FlightRecovery(
            newest,
            vehicles,
            show,
            book,
            flight.inputs,
            refusals,
            maneuvers,
            plans,
            StallRecovery(newest, vehicles, show, frame, space, flight.unix_s, flight.inputs),
            AwaitedVehicles(newest, maneuvers, asyncio.get_running_loop().time),
            interruption,
            self._bring_home,
        )

    def close(self) -> None:
        """Stop planning returns that no vehicle will fly."""
        if self.collective_return is not None:
            self.collective_return.give_up()

    @property
    def home_left_s(self) -> float | None:
        """Planned time until the last collective return is over, in s; None: there is none."""
        return None if self.collective_return is None else self.collective_return.left_s

    @property
    def return_problem(self) -> str:
        """Why the vehicles return without a common plan; empty where no planner has failed."""
        if self.collective_return is None or self.flight.show.phase is not ShowPhase.RETURNING:
            return ""
        return self.collective_return.problem

    # automatically

    def execute_show_failsafe(self, action: ShowAction, reason: str) -> CommandRecord:
        """Pause, stop or abort automatically, all flights; vehicles that already come down continue.

        Takes no control of vehicles outside it: that needs an operator's command.
        """
        own = self.execute_own_failsafe(action, reason)
        return self.flight.elsewhere.hooks.spread(own, action, reason)

    def execute_own_failsafe(self, action: ShowAction, reason: str) -> CommandRecord:
        """The same with the vehicles of this flight only."""
        if action is ShowAction.PAUSE:
            return self._pause(reason, reclaim=False)
        spared = self.flight.vehicles.in_phase(Phase.LANDING)
        return self._bring_down(ShowEvent(action.value), reason, spared, reclaim=False)

    def note_re_formed(self) -> CommandRecord:
        """Record that the remaining vehicles close a gap; nothing is sent."""
        return self._done("re-form", self._not_ours())

    def note_descended(self, formation: Formation) -> CommandRecord:
        """Record that the formation flies on lower, or why the station that leads it does not."""
        why = self.flight.elsewhere.hooks.lower(formation)
        formed = [vehicle.id for vehicle in self.flight.vehicles.in_phase(Phase.FORMATION)]
        return (
            self.flight.book.open("descend", [], dict.fromkeys(formed, why)) if why else self._done("descend")
        )

    def note_target_held(self) -> CommandRecord:
        """Record that the target is held: the vehicles follow a target at rest."""
        return self._done("hold-target")

    # commands

    @with_alternative
    def command_show(
        self,
        action: ShowAction,
        vehicles: Sequence[VehicleId] | None = None,
        *,
        show_hash: str | None = None,
        at_unix_time_s: float | None = None,
    ) -> CommandRecord:
        if action is ShowAction.START:
            return self.starting.begin(vehicles, show_hash, at_unix_time_s)
        given = {"vehicles": vehicles, "show_hash": show_hash, "at_unix_time_s": at_unix_time_s}
        for field, value in given.items():
            if value is not None:
                raise InvalidError(field, value, "only with start")
        if action is ShowAction.PAUSE:
            return self._pause()
        if action is ShowAction.RESUME:
            return self._resume()
        if self.starting.can_call_off and self.flight.show.phase in ON_THE_GROUND:
            return self.starting.call_off(action)
        return self._bring_down(ShowEvent(action.value))

    @with_alternative
    def confirm_start(self, go_hash: str) -> CommandRecord:
        """Make the start that another token proposed. Raises: RefusedError."""
        return self.starting.confirm(go_hash)

    def _reclaimed(self, *, reclaim: bool) -> list[Vehicle]:
        """Airborne vehicles outside control that a command reaches, and first takes control of.

        Args:
            reclaim: whether vehicles count whose mode a stall or a restart explains; otherwise only those
                that are being taken over already.
        """
        flight = self.flight
        reclaimable = self.recovery.reclaim() if reclaim else []
        return [
            vehicle
            for vehicle in flight.vehicles.in_phase(Phase.PILOT)
            if vehicle in reclaimable
            or (self.maneuvers.running(vehicle) and not self.refusals.why_never(vehicle))
        ]

    def _bring_down(
        self,
        event: ShowEvent,
        reason: str = "",
        spared: Sequence[Vehicle] = (),
        *,
        reclaim: bool = True,
        action: str = "",
    ) -> CommandRecord:
        """STOP returns all vehicles except `spared`; those on the ground stay there.

        ABORT lands them through the safety filter, lowest first, on distinct places.
        """
        flight, maneuvers, reason = self.flight, self.maneuvers, reason or DOWN[event]
        back = self._reclaimed(reclaim=reclaim)
        flying = [*(v for v in flight.vehicles.airborne if v not in spared), *back]
        waiting, later = maneuvers.waiting, self._expected(reclaim=reclaim)
        self._lead(event, reason, [*flying, *waiting])
        left_out = self._not_ours([*back, *later])
        left_out |= {v.id: f"comes down already: {v.reason}" for v in spared}
        ids = [v.id for v in (*flying, *waiting, *later)]
        record = flight.book.open(action or event.value, ids, left_out)
        if event is ShowEvent.STOP:
            together = self._plan_return([*flying, *later])
            sites_m = self.places.sites_m([v for v in flying if v.home_m is None])
        else:
            together = None
            sites_m = self.places.sites_m([v for v in flying if not v.comes_down_alone])

        def begin(vehicle: Vehicle, sites_m: Mapping[VehicleId, Array]) -> None:
            if together is not None and vehicle.home_m is not None:
                maneuver = maneuvers.landings.come_home_together(together, self._stops_m(vehicle))
            elif together is None and vehicle.comes_down_alone:
                maneuver = maneuvers.autopilot_land
            else:
                maneuver = maneuvers.landings.descend(sites_m[vehicle.id])
            maneuvers.start(vehicle, maneuvers.take_control_first(maneuver), self._closer(record, vehicle))

        def reached(vehicle: Vehicle) -> None:
            if flight.show.phase is ShowPhase.UNCONTROLLED:  # possibly no vehicle was reached before
                flight.show.move(event, reason)
            begin(vehicle, self.places.sites_m([vehicle]))

        for vehicle in flying:
            begin(vehicle, sites_m)
        self._expect(record, later, reached, event, reclaim=reclaim)
        self._keep_down(record, waiting)
        return record

    def _plan_return(self, vehicles: Sequence[Vehicle]) -> CollectiveReturn:
        """Plan one return of these; one that has sent nothing yet takes part if it does before the plan."""
        self.close()
        flight = self.flight
        together = [v for v in vehicles if v.home_m is not None and not v.comes_down_alone]
        self.collective_return = CollectiveReturn(
            flight.newest,
            flight.in_force,
            flight.vehicles,
            flight.show,
            self.places,
            flight.elsewhere.returns,
            flight.slow_from_m,
            together,
            self._planning,
        )
        return self.collective_return

    def _keep_down(self, record: CommandRecord, waiting: Sequence[Vehicle]) -> None:
        for vehicle in waiting:
            done = self.flight.book.closer(record, vehicle.id)
            self.maneuvers.start(vehicle, self.maneuvers.stay_down, done)

    def _expected(self, *, reclaim: bool) -> list[Vehicle]:
        """Vehicles of an interrupted flight that have sent nothing yet: a command to all includes them."""
        return self.recovery.unreceived if reclaim else []

    def _expect(
        self,
        record: CommandRecord,
        later: Sequence[Vehicle],
        reached: Callable[[Vehicle], None],
        event: ShowEvent,
        *,
        reclaim: bool,
    ) -> None:
        """Await these vehicles for a command; its outcome names those that send nothing in time.

        If the service repeats an operator's command, the operator's command still counts.
        """
        if not reclaim and event is self._commanded:
            return
        self._commanded = event

        def missed(vehicle: Vehicle, outcome: Outcome, reason: str) -> None:
            self.flight.book.close(record.id, vehicle.id, outcome, reason)

        self.recovery.awaited.expect(later, reached, missed, reaches_fallen=reclaim)

    def _closer(self, record: CommandRecord, vehicle: Vehicle) -> Done:
        """Return a function that closes the vehicle's part, except if a stall has only delayed it."""

        def done(outcome: Outcome, reason: str) -> None:
            if outcome is not Outcome.FAILED or not self.recovery.reaches_again(vehicle):
                self.flight.book.close(record.id, vehicle.id, outcome, reason)

        return done

    def _lead(self, event: ShowEvent, reason: str, reached: Sequence[Vehicle]) -> None:
        """Move the show's phase for a command; one that reaches no vehicle is accepted and changes nothing.

        Raises: RefusedError if nothing is airborne and the phase does not allow it.
        """
        flight = self.flight
        if flight.show.phase is ShowPhase.UNCONTROLLED and not reached:
            return
        flight.show.move(event, reason)

    def _bring_home(self, reason: str) -> CommandRecord:
        """Take control of the interrupted flight's vehicles, and return them together with the others."""
        return self._bring_down(ShowEvent.STOP, reason, action=Offer.BRING_HOME.value)

    def _not_ours(self, reclaimed: Sequence[Vehicle] = ()) -> dict[VehicleId, str]:
        """Vehicles that no fleet-wide command reaches, with the reasons."""
        left_out = {}
        for vehicle in self.flight.vehicles.in_phase(Phase.LOST, Phase.PILOT, Phase.KILLED):
            if vehicle not in reclaimed:
                why = f"{vehicle.phase}: {vehicle.reason.removesuffix('.')}"
                if vehicle.phase is Phase.PILOT:
                    why_not = self.recovery.why_not(vehicle)
                    why += f"; {why_not or f'take-control {vehicle.id} names it, when its pilot agrees'}"
                left_out[vehicle.id] = why
        return left_out

    def _pause(self, reason: str = "all vehicles hold in place", *, reclaim: bool = True) -> CommandRecord:
        """Stop all vehicles in place, also those that return or land, except those touching down."""
        flight, maneuvers = self.flight, self.maneuvers
        advance_show(flight.show.phase, ShowEvent.PAUSE)
        taking_over = self.recovery.taking_over  # the take-over ends paused: the pause closes with it
        back = [vehicle for vehicle in self._reclaimed(reclaim=reclaim) if vehicle not in taking_over]
        waiting = self.maneuvers.waiting
        later = [vehicle for vehicle in self._expected(reclaim=reclaim) if vehicle not in taking_over]
        self._stop_on_the_way()
        self._lead(ShowEvent.PAUSE, reason, flight.vehicles.airborne)
        stopped = flight.vehicles.in_phase(Phase.FORMATION)
        others = flight.vehicles.in_phase(Phase.TAKEOFF, Phase.HOLD, Phase.LANDING)
        left_out = self._not_ours(back) | {v.id: f"{v.phase}: {v.reason}" for v in others}
        reached_ids = [v.id for v in (*stopped, *taking_over, *back, *waiting, *later)]
        left_out = {name: why for name, why in left_out.items() if name not in reached_ids}
        record = self.flight.book.open("pause", reached_ids, left_out)
        for vehicle in stopped:
            self.flight.book.close(record.id, vehicle.id, Outcome.DONE)

        def reached(vehicle: Vehicle) -> None:
            comes_back = vehicle.flags.rejoins and maneuvers.running(
                vehicle
            )  # it goes on, and holds in OFFBOARD
            maneuver = maneuvers.take_control_first(maneuvers.join) if comes_back else maneuvers.take_control
            maneuvers.start(vehicle, maneuver, self.flight.book.closer(record, vehicle.id))

        for vehicle in back:
            reached(vehicle)
        if taking_over:
            self.recovery.go_along(record)
        else:
            self._expect(record, later, reached, ShowEvent.PAUSE, reclaim=reclaim)
        self._keep_down(record, waiting)
        return self.flight.book.get(record.id)

    def _stop_on_the_way(self) -> None:
        """Stop the vehicles in formation and those that return or land, except those touching down."""
        flight, maneuvers = self.flight, self.maneuvers
        if flight.show.phase in {ShowPhase.RETURNING, ShowPhase.ABORTING}:
            for vehicle in flight.vehicles.in_phase(Phase.HOLD):  # about to return or land
                maneuvers.stop(vehicle, "paused by another command")
        for vehicle in flight.vehicles.in_phase(Phase.RETURN, Phase.LANDING):
            if not vehicle.flags.handed_over:
                maneuvers.stop(vehicle, "paused by another command")
                vehicle.apply(Event.PAUSE, "paused on its way, holds in place")
        for vehicle in flight.vehicles.in_phase(Phase.FORMATION):
            vehicle.hold_m = self._stops_m(vehicle)

    def _stops_m(self, vehicle: Vehicle) -> Array:
        """(3,) Position at which the vehicle can soon be at rest, show frame."""
        place_m: Array = (
            self.flight.newest.position_m(vehicle)
            + self.flight.newest.state.velocity_m_s[vehicle.row] * STOPS_WITHIN_S
        )
        return place_m

    def _resume(self) -> CommandRecord:
        show_run = self.flight.show.run
        if show_run is not None and not show_run.started:
            raise RefusedError(f"show {show_run.name!r} was never started: stop brings home all vehicles")
        flight = self.flight
        advance_show(flight.show.phase, ShowEvent.RESUME)
        joining = self.recovery.taking_over or any(
            vehicle.flags.entering_offboard for vehicle in flight.vehicles.airborne
        )
        if not joining and not flight.vehicles.in_phase(Phase.FORMATION):
            raise RefusedError("no vehicle is in formation: use take-over where it is offered, or join")
        flight.show.move(ShowEvent.RESUME, "re-forms, then goes on")
        self._commanded = ShowEvent.RESUME
        self.recovery.awaited.replace()
        return self._done("resume")

    def _done(self, action: str, left_out: Mapping[VehicleId, str] | None = None) -> CommandRecord:
        """Record a command that the next tick executes for the whole formation."""
        formed = [vehicle.id for vehicle in self.flight.vehicles.in_phase(Phase.FORMATION)]
        return self.flight.book.done(action, formed, left_out or {})
