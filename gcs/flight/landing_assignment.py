"""Landing positions of vehicles that cannot, or are not to, return to their starts."""

from collections.abc import Sequence

import numpy as np

from gcs.control import ellipses_of
from gcs.flight.fleet import Fleet
from gcs.flight.vehicle import Vehicle
from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.state import Array, VehicleId
from gcs.planning.landing_sites import distinct_sites_m


def landing_sites_m(flight: Fleet, vehicles: Sequence[Vehicle]) -> dict[VehicleId, Array]:
    """(3,) For each vehicle: a landing position clear of obstacles, all pads, and the other positions."""
    if not vehicles:
        return {}
    desired_m = np.array([flight.position_m(vehicle)[:2] for vehicle in vehicles])
    coming_down = {vehicle.id for vehicle in vehicles}
    taken_m = [
        place_m[:2]
        for vehicle in flight.vehicles.values()
        if vehicle.id not in coming_down
        for place_m in (
            vehicle.home_m,
            flight.last_m(vehicle) if vehicle.phase not in AIRBORNE or vehicle.handed_over else None,
            vehicle.goal_m if vehicle.phase is Phase.LANDING else None,
        )
        if place_m is not None
    ]
    places_m = distinct_sites_m(
        desired_m,
        np.array(taken_m).reshape(-1, 2),
        flight.config.operation.landing_site_spacing_m,
        ellipses_of(flight.plan, flight.control, flight.fleet.time_s),
    )
    ground_z_m = [0.0 if v.home_m is None else float(v.home_m[2]) for v in vehicles]
    return {
        vehicle.id: np.array([place_m[0], place_m[1], z_m])
        for vehicle, place_m, z_m in zip(vehicles, places_m, ground_z_m, strict=True)
    }
