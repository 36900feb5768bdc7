"""`gcs alarms` and `gcs acknowledge`: the overall severity and every alarm, the most severe first."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext, suppress
from datetime import datetime
from typing import TYPE_CHECKING, Final, TypeVar

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from gcs.cli.output import failed, print_json
from gcs.cli.remote import add_connection, connected, document
from gcs.model.errors import GcsError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from gcs.service.alarms import Alarm


M = TypeVar("M")

STYLE: Final = {
    "emergency": "bold white on red",
    "warning": "bold black on yellow",
    "caution": "bold yellow",
    "information": "cyan",
    "normal": "green",
}
ENDED: Final = "dim"


def alarm_lines(severity: str, alarms: Sequence[Alarm]) -> RenderableType:
    """Format alarms, the most severe first, for `gcs alarms` and the top of `gcs status`."""
    if not alarms:
        return Text("normal: no alarms", style=STYLE["normal"])
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    is_open = sum(alarm.acknowledged_by is None for alarm in alarms)
    counted = f"{len(alarms)} alarm{'' if len(alarms) == 1 else 's'}, {is_open} not acknowledged"
    table.add_row(Text(f" {severity.upper()} ", style=STYLE[severity]), Text(counted))
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


def _clock(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s).astimezone().strftime("%H:%M:%S")


PERIOD_S: Final = 0.5


def add_alarms_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--watch", action="store_true", help="go on until Ctrl-C")
    add_connection(parser)


def run_alarms(arguments: argparse.Namespace) -> int:
    with connected(arguments) as client:
        period_s = PERIOD_S if arguments.watch else None
        return show_state(
            client.alarms, lambda found: alarm_lines(found.severity, found.alarms), period_s, arguments
        )


def show_state(
    read: Callable[[], M],
    render: Callable[[M], RenderableType],
    period_s: float | None,
    arguments: argparse.Namespace,
) -> int:
    """Print a state of the service once, or with `period_s` until Ctrl-C, as a table or as JSON. Returns: 0.

    Repeated JSON is one answer per line; an error is one line on standard error, and the loop continues.
    Raises: GcsError when it is printed once.
    """
    console = Console()
    if period_s is None:
        state = read()
        if arguments.json:
            print_json(document(state))
        else:
            console.print(render(state))
        return 0
    live = Live(console=console, screen=True, auto_refresh=False)
    with suppress(KeyboardInterrupt), nullcontext() if arguments.json else live:
        while True:
            try:
                if arguments.json:
                    print_json(document(read()), indent=None)
                else:
                    live.update(newest(read, render), refresh=True)
            except GcsError as error:
                failed(error, arguments)
            time.sleep(period_s)
    return 0


def newest(read: Callable[[], M], render: Callable[[M], RenderableType]) -> RenderableType:
    """Format the newest state, or why it is not available, so that no old state looks current."""
    try:
        return render(read())
    except GcsError as error:
        return Text(f"NO STATE: {error}", style=STYLE["emergency"])


def add_acknowledge_arguments(parser: argparse.ArgumentParser) -> None:
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("alarm", nargs="?", metavar="ID", help="as gcs alarms lists it")
    which.add_argument("--all", action="store_true", help="every alarm not acknowledged yet")
    add_connection(parser)


def run_acknowledge(arguments: argparse.Namespace) -> int:
    with connected(arguments) as client:
        alarms = client.acknowledge_all() if arguments.all else [client.acknowledge(arguments.alarm)]
    if arguments.json:
        print_json(document(alarms if arguments.all else alarms[0]))
    for alarm in () if arguments.json else alarms:
        print(f"{alarm.id} acknowledged by {alarm.acknowledged_by}: {alarm.text}")
    return 0
