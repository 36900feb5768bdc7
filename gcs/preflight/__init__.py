"""Before take-off: who may fly, and why not. Pure."""

from gcs.preflight.facts import Facts
from gcs.preflight.together import Pattern, Stand, room_to_wander, spacing, standing
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M, own_checks

__all__ = [
    "PAD_HEIGHT_MAX_M",
    "Facts",
    "Pattern",
    "Stand",
    "own_checks",
    "room_to_wander",
    "spacing",
    "standing",
]
