"""Executes commands to single vehicles and groups, and chooses where they land."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.maneuver_steps import Maneuver
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.state.flight import Flight
from gcs.flight.state.refusals import Refusals, with_alternative
from gcs.flight.state.vehicle import Vehicle, require_phase
from gcs.links import Command, Verb
from gcs.model.errors import CommandError, InvalidError, RefusedError
from gcs.model.lifecycle import FLOWN, GROUNDED, IN_THE_AIR, NEXT, Event, Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.planning.feasibility import check_formation
from gcs.service import CommandRecord, VehicleAction

log = logging.getLogger(__name__)

EVENT_OF = {
    VehicleAction.HOLD: Event.HOLD,
    VehicleAction.JOIN: Event.ENGAGE,
    VehicleAction.RETURN: Event.COME_HOME,
    VehicleAction.LAND: Event.DESCEND,
    VehicleAction.TAKE_CONTROL: Event.TAKE_CONTROL,
    VehicleAction.CONFIRM_DOWN: Event.CONFIRMED_DOWN,
}


@dataclass(eq=False)
class VehicleCommands:
    """Turns commands to vehicles into maneuvers; the base of `Commander`."""

    flight: Flight
    refusals: Refusals
    places: LandingPlaces
    maneuvers: Maneuvers

    def command_vehicle(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        vehicle = self.flight.vehicles.named(vehicle_id)
        with self.refusals.instead(vehicle_id):
            return self._command(vehicle, action)

    def _command(self, vehicle: Vehicle, action: VehicleAction) -> CommandRecord:
        if action is VehicleAction.FIND:
            for feature in self.flight.features:
                feature.find(vehicle)
            return self.flight.book.done(action, [vehicle.id])
        self._require(vehicle, action)
        if action is VehicleAction.CONFIRM_DOWN:
            vehicle.apply(Event.CONFIRMED_DOWN, "an operator has seen it on the ground")
            self.flight.uncontrolled.forget_seen(vehicle)
            return self.flight.book.done(action, [vehicle.id])
        return self._command_each([vehicle], action, {})

    def _require(self, vehicle: Vehicle, action: VehicleAction) -> None:
        """Check that the vehicle accepts the command now. Raises: RefusedError naming the vehicle."""
        name, show = vehicle.id, self.flight.show.phase
        if not (action is VehicleAction.HOLD and vehicle.phase is Phase.HOLD):
            require_phase(vehicle, EVENT_OF[action])
        if action is VehicleAction.HOLD and vehicle.flags.pilot_in_control:
            raise RefusedError(
                f"{name} was taken over before its telemetry stopped: take-control once it is received again"
            )
        if action is VehicleAction.JOIN and show not in IN_THE_AIR - {ShowPhase.RETURNING}:
            raise RefusedError(f"{name} has no formation to join: the show is {show}")
        if action is VehicleAction.RETURN and vehicle.home_m is None:
            raise RefusedError(f"{name} cannot return: where it started is not known; use land")
        if action is VehicleAction.RETURN and vehicle.flags.handed_over:
            raise RefusedError(f"{name} cannot return: its autopilot touches it down already")
        if action is VehicleAction.TAKE_CONTROL and (why := self.refusals.why_never(vehicle)):
            raise RefusedError(f"control of {name} is not taken: {why}")

    @with_alternative
    def command_vehicles(
        self, action: VehicleAction, vehicles: Sequence[VehicleId] | None = None
    ) -> CommandRecord:
        if action in {VehicleAction.CONFIRM_DOWN, VehicleAction.FIND}:
            raise InvalidError("action", action.value, "hold, join, return, land or take-control")
        if vehicles is None:
            meant = [v for v in self.flight.vehicles.values() if v.phase not in GROUNDED]
        else:
            meant = [self.flight.vehicles.named(name) for name in dict.fromkeys(vehicles)]
        chosen, left_out = self._reached(action, meant, named=vehicles is not None)
        if not chosen:
            reasons = "; ".join(left_out.values()) or "no vehicle is airborne"
            raise RefusedError(f"{action} reaches no vehicle: {reasons}")
        return self._command_each(chosen, action, left_out)

    def _command_each(
        self, chosen: Sequence[Vehicle], action: VehicleAction, left_out: Mapping[VehicleId, str]
    ) -> CommandRecord:
        if action is VehicleAction.JOIN:
            self.check_room(chosen)
        if action not in {VehicleAction.JOIN, VehicleAction.TAKE_CONTROL}:
            return self.command_some(chosen, action, left_out)
        maneuver = self.maneuvers.join if action is VehicleAction.JOIN else self.maneuvers.take_control
        record = self.flight.book.open(action, [vehicle.id for vehicle in chosen], left_out)
        for vehicle in chosen:
            self.maneuvers.start(vehicle, maneuver, self.flight.book.closer(record, vehicle.id))
        return record

    def _reached(
        self, action: VehicleAction, meant: Sequence[Vehicle], *, named: bool
    ) -> tuple[list[Vehicle], dict[VehicleId, str]]:
        chosen: list[Vehicle] = []
        left_out: dict[VehicleId, str] = {}
        for vehicle in meant:
            try:
                self._require(vehicle, action)
            except RefusedError as error:
                left_out[vehicle.id] = str(error)
                continue
            why = ""
            if not named and action is VehicleAction.TAKE_CONTROL:
                why = self.refusals.why_not_unnamed(vehicle)
            elif not named and vehicle.phase is Phase.LOST:
                why = f"{vehicle.id} is lost: {vehicle.reason}"
            if why:
                left_out[vehicle.id] = why
            else:
                chosen.append(vehicle)
        return chosen, left_out

    def command_some(
        self,
        vehicles: Sequence[Vehicle],
        action: VehicleAction,
        left_out: Mapping[VehicleId, str] = MappingProxyType({}),
    ) -> CommandRecord:
        """Give one command to several vehicles that accept it: hold, return or land, each to its own site."""
        landing = [v for v in vehicles if action is VehicleAction.LAND or v.home_m is None]
        places_m = {} if action is VehicleAction.HOLD else self.places.sites_m(landing)
        record = self.flight.book.open(action, [vehicle.id for vehicle in vehicles], left_out)
        for vehicle in vehicles:
            maneuver: Maneuver = self.maneuvers.hold
            if vehicle.comes_down_alone and action is not VehicleAction.HOLD:
                maneuver = self.maneuvers.autopilot_land
            elif action is VehicleAction.RETURN and vehicle.home_m is not None:
                maneuver = self.maneuvers.landings.come_home
            elif action is not VehicleAction.HOLD:
                maneuver = self.maneuvers.landings.descend(places_m[vehicle.id])
            self.maneuvers.start(vehicle, maneuver, self.flight.book.closer(record, vehicle.id))
        return record

    def check_room(self, joining: Sequence[Vehicle]) -> None:
        """Check that the sphere has room for these as well. Raises: RefusedError."""
        flight = self.flight
        if flight.show.run is not None and flight.show.run.goals is not None:
            return  # a drawing leads: it has a place for each of its vehicles
        others = [other for other in flight.vehicles.airborne if other not in joining]
        formed = [
            other for other in others if other.flags.entering_offboard or other.phase is Phase.FORMATION
        ]
        uncertainty_m = flight.in_formation_m([*formed, *joining])
        try:
            check_formation(
                flight.in_force.plan.formation,
                len(uncertainty_m),
                flight.in_force.control.safety,
                uncertainty_m,
            )
        except InvalidError as error:
            named = ", ".join(vehicle.id for vehicle in joining)
            raise RefusedError(f"{named} cannot join: {error}") from None

    @with_alternative
    def kill(self, vehicle_ids: Sequence[VehicleId]) -> CommandRecord:
        """Stop motors. The phases change at once: nothing else is sent from then on."""
        named = [self.flight.vehicles.named(name) for name in dict.fromkeys(vehicle_ids)]
        left_out = {v.id: f"offline: {v.reason}" for v in named if (v.phase, Event.KILL) not in NEXT}
        chosen = [vehicle for vehicle in named if vehicle.id not in left_out]
        if not chosen:
            reported = "; ".join(f"{name} is {why}" for name, why in left_out.items())
            raise RefusedError(f"there is no vehicle to kill: {reported or 'no vehicle is named'}")
        record = self.flight.book.open("kill", [vehicle.id for vehicle in chosen], left_out)
        for vehicle in chosen:
            flown = vehicle.phase in FLOWN
            vehicle.apply(Event.KILL, "motors stopped on command")
            log.warning("kill", extra={"vehicle": vehicle.id, "was_flown": flown})
            self.maneuvers.start(vehicle, self._stop_motors, self.flight.book.closer(record, vehicle.id))
        return record

    async def _stop_motors(self, vehicle: Vehicle) -> None:
        try:
            await self.flight.execute(Command(vehicle.id, Verb.KILL))
        except CommandError as error:
            raise RefusedError(f"the kill was sent, but not seen to work: {error}") from None
