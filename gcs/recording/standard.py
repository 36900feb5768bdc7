"""The limits that a flight is judged by, and when they applied."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from gcs.control import ControlSettings
from gcs.model.errors import GcsError
from gcs.model.frames import ShowFrame
from gcs.safety.filter import SafetySettings


@dataclass(frozen=True, slots=True)
class Standard:
    """The limits that applied at one time."""

    frame: ShowFrame
    safety: SafetySettings
    acceleration_max_m_s2: float

    @classmethod
    def of(cls, config: Mapping[str, Any], source: str) -> "Standard":
        """Read a recorded configuration. Raises: GcsError naming `source` and what is wrong."""
        try:
            control = config["control"]
            return cls(
                ShowFrame(**config["show_frame"]),
                SafetySettings.model_validate(control["safety"]),
                float(control["acceleration_max_m_s2"]),
            )
        except (KeyError, TypeError, ValueError, ValidationError, GcsError) as error:
            raise GcsError(f"{source}: its configuration does not say what holds: {error}") from None

    def under(self, limits: Mapping[str, Any] | None) -> "Standard":
        """Return these under recorded limits, such as a written show's. Raises: GcsError if invalid."""
        if not limits:
            return self  # an older file: as far as known, the configuration's applied
        try:
            return replace(
                self,
                safety=SafetySettings.model_validate(limits["safety"]),
                acceleration_max_m_s2=float(limits["acceleration_max_m_s2"]),
            )
        except (KeyError, TypeError, ValueError, ValidationError) as error:
            raise GcsError(f"the limits that were recorded are none: {error}") from None


def limits_of(control: ControlSettings) -> dict[str, Any]:
    """Return the limits as JSON, as they are recorded."""
    return {
        "safety": control.safety.model_dump(mode="json"),
        "acceleration_max_m_s2": control.acceleration_max_m_s2,
    }
