"""Alarm of vehicles that land and get no lower: something keeps them up, or their autopilot does not obey."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.flight.state.newest import Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Array
from gcs.service.alarms import AlarmCause, Condition

NOT_LOWER_S: Final = 20.0
"""The slowest descent, of a vehicle that may meet the ground, is 8 m in this time."""

HEADWAY_M: Final = 0.5
"""Lower, or nearer to its place, by so much a vehicle gets on: positions wander by decimetres."""

ANEW_M: Final = 2.0
"""A place that is farther from the one before is another one: the way there begins anew."""


@dataclass(eq=False)
class LandingAlarms:
    """Of one flight, on the event loop only."""

    newest: Newest
    vehicles: FlightVehicles
    may_descend: Callable[[Vehicle], bool]  # else it waits for lower ones, of which the alarm is

    def __post_init__(self) -> None:
        n = len(self.vehicles)
        self._least_m, self._since_s = np.full(n, np.inf), np.full(n, np.inf)
        self._place_m = np.full((n, 2), np.nan)

    def conditions(self) -> Iterator[Condition]:
        """Yield vehicles in LANDING that have got neither lower nor nearer to their places for long."""
        landing, now_s = self.vehicles.in_phase(Phase.LANDING), self.newest.state.time_s
        rows = [vehicle.row for vehicle in landing]
        others = np.ones(len(self.vehicles), np.bool_)
        others[rows] = False
        self._least_m[others] = np.inf
        for row, vehicle in zip(rows, landing, strict=True):
            here_m = self.newest.state.position_m[row]
            left_m = self._left_m(vehicle, here_m)
            waits = not vehicle.flags.handed_over and not self.may_descend(vehicle)
            if waits or left_m < self._least_m[row] - HEADWAY_M:
                self._least_m[row], self._since_s[row] = left_m, now_s
            stands_s = now_s - self._since_s[row]
            if stands_s >= NOT_LOWER_S and np.isfinite(left_m):
                because = f"{-here_m[2]:.0f} m high, and no lower for {stands_s:.0f} s"
                yield Condition(AlarmCause.NOT_LOWER, because, (vehicle.id,))

    def _left_m(self, vehicle: Vehicle, here_m: Array) -> float:
        """What is left of its way down, and sideways while this station leads it; NaN: not known."""
        row = vehicle.row
        if vehicle.goal_m is None or vehicle.flags.handed_over:
            self._place_m[row] = np.nan
            return float(-here_m[2])
        if not np.linalg.norm(vehicle.goal_m[:2] - self._place_m[row]) <= ANEW_M:
            self._place_m[row], self._least_m[row] = vehicle.goal_m[:2], np.inf
        return float(np.linalg.norm(here_m[:2] - self._place_m[row]) - here_m[2])
