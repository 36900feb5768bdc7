"""Alarms as people and programs see them, and the conditions that they are made of."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from gcs.model.state import VehicleId
from gcs.service.alarms.causes import AlarmCause, AlarmSeverity


class OverallSeverity(StrEnum):
    """State of the whole: the worst of the alarms whose cause lasts."""

    EMERGENCY = "emergency"
    WARNING = "warning"
    CAUTION = "caution"
    INFORMATION = "information"
    NORMAL = "normal"  # there is none


RANK: Final = {severity: rank for rank, severity in enumerate(AlarmSeverity)}
"""0 for the most severe."""


@dataclass(frozen=True, slots=True)
class Condition:
    """Something that holds at this instant, as a source sees it."""

    cause: AlarmCause
    because: str  # in words, without a full stop: "no telemetry for 2.0 s"
    vehicles: tuple[VehicleId, ...] = ()
    consequence: str = ""  # what follows by itself, a sentence or more
    consequence_many: str = ""  # where the alarm concerns several vehicles; empty: the same
    advice: str = ""  # what an operator can do; empty: as `CAUSES` has it
    advice_many: str = ""  # where the alarm concerns several vehicles; empty: the same
    severity: AlarmSeverity | None = None  # None: as `CAUSES` has it
    about: str = ""  # which link, file or obstacle: each has an alarm of its own
    command_id: str | None = None  # of the command that the service gave because of it


@dataclass(frozen=True, slots=True)
class Alarm:
    """One cause, with all vehicles that it concerns."""

    id: str
    severity: AlarmSeverity
    cause: AlarmCause
    text: str  # the cause first, its consequence after
    advice: str
    vehicles: tuple[VehicleId, ...]
    since_unix_s: float  # when the cause began
    raised_unix_s: float  # when it began, or last concerned a further vehicle or became more severe
    command_id: str | None = None
    acknowledged_by: str | None = None
    acknowledged_unix_s: float | None = None
    ended_unix_s: float | None = None  # the cause has ended, and nobody has acknowledged the alarm

    @property
    def lasts(self) -> bool:
        """Whether its cause holds still."""
        return self.ended_unix_s is None


def ordered(alarms: Iterable[Alarm]) -> tuple[Alarm, ...]:
    """What lasts first, then what has ended; the most severe first, and of these the newest."""
    return tuple(
        sorted(alarms, key=lambda alarm: (not alarm.lasts, RANK[alarm.severity], -alarm.raised_unix_s))
    )


def overall(alarms: Iterable[Alarm]) -> OverallSeverity:
    """The state of the whole; alarms whose cause has ended do not count."""
    worst = min((RANK[alarm.severity] for alarm in alarms if alarm.lasts), default=None)
    return OverallSeverity.NORMAL if worst is None else OverallSeverity(list(AlarmSeverity)[worst])
