"""The accepted command that a refusal names while anything is airborne."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from gcs.flight.control_refusal import why_never
from gcs.flight.fleet import Fleet
from gcs.model.errors import RefusedError
from gcs.model.fleet_counts import Whereabouts
from gcs.model.lifecycle import NEXT, Event, Phase
from gcs.model.state import VehicleId
from gcs.service import ShowAction, VehicleAction

SAFER: Final = (
    (VehicleAction.TAKE_CONTROL, Event.TAKE_CONTROL),
    (VehicleAction.HOLD, Event.HOLD),
    (VehicleAction.LAND, Event.DESCEND),
)
"""Commands to one vehicle that only make less of its flight; the first that its phase allows is named."""

AIRBORNE: Final = frozenset({Whereabouts.CONTROLLED, Whereabouts.UNCONTROLLED})


@contextmanager
def instead(flight: Fleet, vehicle_id: VehicleId | None = None) -> Iterator[None]:
    """A refusal in here names a safer command that is accepted now; with nothing airborne it needs none.

    Raises: RefusedError, as raised inside, with that command in its text.
    """
    try:
        yield
    except RefusedError as error:
        named = _accepted(flight, vehicle_id)
        if not named:
            raise
        raise RefusedError(f"{error}; accepted instead: {named}") from None


def _accepted(flight: Fleet, vehicle_id: VehicleId | None) -> str:
    """The command, as `gcs` takes it; empty when nothing is airborne."""
    vehicles = flight.vehicles
    if not any(flight.whereabouts(vehicle) in AIRBORNE for vehicle in vehicles.values()):
        return ""
    vehicle = None if vehicle_id is None else vehicles.get(vehicle_id)
    if vehicle is not None and vehicle.phase not in {Phase.LOST, Phase.STANDBY} and not vehicle.handed_over:
        for action, event in SAFER:
            never = action is VehicleAction.TAKE_CONTROL and why_never(flight, vehicle)
            if (vehicle.phase, event) in NEXT and not never:
                return f"{action} {vehicle.id}"
    return ShowAction.STOP.value
