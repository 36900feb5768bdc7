"""Colours of the vehicles' own lights: those of the show in the air, those of the battery on the ground."""

from collections.abc import Callable, Sequence

import numpy as np

from gcs.config.schema import Config
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.links.batch_link import Link
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

    def __init__(
        self,
        newest: Newest,
        vehicles: FlightVehicles,
        show: ShowState,
        links: Sequence[Link],
        config: Config,
        owned: Callable[[], Mask],
    ) -> None:
        """Sends to the `owned` vehicles (n,): others may be flown by another station."""
        self._newest, self._vehicles, self._show, self._config = newest, vehicles, show, config
        self._owned = owned
        self._blinks_until_s: dict[VehicleId, float] = {}
        rows = [np.array([vehicles[name].row for name in link.ids], np.intp) for link in links]
        senders = [LightSender(config.lights, link.outbox, link.budget) for link in links]
        self._senders = [*zip(links, senders, rows, strict=True)]

    def find(self, vehicle: Vehicle) -> None:
        name, settings = vehicle.id, self._config.lights
        if settings.driver is LightDriver.NONE:
            raise RefusedError(f"{name} has no lights: lights.driver of the configuration is none")
        if vehicle.phase is not Phase.STANDBY:
            raise RefusedError(f"{name} is {vehicle.phase}: find is for vehicles received on the ground")
        self._blinks_until_s[name] = self._newest.state.time_s + settings.find_s

    def send(self) -> None:
        """Send what is due; once a tick, after its setpoints."""
        if self._config.lights.driver is LightDriver.NONE:
            return
        colour = self.colours()
        ours = self._owned()
        for link, sender, rows in self._senders:
            if (reached := link.reached()) is not None:
                now_s, connected = reached
                sender.send(colour[rows], ours[rows] & connected, now_s)

    def view(self, at: Instant) -> LightsView:  # noqa: ARG002
        sent = sum(sender.sent for _, sender, _ in self._senders)
        dropped = sum(sender.dropped for _, sender, _ in self._senders)
        return LightsView(self._config.lights.driver.value, sent, dropped)

    def colours(self) -> Colours:
        """(n, 3) red, green, blue; rows as in FleetState."""
        now_s = self._newest.state.time_s
        ids, run = tuple(self._vehicles), self._show.run
        colour = np.zeros((len(ids), 3), np.uint8)
        if run is not None:
            shown, lit = run.colours(ids, now_s)
            colour[lit] = shown[lit]
        grounded: Mask = np.array([vehicle.phase in GROUNDED for vehicle in self._vehicles.values()])
        colour[grounded] = OFF
        if self._config.lights.battery:
            of_battery = battery_colours(
                self._newest.telemetry.battery_remaining, self._config.preflight.battery_min
            )
            colour[grounded] = of_battery[grounded]
        for name, until_s in self._blinks_until_s.items():
            row = self._vehicles[name].row
            if grounded[row] and now_s < until_s:
                colour[row] = FOUND if now_s % (2.0 * BLINK_S) < BLINK_S else OFF
        return colour
