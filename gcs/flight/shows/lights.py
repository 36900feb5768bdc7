"""Colours of the vehicles' own lights: those of the show in the air, those of the battery on the ground."""

import numpy as np

from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.flight import Flight
from gcs.flight.state.vehicle import Vehicle
from gcs.links.lights import Colours, LightSender
from gcs.mavlink.lights import LightDriver
from gcs.model.errors import RefusedError
from gcs.model.lifecycle import GROUNDED, Phase
from gcs.model.state import Array, Mask, VehicleId
from gcs.service.features import LightsView

OFF = (0, 0, 0)
FULL, MEDIUM, LOW, UNKNOWN = (0, 96, 0), (96, 48, 0), (128, 0, 0), (0, 0, 48)
"""Dim, because crews stand beside them."""

FOUND = (255, 255, 255)
BLINK_S = 0.5
"""Time on, and time off."""

MEDIUM_ABOVE_MIN = 0.25
"""A battery is FULL with so much more than the least that a start needs."""


def battery_colours(remaining: Array, battery_min: float) -> Colours:
    """(n, 3) colours of batteries: (n,) remaining, 0 to 1 and NaN for unknown."""
    colour = np.full((len(remaining), 3), LOW, np.uint8)
    colour[remaining >= battery_min] = MEDIUM
    colour[remaining >= battery_min + MEDIUM_ABOVE_MIN] = FULL
    colour[np.isnan(remaining)] = UNKNOWN
    return colour


class Lights(Feature):
    """Decides the colours of one fleet, and sends them over its links."""

    name = "lights"

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._blinks_until_s: dict[VehicleId, float] = {}
        row_of = {name: vehicle.row for name, vehicle in flight.vehicles.items()}
        rows = [np.array([row_of[name] for name in link.ids], np.intp) for link in flight.links]
        senders = [LightSender(flight.config.lights, link.outbox, link.budget) for link in flight.links]
        self._senders = [*zip(flight.links, senders, rows, strict=True)]

    def find(self, vehicle: Vehicle) -> None:
        flight, name = self._flight, vehicle.id
        if flight.config.lights.driver is LightDriver.NONE:
            raise RefusedError(f"{name} has no lights: lights.driver of the configuration is none")
        if vehicle.phase is not Phase.STANDBY:
            raise RefusedError(f"{name} is {vehicle.phase}: find is for vehicles received on the ground")
        self._blinks_until_s[name] = flight.state.time_s + flight.config.lights.find_s

    def send(self) -> None:
        """Send what is due; once a tick, after its setpoints."""
        flight = self._flight
        if flight.config.lights.driver is LightDriver.NONE:
            return
        colour = self.colours()
        ours = flight.elsewhere.owned
        for link, sender, rows in self._senders:
            if (reached := link.reached()) is not None:
                now_s, connected = reached
                sender.send(colour[rows], ours[rows] & connected, now_s)

    def view(self, at: Instant) -> LightsView:  # noqa: ARG002
        sent = sum(sender.sent for _, sender, _ in self._senders)
        dropped = sum(sender.dropped for _, sender, _ in self._senders)
        return LightsView(self._flight.config.lights.driver.value, sent, dropped)

    def colours(self) -> Colours:
        """(n, 3) red, green, blue; rows as in FleetState."""
        flight, now_s = self._flight, self._flight.state.time_s
        ids, run = tuple(flight.vehicles), flight.show_run
        colour = np.zeros((len(ids), 3), np.uint8)
        if run is not None:
            shown, lit = run.colours(ids, now_s)
            colour[lit] = shown[lit]
        grounded: Mask = np.array([vehicle.phase in GROUNDED for vehicle in flight.vehicles.values()])
        colour[grounded] = OFF
        if flight.config.lights.battery:
            known = battery_colours(flight.telemetry.battery_remaining, flight.config.preflight.battery_min)
            colour[grounded] = known[grounded]
        for name, until_s in self._blinks_until_s.items():
            row = flight.vehicles[name].row
            if grounded[row] and now_s < until_s:
                colour[row] = FOUND if now_s % (2.0 * BLINK_S) < BLINK_S else OFF
        return colour
