"""`gcs status`: the fleet as a table in the terminal, once or continuously."""

import argparse
import time
from typing import Final

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from gcs.cli.output import print_json
from gcs.cli.remote import add_connection, connected, watched_json
from gcs.cli.status_table import COLUMNS, SORTED, board
from gcs.client import Client
from gcs.model.errors import GcsError

PERIOD_S: Final = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--watch",
        nargs="?",
        type=_seconds,
        const=PERIOD_S,
        metavar="SECONDS",
        help=f"go on until Ctrl-C, anew every so many seconds ({PERIOD_S:g})",
    )
    parser.add_argument("--once", action="store_true", help=argparse.SUPPRESS)  # the default
    parser.add_argument(
        "--columns", type=_columns, metavar="A,B", help=f"these and no others, of {', '.join(COLUMNS)}"
    )
    parser.add_argument(
        "--sort", choices=SORTED, help="what needs a look first: least battery, oldest position"
    )
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the table, or with `--json` the state as `gcs state` does. Returns: 0. Raises: GcsError."""
    console = Console()
    with connected(arguments) as client:
        if arguments.watch is not None and arguments.json:
            return watched_json(client.fleet, arguments.watch, arguments)
        if arguments.watch is not None:
            return _watch(client, console, arguments)
        fleet = client.fleet()
    if arguments.json:
        print_json(fleet.model_dump(mode="json"))
    else:
        console.print(board(fleet, console.width, columns=arguments.columns, sort=arguments.sort))
    return 0


def newest(
    client: Client, width: int, columns: tuple[str, ...] | None = None, sort: str | None = None
) -> RenderableType:
    """Format the newest state, or why it is not available, so that no old state looks current."""
    try:
        return board(client.fleet(), width, columns=columns, sort=sort)
    except GcsError as error:
        return Text(f"NO STATE: {error}", style="bold white on red")


def _watch(client: Client, console: Console, arguments: argparse.Namespace) -> int:
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while True:
                table = newest(client, console.width, arguments.columns, arguments.sort)
                live.update(table, refresh=True)
                time.sleep(arguments.watch)
    except KeyboardInterrupt:
        return 0


def _columns(text: str) -> tuple[str, ...]:
    """Parse column names. Raises: ArgumentTypeError for an unknown column."""
    names = tuple(dict.fromkeys(text.split(",")))
    unknown = [name for name in names if name not in COLUMNS]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no column {unknown[0]!r}; there are {', '.join(COLUMNS)}")
    return names


def _seconds(text: str) -> float:
    """Parse a period. Raises: ArgumentTypeError for an invalid one."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.1 <= seconds <= 3600.0:
        raise argparse.ArgumentTypeError(f"{text!r}: seconds from 0.1 to 3600")
    return seconds
