"""The phase `uncontrolled`: how many vehicles are airborne outside this station's control, and why."""

from collections.abc import Collection
from typing import Final

from gcs.flight.fleet import Fleet
from gcs.flight.vehicle import Vehicle
from gcs.model.lifecycle import ANYTHING_FLIES, ON_THE_GROUND, Phase, ShowEvent, ShowPhase
from gcs.model.preflight_report import joined
from gcs.model.state import Whereabouts

NAMED: Final = 6
"""Up to this many vehicles are named; of more, only the number is given."""


def uncontrolled(flight: Fleet) -> list[Vehicle]:
    """Airborne vehicles under the control of a pilot or of their own autopilot."""
    vehicles = flight.in_phase(Phase.PILOT, Phase.KILLED)
    return [one for one in vehicles if flight.whereabouts(one) is Whereabouts.UNCONTROLLED]


def reason(vehicles: Collection[Vehicle]) -> str:
    """Return how many of these are airborne and why outside control, grouped by reason."""
    by_reason: dict[str, list[str]] = {}
    for vehicle in vehicles:
        by_reason.setdefault(vehicle.reason, []).append(vehicle.id)
    count = f"{len(vehicles)} {'vehicle' if len(vehicles) == 1 else 'vehicles'} airborne"
    if len(by_reason) == 1:
        (only,) = by_reason
        return f"{count}, not under this station's control: {only}"
    parts = [f"{_named(ids)}: {why.removesuffix('.')}" for why, ids in by_reason.items()]
    return f"{count}, not under this station's control: {'; '.join(parts)}"


def _named(ids: list[str]) -> str:
    return joined(ids) if len(ids) <= NAMED else f"{len(ids)} vehicles"


def follow(flight: Fleet, *, busy: bool) -> None:
    """Move the show's phase to match what is airborne; called once a tick.

    Args:
        flight: changed.
        busy: whether a vehicle is under control, or takes off or lands.
    """
    if flight.airborne:
        if flight.show in ON_THE_GROUND | {ShowPhase.UNCONTROLLED} and flight.show is not ShowPhase.COUNTDOWN:
            names = joined([vehicle.id for vehicle in flight.airborne])
            flight.move_show(ShowEvent.TAKEN_ON, f"under control, waiting for commands: {names}")
        return
    if busy or flight.show in {ShowPhase.PREFLIGHT, ShowPhase.COUNTDOWN}:
        return
    others = uncontrolled(flight)
    if others:
        why = reason(others)
        if flight.show is not ShowPhase.UNCONTROLLED:
            flight.move_show(ShowEvent.CONTROL_LOST, why)
        flight.reason = why
    elif flight.show in ANYTHING_FLIES and flight.show is not ShowPhase.ARMING:
        _land(flight)


def _land(flight: Fleet) -> None:
    """End the phase with nothing airborne: lost and killed vehicles are named, and no longer count."""
    unknown = [one.id for one in flight.vehicles.values() if flight.whereabouts(one) is Whereabouts.UNKNOWN]
    named = f"; not confirmed on the ground: {joined(unknown)}" if unknown else ""
    if flight.show is ShowPhase.UNCONTROLLED and flight.show_before is ShowPhase.IDLE:
        flight.move_show(ShowEvent.NEVER_FLEW, f"nothing is airborne any more{named}")
    else:
        flight.move_show(ShowEvent.ALL_DOWN, f"all vehicles have landed{named}")
