"""Numbers of vehicles that are controlled, uncontrolled, unknown, on the ground and offline. Pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs.model.lifecycle import AIRBORNE, Phase
from gcs.model.state import Landed

KILLED_RECEIVED_S: Final = 3.0
"""Age from which the landed state of a killed vehicle does not count; heartbeats come once a second."""


class Whereabouts(StrEnum):
    """Where one vehicle is, as far as known; each vehicle is in exactly one of these."""

    __hash__ = str.__hash__

    CONTROLLED = "controlled"  # airborne, under this station's control
    UNCONTROLLED = "uncontrolled"  # airborne, under a pilot's or its own autopilot's control
    UNKNOWN = "unknown"  # lost in flight or killed, and not confirmed on the ground
    ON_GROUND = "on ground"
    OFFLINE = "offline"


@dataclass(frozen=True, slots=True)
class Counts:
    """Number of vehicles in each `Whereabouts`; the five add up to the fleet."""

    controlled: int
    uncontrolled: int
    unknown: int
    on_ground: int
    offline: int

    @property
    def airborne(self) -> int:
        """In the air, controlled or not."""
        return self.controlled + self.uncontrolled


def whereabouts(phase: Phase, landed: Landed, *, armed: bool, heartbeat_age_s: float) -> Whereabouts:
    """Where a vehicle is, from its phase and from what its autopilot reports.

    A vehicle that is armed on its pad stands on the ground whatever its phase is. A lost vehicle is unknown.
    A killed vehicle is unknown until it reports that it is on the ground. If it still reports running motors,
    the kill has not worked, and it flies.
    """
    if phase is Phase.OFFLINE:
        return Whereabouts.OFFLINE
    if phase is Phase.LOST:
        return Whereabouts.UNKNOWN
    if phase is Phase.STANDBY:
        return Whereabouts.ON_GROUND
    if phase is Phase.KILLED:
        if not heartbeat_age_s <= KILLED_RECEIVED_S:
            return Whereabouts.UNKNOWN
        if landed is Landed.ON_GROUND:
            return Whereabouts.ON_GROUND
        return Whereabouts.UNCONTROLLED if armed else Whereabouts.UNKNOWN
    if landed is Landed.ON_GROUND:
        return Whereabouts.ON_GROUND
    return Whereabouts.CONTROLLED if phase in AIRBORNE else Whereabouts.UNCONTROLLED


def counts_of(
    phases: Sequence[Phase],
    landed: Sequence[Landed],
    armed: Sequence[bool],
    heartbeat_age_s: Iterable[float],
) -> Counts:
    """Count a fleet; each argument has one entry for every vehicle."""
    found = [
        whereabouts(phase, down, armed=is_armed, heartbeat_age_s=age_s)
        for phase, down, is_armed, age_s in zip(phases, landed, armed, heartbeat_age_s, strict=True)
    ]
    return Counts(
        controlled=found.count(Whereabouts.CONTROLLED),
        uncontrolled=found.count(Whereabouts.UNCONTROLLED),
        unknown=found.count(Whereabouts.UNKNOWN),
        on_ground=found.count(Whereabouts.ON_GROUND),
        offline=found.count(Whereabouts.OFFLINE),
    )
