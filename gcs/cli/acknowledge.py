"""`gcs acknowledge`: notes that an operator has seen an alarm."""

import argparse

from gcs.cli.remote import add_connection, connected, failed
from gcs.errors import GcsError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`gcs acknowledge`."""
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("alarm", nargs="?", metavar="ID", help="as gcs alarms lists it")
    which.add_argument("--all", action="store_true", help="every alarm not acknowledged yet")
    parser.add_argument("--json", action="store_true", help="print the alarms as the API answers them")
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Returns: the exit code."""
    try:
        with connected(arguments) as client:
            alarms = client.acknowledge_all() if arguments.all else [client.acknowledge(arguments.alarm)]
    except GcsError as error:
        return failed(error)
    for alarm in alarms:
        by = f"acknowledged by {alarm.acknowledged_by}"
        print(alarm.model_dump_json(indent=2) if arguments.json else f"{alarm.id} {by}: {alarm.text}")
    return 0
