"""Spare vehicles: on the ground until they take the places of lost ones in a drawn show.

`replacements` and `climb_is_free` decide, for flights and for rehearsals.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.flight.maneuvers.landing_places import LandingPlaces
from gcs.flight.maneuvers.maneuvers import Maneuvers
from gcs.flight.preflight.preflight_gate import PreflightGate
from gcs.flight.state.newest import Newest
from gcs.flight.state.running_show import ShowRun
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, VehicleId
from gcs.service import Outcome
from gcs.service.commands import CommandLog

log = logging.getLogger(__name__)

REPLACED: Final = frozenset({Phase.LOST, Phase.KILLED})

CLEAR_SIDEWAYS_M: Final = 6.0
CLEAR_ABOVE_M: Final = 6.0
"""A spare vehicle climbs once no other flies within these distances of its climb."""


def replacements(
    show_run: ShowRun, now_s: float, lost: Sequence[VehicleId], may_climb: Callable[[VehicleId], bool]
) -> Iterator[tuple[VehicleId, VehicleId]]:
    """Give the parts of lost vehicles to spare ones, while the show lets it.

    Args:
        show_run: the show; its parts and spares change.
        now_s: the tick's time.
        lost: vehicles that are lost or killed, whether they had a part or not.
        may_climb: whether a spare is ready, and the space that it climbs through is free.

    Yields: the vehicle that had the part, and the spare that takes off for it.
    """
    if not show_run.spares or not show_run.takes_spares(now_s):
        return
    for gone in [name for name in lost if name in show_run.parts]:
        spare = next(filter(may_climb, show_run.spares), None)
        if spare is not None:
            show_run.replace(gone, spare)
            yield gone, spare


def climb_is_free(here_m: Array, airborne_m: Array, takeoff_height_m: float) -> bool:
    """Whether none of the vehicles in the air at (n, 3), NaN: not known, is near a climb from (3,)."""
    away_m = airborne_m - here_m
    near = np.hypot(away_m[:, 0], away_m[:, 1]) < CLEAR_SIDEWAYS_M
    return not bool((near & (-away_m[:, 2] < takeoff_height_m + CLEAR_ABOVE_M)).any())


@dataclass(eq=False)
class Spares:
    """Has spare vehicles take off when others are lost, while the show runs or assembles."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    book: CommandLog
    places: LandingPlaces
    maneuvers: Maneuvers
    preflight_gate: PreflightGate

    def replace_lost(self) -> None:
        """Give the places of lost vehicles to spare ones; called once a tick."""
        show_run = self.show.run
        if show_run is None or not show_run.spares:
            return
        if self.show.phase not in {ShowPhase.ASSEMBLING, ShowPhase.RUNNING}:
            return
        lost = [name for name, vehicle in self.vehicles.items() if vehicle.phase in REPLACED]
        for gone, spare in replacements(show_run, self.newest.state.time_s, lost, self._may_climb):
            self._take_off(self.vehicles[spare], gone, show_run.name)

    def _may_climb(self, name: VehicleId) -> bool:
        """Whether a vehicle stands ready, and the space that it climbs through is free."""
        vehicle = self.vehicles[name]
        here_m = self.newest.position_m(vehicle)
        if vehicle.phase is not Phase.STANDBY or not np.isfinite(here_m).all():
            return False
        airborne_m = np.array([self.newest.position_m(other) for other in self.vehicles.airborne]).reshape(
            -1, 3
        )
        free = climb_is_free(here_m, airborne_m, self.places.operation.takeoff_height_m)
        return free and not bool(self.places.closed_to([vehicle.row], here_m[None])[0])

    def _take_off(self, vehicle: Vehicle, lost: VehicleId, show: str) -> None:
        log.warning("spare_flies", extra={"vehicle": vehicle.id, "other": lost, "show": show})
        self.show.left_behind.pop(vehicle.id, None)
        vehicle.home_m = self.newest.position_m(vehicle).copy()
        record = self.book.open("spare", [vehicle.id], {})
        maneuver = self.maneuvers.take_off(0.0, lambda waiting: self.preflight_gate.need_alone(waiting.id))
        self.maneuvers.start(vehicle, maneuver, self._closer(record.id, vehicle.id, lost))

    def _closer(self, record: str, name: VehicleId, lost: VehicleId) -> Callable[[Outcome, str], None]:
        """Return a function that closes its take-off; one that fails leaves its place to the next spare."""

        def ended(outcome: Outcome, reason: str) -> None:
            if outcome is Outcome.FAILED:
                self.show.left_behind[name] = reason
                if self.show.run is not None:
                    self.show.run.give_back(name, lost)
            self.book.close(record, name, outcome, reason)

        return ended
