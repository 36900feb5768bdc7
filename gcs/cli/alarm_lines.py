"""Alarms in a terminal: the overall severity, and every alarm, the most severe first."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rich.console import RenderableType

    from gcs.api.schemas.fleet import Alarm

STYLE: Final = {
    "emergency": "bold white on red",
    "warning": "bold black on yellow",
    "caution": "bold yellow",
    "information": "cyan",
    "normal": "green",
}
ENDED: Final = "dim"


def alarm_lines(severity: str, alarms: Sequence[Alarm]) -> RenderableType:
    """Format alarms for `gcs alarms` and the top of `gcs status`.

    Args:
        severity: the overall severity.
        alarms: all alarms, the most severe first.
    """
    if not alarms:
        return Text("normal: no alarms", style=STYLE["normal"])
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(Text(f" {severity.upper()} ", style=STYLE[severity]), Text(_counted(alarms)))
    for alarm in alarms:
        is_over = alarm.ended_unix_time_s is not None
        style = ENDED if is_over else STYLE[alarm.severity]
        table.add_row(Text(f" {alarm.severity} ", style=style), _entry(alarm))
    return table


def _entry(alarm: Alarm) -> Text:
    entry = Text(alarm.text)
    if not all(name in alarm.text for name in alarm.vehicles):
        entry.append(f"\nVehicles: {', '.join(alarm.vehicles)}")
    entry.append(f"\n{alarm.advice}", style="italic")
    entry.append(f"\n{alarm.id}, since {_clock(alarm.since_unix_time_s)}", style="dim")
    if alarm.ended_unix_time_s is not None:
        entry.append(f", ended {_clock(alarm.ended_unix_time_s)}: acknowledge it", style="bold")
    elif alarm.acknowledged_by is not None and alarm.acknowledged_unix_time_s is not None:
        when = _clock(alarm.acknowledged_unix_time_s)
        entry.append(f", acknowledged by {alarm.acknowledged_by} {when}", style="dim")
    else:
        entry.append(", not acknowledged", style="bold")
    return entry


def _counted(alarms: Sequence[Alarm]) -> str:
    is_open = sum(alarm.acknowledged_by is None for alarm in alarms)
    return f"{len(alarms)} alarm{'' if len(alarms) == 1 else 's'}, {is_open} not acknowledged"


def _clock(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().strftime("%H:%M:%S")
