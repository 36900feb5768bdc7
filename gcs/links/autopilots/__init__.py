"""What is known of each autopilot, one profile each; nothing else asks which autopilot a vehicle has.

Pure: the transports send what a profile says. Decision 0049.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gcs.links.autopilots.ardupilot import ArduPilot
from gcs.links.autopilots.profile import Autopilot, CommandLong, SetParameter, Step
from gcs.links.autopilots.px4 import Px4

DEFAULT: Final[Autopilot] = Px4()

AUTOPILOTS: Final[Mapping[str, Autopilot]] = MappingProxyType(
    {each.name: each for each in (DEFAULT, ArduPilot())}
)
"""By the name in a configuration."""


def title_of(number: int) -> str:
    """The name of the autopilot with this MAV_AUTOPILOT, for texts."""
    titles = {each.number: each.title for each in AUTOPILOTS.values()}
    return titles.get(number, f"an autopilot of MAV_AUTOPILOT {number}")


__all__ = ["AUTOPILOTS", "DEFAULT", "Autopilot", "CommandLong", "SetParameter", "Step", "title_of"]
