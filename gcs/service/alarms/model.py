"""Alarms as shown to operators and clients, and the conditions that cause them."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs.model.state import VehicleId
from gcs.service.alarms.causes import AlarmCause, AlarmSeverity


class OverallSeverity(StrEnum):
    """The most severe of the alarms whose cause lasts."""

    EMERGENCY = "emergency"
    WARNING = "warning"
    CAUTION = "caution"
    INFORMATION = "information"
    NORMAL = "normal"  # no such alarm


RANK: Final = {severity: rank for rank, severity in enumerate(AlarmSeverity)}
"""Rank of each severity; 0 is the most severe."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition that holds at this instant, as its source reports it."""

    cause: AlarmCause
    because: str  # in words, without a full stop: "no telemetry for 2.0 s"
    vehicles: tuple[VehicleId, ...] = ()
    consequence: str = ""  # what follows automatically, a sentence or more
    consequence_many: str = ""  # for several vehicles; empty: the same
    advice: str = ""  # what an operator can do; empty: as in `CAUSES`
    advice_many: str = ""  # for several vehicles; empty: the same
    severity: AlarmSeverity | None = None  # None: as in `CAUSES`
    about: str = ""  # name of the link, file or obstacle: each has its own alarm
    command_id: str | None = None  # of the command that the service gave because of it


@dataclass(frozen=True, slots=True)
class Alarm:
    """One cause, with all vehicles that it concerns."""

    id: str
    severity: AlarmSeverity
    cause: AlarmCause
    text: str  # the cause, then its consequence
    advice: str
    vehicles: tuple[VehicleId, ...]
    since_unix_s: float  # when the cause began
    raised_unix_s: float  # when it began, last concerned a further vehicle, or became more severe
    command_id: str | None = None
    acknowledged_by: str | None = None
    acknowledged_unix_s: float | None = None
    ended_unix_s: float | None = None  # the cause has ended, and the alarm is not acknowledged

    @property
    def lasts(self) -> bool:
        """Whether its cause still holds."""
        return self.ended_unix_s is None


def ordered(alarms: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """Sort by lasting before ended, then most severe first, then newest first."""
    return tuple(
        sorted(alarms, key=lambda alarm: (not alarm.lasts, RANK[alarm.severity], -alarm.raised_unix_s))
    )


def overall(alarms: Iterable[Alarm]) -> OverallSeverity:
    """Return the overall severity; alarms whose cause has ended do not count."""
    worst = min((RANK[alarm.severity] for alarm in alarms if alarm.lasts), default=None)
    return OverallSeverity.NORMAL if worst is None else OverallSeverity(list(AlarmSeverity)[worst])
