"""Spare vehicles: on the ground until they take the places of lost ones in a drawn show."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.flight.fleet import Fleet
from gcs.flight.landing_places import closed_to
from gcs.flight.maneuvers import Maneuvers
from gcs.flight.preflight_gate import PreflightGate
from gcs.flight.vehicle import Vehicle
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import VehicleId
from gcs.service import Outcome

log = logging.getLogger(__name__)

REPLACED: Final = frozenset({Phase.LOST, Phase.KILLED})

CLEAR_SIDEWAYS_M: Final = 6.0
CLEAR_ABOVE_M: Final = 6.0
"""A spare vehicle climbs once no other flies within these distances of its climb."""


@dataclass(eq=False)
class Spares:
    """Has spare vehicles take off when others are lost, while the show runs or assembles."""

    flight: Fleet
    maneuvers: Maneuvers
    preflight_gate: PreflightGate

    def replace_lost(self) -> None:
        """Give the places of lost vehicles to spare ones; called once a tick."""
        flight, show_run = self.flight, self.flight.show_run
        if show_run is None or not show_run.spares:
            return
        if flight.show not in {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}:
            return
        if not show_run.takes_spares(flight.fleet.time_s):
            return
        for lost in [name for name in show_run.parts if flight.vehicles[name].phase in REPLACED]:
            for name in show_run.spares:
                if self._may_climb(flight.vehicles[name]):
                    self._take_off(flight.vehicles[name], lost)
                    break

    def _may_climb(self, vehicle: Vehicle) -> bool:
        """Whether a vehicle stands ready, and the space that it climbs through is free."""
        flight, operation = self.flight, self.flight.config.operation
        here_m = flight.position_m(vehicle)
        if vehicle.phase is not Phase.STANDBY or not np.isfinite(here_m).all():
            return False
        for other in flight.airborne:
            away_m = flight.position_m(other) - here_m
            near = np.hypot(away_m[0], away_m[1]) < CLEAR_SIDEWAYS_M
            if near and -away_m[2] < operation.takeoff_height_m + CLEAR_ABOVE_M:
                return False
        return not bool(closed_to(flight, [vehicle.row], here_m[None])[0])

    def _take_off(self, vehicle: Vehicle, lost: VehicleId) -> None:
        flight, show_run = self.flight, self.flight.show_run
        if show_run is None:
            return
        log.warning("spare_flies", extra={"vehicle": vehicle.id, "other": lost, "show": show_run.name})
        show_run.replace(lost, vehicle.id)
        flight.left_behind.pop(vehicle.id, None)
        vehicle.home_m = flight.position_m(vehicle).copy()
        record = flight.book.open("spare", [vehicle.id], {})
        maneuver = self.maneuvers.take_off(0.0, lambda one: self.preflight_gate.need_alone(one.id))
        self.maneuvers.start(vehicle, maneuver, self._closer(record.id, vehicle.id, lost))

    def _closer(self, record: str, name: VehicleId, lost: VehicleId) -> Callable[[Outcome, str], None]:
        """Return a function that closes its take-off; one that fails leaves its place to the next spare."""
        flight = self.flight

        def ended(outcome: Outcome, reason: str) -> None:
            if outcome is Outcome.FAILED:
                flight.left_behind[name] = reason
                if flight.show_run is not None:
                    flight.show_run.give_back(name, lost)
            flight.book.close(record, name, outcome, reason)

        return ended
