"""Checks before take-off and the PX4 parameters they require; pure, imports config and what lies below."""

from gcs.preflight.fleet import Pattern, Stand, room_to_wander, spacing, standing
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M, PreflightInputs, own_checks

__all__ = [
    "PAD_HEIGHT_MAX_M",
    "Pattern",
    "PreflightInputs",
    "Stand",
    "own_checks",
    "room_to_wander",
    "spacing",
    "standing",
]
