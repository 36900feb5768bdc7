"""The parameters that each autopilot must have, by its name in a configuration."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, TypeAlias

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings
from gcs.links.autopilots.ardupilot import ArduPilot
from gcs.links.autopilots.px4 import Px4
from gcs.preflight.autopilots import ardupilot, px4
from gcs.preflight.requirement import Equipment, Requirement

Requirements: TypeAlias = Callable[
    [OperationSettings, ControlSettings, float, int, Equipment], tuple[Requirement, ...]
]

REQUIREMENTS: Final[Mapping[str, Requirements]] = MappingProxyType(
    {Px4.name: px4.requirements, ArduPilot.name: ardupilot.requirements}
)
"""For settings, the height at which the vehicle returns by itself, the system id of its station, and
what it has beyond flying.
"""
