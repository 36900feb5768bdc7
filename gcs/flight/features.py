"""The features of a flight. A new one is its class, and its name here."""

from gcs.flight.shows.lights import Lights
from gcs.flight.state.corrections import Corrections
from gcs.flight.state.feature import Feature
from gcs.flight.state.flight import Flight
from gcs.flight.state.targets import Targets


def features_of(flight: Flight, targets: Targets) -> list[Feature]:
    """Those of this flight, in the order in which they send."""
    newest, links, config = flight.newest, flight.links, flight.config
    return [
        Corrections(config.rtk, links, newest.state.time_s),
        flight.outside_clock,
        targets,
        Lights(newest, flight.vehicles, flight.show, links, config, lambda: flight.elsewhere.owned),
    ]
