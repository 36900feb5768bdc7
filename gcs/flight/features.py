"""The features of a flight. A new one is its class, and its name here."""

from gcs.flight.shows.lights import Lights
from gcs.flight.state.corrections import Corrections
from gcs.flight.state.feature import Feature
from gcs.flight.state.flight import Flight


def features_of(flight: Flight) -> list[Feature]:
    """Those of this flight, in the order in which they send."""
    newest, links, config = flight.newest, flight.links, flight.config
    return [
        Corrections(config.rtk, links, newest.state.time_s),
        flight.outside_clock,
        Lights(newest, flight.vehicles, flight.show, links, config, lambda: flight.elsewhere.owned),
    ]
