"""`gcs acknowledge`: notes that an operator has seen an alarm."""

import argparse

from gcs.cli.output import print_json
from gcs.cli.remote import add_connection, connected


def add_arguments(parser: argparse.ArgumentParser) -> None:
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("alarm", nargs="?", metavar="ID", help="as gcs alarms lists it")
    which.add_argument("--all", action="store_true", help="every alarm not acknowledged yet")
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Returns: 0. Raises: GcsError."""
    with connected(arguments) as client:
        alarms = client.acknowledge_all() if arguments.all else [client.acknowledge(arguments.alarm)]
    if arguments.json:
        reported = [alarm.model_dump(mode="json") for alarm in alarms]
        print_json(reported if arguments.all else reported[0])
    for alarm in () if arguments.json else alarms:
        print(f"{alarm.id} acknowledged by {alarm.acknowledged_by}: {alarm.text}")
    return 0
