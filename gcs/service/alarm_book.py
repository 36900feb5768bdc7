"""Turns conditions into alarms: grouped by cause, with hysteresis, with acknowledgement."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import count
from typing import Final

from gcs.model.errors import UnknownError
from gcs.model.state import VehicleId
from gcs.service.alarms import (
    CAUSES,
    RANK,
    Alarm,
    AlarmCause,
    AlarmSeverity,
    CauseRow,
    Condition,
    VehicleReason,
    for_number,
    in_the_past,
    ordered,
)

NAMED_MAX: Final = 12
"""Up to this many vehicles are named in a text; of more it has the number, and `vehicles` has the names."""

NUMBERS_S: Final = 5.0
"""A text in which only numbers differ is rewritten after this time."""

KEPT_UNTIL_ACKNOWLEDGED: Final = frozenset({AlarmSeverity.EMERGENCY, AlarmSeverity.WARNING})
"""Alarms that stay listed as ended until they are acknowledged."""

MINUTES_S: Final = 180.0
"""A time from here on is in minutes."""

REASONS_MAX: Final = 2
"""Of more different reasons a text has none: they are a table."""

ENDED_MAX: Final = 200
"""At most this many ended alarms are kept; the oldest is dropped first."""

_NUMBER: Final = re.compile(r"(?<![\w.:])\d+(\.\d+)?(?![.:]?\d)")
"""A measured value. Digits of a vehicle's name, an address or a time of day are none: with others the text
says something else.
"""


class ChangeKind(StrEnum):
    """Kind of a change of an alarm."""

    BEGUN = "begun"
    GROWN = "grown"  # it concerns a further vehicle, or is more severe
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Change:
    """A change to be recorded."""

    kind: ChangeKind
    alarm: Alarm


@dataclass(slots=True)
class _Member:
    """One vehicle of an alarm, or None where it concerns no vehicle."""

    condition: Condition
    on_since_s: float
    gone_since_s: float | None = None
    active: bool = False


@dataclass(slots=True)
class _BookEntry:
    """One alarm, or conditions that may become one."""

    row: CauseRow
    members: dict[VehicleId | None, _Member] = field(default_factory=dict)
    alarm: Alarm | None = None
    written_s: float = 0.0
    because: str = ""  # when it was raised last: as it ends, the values are good again
    about: str = ""
    begun_s: float = 0.0
    gone_s: float = 0.0
    flew: bool = False  # one of its vehicles, when it began


class AlarmBook:
    """All alarms of one service. Used on the event loop only; reads no clock."""

    def __init__(self, stands: Callable[[VehicleId], bool] = lambda _: False) -> None:
        """`stands`: whether a vehicle is on the ground."""
        self._stands = stands
        self._entries: dict[tuple[AlarmCause, str], _BookEntry] = {}
        self._ended: list[Alarm] = []
        self._numbers = count(1)
        self._last: tuple[Condition, ...] = ()
        self._due_s = float("inf")  # when alarms change although the conditions do not
        self.alarms: tuple[Alarm, ...] = ()

    def look(self, conditions: Iterable[Condition], now_s: float, unix_s: float) -> tuple[Change, ...]:
        """Process all conditions that hold at `now_s` (loop clock). Returns: the changes."""
        conditions = tuple(conditions)
        if conditions == self._last and now_s < self._due_s:
            return ()
        self._last = conditions
        held: dict[tuple[AlarmCause, str], dict[VehicleId | None, Condition]] = {}
        for condition in conditions:
            members = held.setdefault((condition.cause, condition.about), {})
            for name in condition.vehicles or (None,):
                member = members.get(name)
                if member is None or _rank(condition) < _rank(member):
                    members[name] = condition
        replaced = {
            (cause, condition.about, name)
            for condition in conditions
            for cause in condition.replaces
            for name in condition.vehicles or (None,)
        }
        changes: list[Change] = []
        self._due_s = float("inf")
        for key in [*self._entries, *(key for key in held if key not in self._entries)]:
            entry = self._entries.setdefault(key, _BookEntry(CAUSES[key[0]]))
            self._follow(entry, held.get(key, {}), now_s)
            goes_on = entry.alarm is not None and all(
                (*key, name) in replaced for name in entry.alarm.vehicles or (None,)
            )
            changes += self._write(entry, now_s, unix_s, goes_on=goes_on)
            if not entry.members:
                del self._entries[key]
        self._list()
        return tuple(changes)

    def acknowledge(self, alarm_id: str, by: str, unix_s: float) -> Alarm:
        """Store the operator's name; an ended alarm is then removed. Raises: UnknownError."""
        for entry in self._entries.values():
            if entry.alarm is not None and entry.alarm.id == alarm_id:
                if entry.alarm.acknowledged_by is None:
                    entry.alarm = _acknowledged(entry.alarm, by, unix_s)
                    self._list()
                return entry.alarm
        for alarm in self._ended:
            if alarm.id == alarm_id:
                self._ended.remove(alarm)
                self._list()
                return _acknowledged(alarm, by, unix_s)
        listed = ", ".join(alarm.id for alarm in self.alarms) or "none"
        raise UnknownError(f"there is no alarm {alarm_id!r}; listed now: {listed}")

    def _follow(self, entry: _BookEntry, held: dict[VehicleId | None, Condition], now_s: float) -> None:
        """Begin and end members after their delays."""
        for name, condition in held.items():
            member = entry.members.get(name)
            if member is None:
                member = entry.members[name] = _Member(condition, now_s)
            elif member.gone_since_s is not None and not member.active:
                member.on_since_s = now_s
            member.condition, member.gone_since_s = condition, None
            if not member.active:
                begins_s = member.on_since_s + entry.row.on_after_s
                member.active = now_s >= begins_s
                if not member.active:
                    self._due_s = min(self._due_s, begins_s)
        for name in [name for name in entry.members if name not in held]:
            member = entry.members[name]
            if member.gone_since_s is None:
                member.gone_since_s = now_s
            ends_s = member.gone_since_s + entry.row.off_after_s
            if not member.active or now_s >= ends_s:
                entry.gone_s = max(entry.gone_s, member.gone_since_s)
                del entry.members[name]
            else:
                self._due_s = min(self._due_s, ends_s)

    def _write(self, entry: _BookEntry, now_s: float, unix_s: float, *, goes_on: bool) -> list[Change]:
        active = {name: member.condition for name, member in entry.members.items() if member.active}
        before = entry.alarm
        if not active:
            if before is None:
                return []
            ended = self._over(entry, before, unix_s)
            entry.alarm = None
            kept = before.severity in KEPT_UNTIL_ACKNOWLEDGED and not goes_on
            if kept and before.acknowledged_by is None:
                self._ended = [*self._ended, ended][-ENDED_MAX:]
            return [Change(ChangeKind.ENDED, ended)]
        alarm = _alarm(entry.row, active)
        if before is None:
            name = f"{alarm.cause}-{next(self._numbers)}"
            alarm = replace(alarm, id=name, since_unix_time_s=unix_s, raised_unix_time_s=unix_s)
            entry.alarm, entry.written_s = alarm, now_s
            entry.because, entry.about = _because(active)[0], next(iter(active.values())).about
            entry.begun_s = min(member.on_since_s for member in entry.members.values() if member.active)
            entry.flew = not all(map(self._stands, alarm.vehicles))
            return [Change(ChangeKind.BEGUN, alarm)]
        alarm = replace(
            before,
            severity=alarm.severity,
            text=alarm.text,
            advice=alarm.advice,
            vehicles=alarm.vehicles,
            reasons=alarm.reasons,
            action=alarm.action,
            command_id=alarm.command_id,
        )
        if alarm == before:
            return []
        more_severe = RANK[alarm.severity] < RANK[before.severity]
        grown = more_severe or bool(set(alarm.vehicles) - set(before.vehicles))
        if grown:
            alarm = replace(_acknowledged(alarm, None, None), raised_unix_time_s=unix_s)
            entry.because = _because(active)[0]
        elif _without_numbers(alarm) == _without_numbers(before) and now_s < entry.written_s + NUMBERS_S:
            self._due_s = min(self._due_s, entry.written_s + NUMBERS_S)
            return []
        entry.alarm, entry.written_s = alarm, now_s
        return [Change(ChangeKind.GROWN, alarm)] if grown else []

    def _over(self, entry: _BookEntry, alarm: Alarm, unix_s: float) -> Alarm:
        """The alarm in the past, and how long it lasted: what was done about it, and what to do, is over."""
        headline = _headline(in_the_past(entry.row), alarm.vehicles, entry.about)
        first = f"{headline}: {entry.because}" if entry.because else headline
        landed = entry.flew and all(map(self._stands, alarm.vehicles))
        ended = f"{'On the ground' if landed else 'Ended'} after {_in_words(entry.gone_s - entry.begun_s)}"
        return replace(alarm, text=f"{first}. {ended}.", advice="", action=None, ended_unix_time_s=unix_s)

    def _list(self) -> None:
        lasting = (entry.alarm for entry in self._entries.values() if entry.alarm is not None)
        self.alarms = ordered([*lasting, *self._ended])


