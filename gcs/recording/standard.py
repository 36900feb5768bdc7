"""What a flight is judged by: the limits that held, when they held."""

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
    """The limits that held at one time."""

    frame: ShowFrame
    safety: SafetySettings
    acceleration_max_m_s2: float

    @classmethod
    def of(cls, config: Mapping[str, Any], source: str) -> "Standard":
        """From a recorded configuration. Raises: GcsError naming `source` and what is wrong."""
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
        """The same under recorded limits, such as a written show's. Raises: GcsError when they are none."""
        if not limits:
            return self  # an older file: the configuration's held, as far as is known
        try:
            return replace(
                self,
                safety=SafetySettings.model_validate(limits["safety"]),
                acceleration_max_m_s2=float(limits["acceleration_max_m_s2"]),
            )
        except (KeyError, TypeError, ValueError, ValidationError) as error:
            raise GcsError(f"the limits that were recorded are none: {error}") from None


def limits_of(control: ControlSettings) -> dict[str, Any]:
    """As they are recorded; JSON."""
    return {
        "safety": control.safety.model_dump(mode="json"),
        "acceleration_max_m_s2": control.acceleration_max_m_s2,
    }
