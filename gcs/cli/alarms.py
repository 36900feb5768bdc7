"""`gcs alarms`: prints the alarms once, or keeps them up to date."""

import argparse
import time
from typing import Final

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from gcs.cli.alarm_lines import STYLE, alarm_lines
from gcs.cli.output import print_json
from gcs.cli.remote import add_connection, connected, watched_json
from gcs.client import Client
from gcs.model.errors import GcsError

PERIOD_S: Final = 0.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--watch", action="store_true", help="go on until Ctrl-C")
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the alarms. Returns: 0. Raises: GcsError."""
    console = Console()
    with connected(arguments) as client:
        if arguments.watch and arguments.json:
            return watched_json(client.alarms, PERIOD_S, arguments)
        if arguments.watch:
            return _watch(client, console)
        found = client.alarms()
    if arguments.json:
        print_json(found.model_dump(mode="json"))
    else:
        console.print(alarm_lines(found.severity, found.alarms))
    return 0


def _watch(client: Client, console: Console) -> int:
    try:
        with Live(console=console, screen=True, auto_refresh=False) as live:
            while True:
                live.update(_newest(client), refresh=True)
                time.sleep(PERIOD_S)
    except KeyboardInterrupt:
        return 0


def _newest(client: Client) -> RenderableType:
    """Format the newest alarms, or why they are not available, so that no old list looks current."""
    try:
        found = client.alarms()
    except GcsError as error:
        return Text(f"NO STATE: {error}", style=STYLE["emergency"])
    return alarm_lines(found.severity, found.alarms)