def _rank(condition: Condition) -> int:
    return RANK[condition.severity or CAUSES[condition.cause].severity]


def _acknowledged(alarm: Alarm, by: str | None, unix_s: float | None) -> Alarm:
    return replace(alarm, acknowledged_by=by, acknowledged_unix_time_s=unix_s)


def _without_numbers(alarm: Alarm) -> Alarm:
    reasons = tuple(replace(each, because=_NUMBER.sub("#", each.because)) for each in alarm.reasons)
    text, advice = _NUMBER.sub("#", alarm.text), _NUMBER.sub("#", alarm.advice)
    return replace(alarm, text=text, advice=advice, reasons=reasons)


def _alarm(row: CauseRow, active: dict[VehicleId | None, Condition]) -> Alarm:
    """Return the alarm of these conditions, without id and times."""
    conditions = list(dict.fromkeys(active.values()))
    worst = min(conditions, key=_rank)
    vehicles = tuple(name for name in active if name is not None)
    because, reasons = _because(active)
    many = len(vehicles) > 1
    headline = _headline(row.headline, vehicles, worst.about)
    consequences = dict.fromkeys(present.consequence for present in conditions)
    follows = for_number(" ".join(consequences), many=many).strip()
    first = f"{headline}: {because}" if because else headline
    return Alarm(
        id="",
        severity=worst.severity or row.severity,
        cause=worst.cause,
        text=f"{first}. {follows}".strip(),
        advice=for_number(worst.advice or row.advice, many=many),
        vehicles=vehicles,
        since_unix_time_s=0.0,
        raised_unix_time_s=0.0,
        command_id=next(
            (present.command_id for present in conditions if present.command_id is not None), None
        ),
        reasons=reasons,
        action=worst.action or (None if worst.advice else row.action),
    )


