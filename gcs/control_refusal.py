"""Which airborne vehicles this station does not take control of, and why. Pure functions of one vehicle."""

from gcs.failsafe_cause import control_refusal
from gcs.flight import Flight
from gcs.state import Mode
from gcs.vehicle import Vehicle

A_PERSON_FLIES = frozenset({Mode.POSITION, Mode.OTHER})
"""Modes that no autopilot chooses for itself while it has a position: a person is at the sticks."""


def why_never(flight: Flight, vehicle: Vehicle) -> str:
    """Why not even a command that names the vehicle takes control of it; empty when one may."""
    return control_refusal(vehicle.id, flight.facts(vehicle))


def why_not_unasked(flight: Flight, vehicle: Vehicle) -> str:
    """Why a command to all vehicles leaves this one out, which a command that names it may reach."""
    facts = flight.facts(vehicle)
    if facts.mode in A_PERSON_FLIES and not facts.in_failsafe:
        agreed = f"take-control {vehicle.id} names it, when the pilot agrees"
        return f"a pilot flies it, in mode {facts.mode}: {agreed}"
    return why_never(flight, vehicle)
