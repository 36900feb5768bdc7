"""Whose control this station does not take in the air, and why. Pure questions about one vehicle."""

import numpy as np

from gcs.flight import Flight
from gcs.state import Mode
from gcs.vehicle import Vehicle

A_PERSON_FLIES = frozenset({Mode.POSITION, Mode.OTHER})
"""Modes that no autopilot chooses for itself while it has a position: a person is at the sticks."""


def why_never(flight: Flight, vehicle: Vehicle) -> str:
    """Why not even a command that names the vehicle takes control of it; empty when one may.

    Taking control stops whatever its autopilot does: below the critical level of the battery that is landing.
    """
    level = flight.config.reactions.low_battery.critical_below
    telemetry, at = flight.telemetry[vehicle.id]
    battery = float(telemetry.battery_remaining[at])
    if np.isfinite(battery) and battery < level:
        return (
            f"its battery is at {battery:.0%}, below the critical level of {level:.0%}:"
            " leave it to its autopilot, which lands it"
        )
    return ""


def why_not_unasked(flight: Flight, vehicle: Vehicle) -> str:
    """Why a command to all vehicles leaves this one out, which a command that names it may reach."""
    mode = flight.mode(vehicle)
    if mode in A_PERSON_FLIES:
        return f"a pilot flies it, in mode {mode}: take-control {vehicle.id} names it, when the pilot agrees"
    return why_never(flight, vehicle)
