"""Alarms of vehicles that could fall beyond the lines of the controlled ground if their motors stopped."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.vehicle import FlightVehicles
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.state import Array, Mask
from gcs.safety.controlled_ground import ground_margins
from gcs.safety.impact import in_wind
from gcs.service.alarms import AlarmCause, Condition, Limit, beyond

IN_THE_AIR: Final = AIRBORNE | {Phase.PILOT}

BACK_M: Final = 0.3
"""So much farther inside a line a contact ends."""

LED_INWARD: Final = "The safety filter leads [it|them] inward."


@dataclass(eq=False)
class GroundAlarms:
    """Of one flight, on the event loop only."""

    newest: Newest
    in_force: InForce
    vehicles: FlightVehicles

    def __post_init__(self) -> None:
        self._near = self._beyond = np.zeros(len(self.vehicles), np.bool_)

    def conditions(self) -> Iterator[Condition]:
        """Yield vehicles in the air whose impact may be inside the hard line, or beyond the edge."""
        safety = self.in_force.control.safety
        ground = safety.fence.controlled_ground
        if ground is None:
            return
        fleet = self.newest.state
        impact = in_wind(safety.impact, self.newest.wind_m_s)
        margin_m = ground_margins(fleet.position_m, fleet.velocity_m_s, ground, impact).margin_m
        flies = np.array([vehicle.phase in IN_THE_AIR for vehicle in self.vehicles.rows], np.bool_)
        margin_m = np.where(flies, margin_m, np.nan)
        hard_m = safety.impact.hard_m
        self._near = beyond(self._near, margin_m, Limit(on=hard_m, off=hard_m + BACK_M))
        self._beyond = beyond(self._beyond, margin_m, Limit(on=0.0, off=BACK_M))
        yield from self._of(margin_m, self._beyond, self._near & ~self._beyond, hard_m)

    def _of(self, margin_m: Array, beyond_edge: Mask, near: Mask, hard_m: float) -> Iterator[Condition]:
        for row in np.flatnonzero(beyond_edge).tolist():
            because = f"if [its|their] motors stopped now, up to {-margin_m[row]:.1f} m beyond the edge"
            yield Condition(AlarmCause.GROUND_LEFT, because, (self._id(row),), LED_INWARD)
        for row in np.flatnonzero(near).tolist():
            because = f"it could fall {margin_m[row]:.1f} m from the edge, {hard_m:g} m are kept"
            yield Condition(AlarmCause.GROUND_NEAR, because, (self._id(row),), LED_INWARD)

    def _id(self, row: int) -> str:
        return self.vehicles.rows[row].id