def _headline(text: str, vehicles: Sequence[VehicleId], about: str) -> str:
    many = len(vehicles) > 1
    subject = f"{'Vehicles' if many else 'Vehicle'} " if len(vehicles) <= NAMED_MAX else ""
    return for_number(text.format(vehicles=f"{subject}{named(vehicles)}", about=about), many=many)


def _because(active: Mapping[VehicleId | None, Condition]) -> tuple[str, tuple[VehicleReason, ...]]:
    """The reasons in words; of more than REASONS_MAX different ones each vehicle has its own instead."""
    by_reason: dict[str, list[VehicleId]] = {}
    for name, condition in active.items():
        by_reason.setdefault(condition.because, []).extend(() if name is None else (name,))
    if len(by_reason) > REASONS_MAX:
        each = ((name, for_number(present.because, many=False)) for name, present in active.items() if name)
        return "", tuple(VehicleReason(name, why) for name, why in each)
    alike = len(by_reason) == 1
    words = ((ids, for_number(why, many=len(ids) > 1)) for why, ids in by_reason.items())
    return "; ".join(f"{named(ids)}: {why}" if ids and not alike else why for ids, why in words), ()


def _in_words(seconds: float) -> str:
    if seconds < 1.0:
        return "less than 1 s"
    return f"{seconds:.0f} s" if seconds < MINUTES_S else f"{seconds / 60.0:.0f} min"


def named(vehicles: Sequence[VehicleId]) -> str:
    """Return the vehicles separated by commas, or their number if they are many."""
    return ", ".join(vehicles) if len(vehicles) <= NAMED_MAX else f"{len(vehicles)} vehicles"
