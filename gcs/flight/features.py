"""The features of a flight. A new one is its class, and its name here."""

from gcs.flight.shows.lights import Lights
from gcs.flight.state.corrections import Corrections
from gcs.flight.state.feature import Feature
from gcs.flight.state.flight import Flight


def features_of(flight: Flight) -> list[Feature]:
    """Those of this flight, in the order in which they send."""
    corrections = Corrections(flight.config.rtk, flight.links, flight.state.time_s)
    return [corrections, flight.outside_clock, Lights(flight)]
