"""Where vehicles of a flight land: near where they are, at home, or beside a pad that is closed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import sqrt

import numpy as np

from gcs.config.sections import OperationSettings
from gcs.control import ellipses_until
from gcs.flight.state.elsewhere import Elsewhere, Returning
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.formation.obstacles import Ellipse
from gcs.model.lifecycle import AIRBORNE, GROUNDED, Phase
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.landing_sites import LANDS_WITHIN_S, are_covered, distinct_sites_m
from gcs.planning.return_paths.closed_ways import are_occupied, closed_places
from gcs.planning.return_paths.planner import return_places_m
from gcs.safety.controlled_ground import ground_for_sites
from gcs.safety.target_clearance import kept_clear_m


@dataclass(frozen=True, eq=False)
class LandingPlaces:
    """Chooses landing places for the vehicles of one flight."""

    newest: Newest
    in_force: InForce
    vehicles: FlightVehicles
    operation: OperationSettings
    last_m: Callable[[Vehicle], Array | None]  # where a vehicle was seen last
    closed: Callable[[], tuple[Array, Array]]  # paths that lost vehicles may take
    elsewhere: Callable[[], Elsewhere]
    once: Callable[[str, Callable[[], Array]], Array]  # what is computed once a tick

    def _ellipses(self, ahead_s: float = 0.0) -> dict[str, Ellipse]:
        """Obstacles, slow traffic and the space round targets, for so long: no place lies in these."""
        plan, time_s = self.in_force.plan, self.newest.state.time_s
        floor, worst_m = self.in_force.control.safety.floor, self.newest.traits.uncertainty_m.max(initial=0.0)
        targets = [*self.newest.kept_clear.values(), plan.target]
        boxes = [] if self.newest.near_traffic is None else list(self.newest.near_traffic.boxes)
        for number, target in enumerate(each for each in targets if each.clearance_m):
            (beside_m,), (above_m,) = kept_clear_m(target, floor, np.array([worst_m])).tolist()
            half_m, height_m = beside_m / sqrt(2.0), max(above_m + target.height_m, 1.0)
            x_m, y_m = target.position_m(time_s)
            boxes.append(Obstacle(f"target {number}", x_m, y_m, half_m, half_m, height_m, time_s=time_s))
        return ellipses_until(plan, self.in_force.control, time_s, time_s + ahead_s, tuple(boxes))

    def sites_m(self, vehicles: Sequence[Vehicle]) -> dict[VehicleId, Array]:
        """(3,) For each vehicle: a landing position clear of obstacles, all pads, and the other positions."""
        if not vehicles:
            return {}
        desired_m = np.array([self.newest.position_m(vehicle)[:2] for vehicle in vehicles])
        spacing_m = self.operation.landing_site_spacing_m
        ellipses = self._ellipses(LANDS_WITHIN_S)
        taken_m = self._taken_m(vehicles, frozenset({Phase.LANDING}))
        safety = self.in_force.control.safety
        rows = [vehicle.row for vehicle in vehicles]
        highest_m = float(np.nanmax(-self.newest.state.position_m[rows, 2], initial=0.0))
        ground = ground_for_sites(safety.fence.controlled_ground, safety.impact, highest_m)
        places_m = distinct_sites_m(desired_m, taken_m, spacing_m, ellipses, safety.fence.areas, ground)
        ground_z_m = [0.0 if v.home_m is None else float(v.home_m[2]) for v in vehicles]
        sites_m = np.column_stack([places_m, ground_z_m])
        return {vehicle.id: site_m for vehicle, site_m in zip(vehicles, sites_m, strict=True)}

    def homes_m(self, vehicles: Sequence[Vehicle]) -> Array:
        """(n, 3) Where returning vehicles land: their pads, or the nearest clear of lost ones and obstacles.

        Every vehicle has a `home_m`. Where pads are closed this takes up to tens of milliseconds for each.
        """
        return self.homes_of(vehicles)()

    def homes_of(
        self, vehicles: Sequence[Vehicle], elsewhere: Returning | None = None
    ) -> Callable[[], Array]:
        """Return a function that computes `homes_m` for the flight as it is now; any thread may call it.

        Those flown elsewhere follow the own.
        """
        rows = [vehicle.row for vehicle in vehicles]
        home_m = np.array([vehicle.home_m for vehicle in vehicles]).reshape(-1, 3)
        returning = elsewhere or Returning.none()
        taken_m = self._taken_m(vehicles, frozenset({Phase.LANDING, Phase.RETURN}), returning)
        home_m = np.concatenate([home_m, returning.home_m])
        own_m = np.concatenate([self.newest.traits.uncertainty_m[rows], returning.uncertainty_m])
        operation = self.operation
        return partial(
            return_places_m,
            home_m,
            taken_m,
            operation.takeoff_height_m,
            operation.landing_site_spacing_m,
            self.in_force.control,
            self._ellipses(),
            own_m,
            self.closed(),
            stands_m=self._beside_pads_m(),
        )

    def closed_to(self, rows: Sequence[int], place_m: Array) -> Mask:
        """(n,) At which landing places (n, 3) of these own vehicles a lost one or an obstacle is by now."""
        uncertainty_m, floor = (
            self.newest.traits.uncertainty_m[list(rows)],
            self.in_force.control.safety.floor,
        )
        over_m = self.operation.takeoff_height_m
        closed = closed_places(place_m, over_m, floor, uncertainty_m, self.closed())
        return closed | are_covered(place_m, self._ellipses())

    @property
    def are_obstructed(self) -> bool:
        """Whether an obstacle, traffic, or a target that is kept clear of could be where vehicles land."""
        return bool(self._ellipses())

    def is_covered(self, place_m: Array) -> bool:
        """Whether an obstacle keeps a vehicle from landing at a place (3,)."""
        if not self.are_obstructed:
            return False
        return bool(are_covered(place_m[None], self._ellipses())[0])

    def is_taken(self, vehicle: Vehicle, place_m: Array) -> bool:
        """Whether a vehicle flown elsewhere stands or lands at a place (3,) that is not the vehicle's pad.

        Flights that choose places at the same time do not know each other's choice.
        """
        if vehicle.home_m is not None and (place_m == vehicle.home_m).all():
            return False
        away_m = np.linalg.norm(self.elsewhere().landing_m() - place_m[:2], axis=1)
        return bool((away_m < self.operation.landing_site_spacing_m / 2.0).any())

    def is_occupied(self, place_m: Array) -> bool:
        """Whether a vehicle that came down beside its pad stands on the ground at a place (3,)."""
        spacing_m = self.operation.landing_site_spacing_m
        return bool(are_occupied(place_m[None], self._beside_pads_m(), spacing_m)[0])

    def _beside_pads_m(self) -> Array:
        return self.once("beside pads", self._beside_pads_now_m)

    def _beside_pads_now_m(self) -> Array:
        """(j, 2) where vehicles on the ground stand, of those more than half the spacing off their pads."""
        least_m, stands_m = self.operation.landing_site_spacing_m / 2.0, []
        for vehicle in self.vehicles.in_phase(*GROUNDED):
            stand_m, home_m = self.last_m(vehicle), vehicle.home_m
            if stand_m is not None and home_m is not None and np.hypot(*(stand_m - home_m)[:2]) > least_m:
                stands_m.append(stand_m[:2])
        return np.concatenate([np.array(stands_m).reshape(-1, 2), self.elsewhere().beside_pads_m(least_m)])

    def _taken_m(
        self,
        vehicles: Sequence[Vehicle],
        goals_of: frozenset[Phase],
        elsewhere: Returning | None = None,
    ) -> Array:
        """(m, 2) Pads and positions on the ground of all other vehicles, some goals as well."""
        chosen = {vehicle.id for vehicle in vehicles}
        besides = elsewhere or Returning.none()
        taken_m = [
            place_m[:2]
            for vehicle in self.vehicles.values()
            if vehicle.id not in chosen
            for place_m in (
                vehicle.home_m,
                self.last_m(vehicle) if vehicle.phase not in AIRBORNE or vehicle.flags.handed_over else None,
                vehicle.goal_m if vehicle.phase in goals_of else None,
                vehicle.lands_at_m,
            )
            if place_m is not None
        ]
        return np.concatenate([np.array(taken_m).reshape(-1, 2), self.elsewhere().taken_m(besides)])
