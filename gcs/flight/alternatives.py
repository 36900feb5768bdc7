"""Names, in a refusal, a command that is accepted while a vehicle is airborne."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from gcs.flight.control_refusal import why_never
from gcs.flight.fleet import Fleet
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import NEXT, Event, Phase
from gcs.model.state import VehicleId, Whereabouts
from gcs.service import ShowAction, VehicleAction

SAFER: Final = (
    (VehicleAction.TAKE_CONTROL, Event.TAKE_CONTROL),
    (VehicleAction.HOLD, Event.HOLD),
    (VehicleAction.LAND, Event.DESCEND),
)
"""Commands that shorten a vehicle's flight; the first that its phase allows is named."""

AIRBORNE: Final = frozenset({Whereabouts.CONTROLLED, Whereabouts.UNCONTROLLED})


@contextmanager
def instead(flight: Fleet, vehicle_id: VehicleId | None = None) -> Iterator[None]:
    """Add to a refusal raised inside a safer command that is accepted now; none while nothing is airborne.

    Raises: RefusedError, as raised inside, with that command in its text.
    """
    try:
        yield
    except RefusedError as error:
        named = _accepted(flight, vehicle_id)
        if not named:
            raise
        raise RefusedError(f"{str(error).rstrip('.')}; accepted instead: {named}") from None


def _accepted(flight: Fleet, vehicle_id: VehicleId | None) -> str:
    """Return the command in the syntax of `gcs`; empty when nothing is airborne."""
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
