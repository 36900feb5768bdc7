"""The features of a flight. A new one is its class, and its name here."""

from collections.abc import Callable

from gcs.flight.shows.lights import Lights
from gcs.flight.state.corrections import Corrections
from gcs.flight.state.feature import Feature
from gcs.flight.state.flight import Flight
from gcs.flight.state.targets import Targets
from gcs.flight.state.traffic import OtherTraffic


def features_of(flight: Flight, targets: Targets, unix_minus_loop_s: Callable[[], float]) -> list[Feature]:
    """Those of this flight, in the order in which they send."""
    newest, links, config = flight.newest, flight.links, flight.config
    return [
        Corrections(config.rtk, links, newest.state.time_s),
        flight.outside_clock,
        targets,
        OtherTraffic(
            config.traffic,
            config.frame,
            newest,
            frozenset(vehicle.system_id for vehicle in flight.vehicles.values()),
            unix_minus_loop_s,
            config.failsafes.manned_aircraft.action,
        ),
        Lights(newest, flight.vehicles, flight.show, links, config, lambda: flight.elsewhere.owned),
    ]
