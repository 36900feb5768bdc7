"""The flight envelope (geofence and minimum separation) for display."""

from gcs.safety.filter import SafetySettings
from gcs.service import FlightEnvelope


def flight_envelope(safety: SafetySettings) -> FlightEnvelope:
    """Return geofence and minimum separation of the safety settings."""
    fence, floor = safety.fence, safety.floor
    return FlightEnvelope(
        fence.height_min_m,
        fence.height_max_m,
        fence.distance_max_m,
        floor.horizontal_m,
        floor.vertical_m,
        floor.margin_m,
    )
