"""`gcs kill`: stops motors, in two steps; through the service if it answers, else without it."""

import argparse
import os
from typing import Final

from gcs.cli.kill_dialogue import asked, describe
from gcs.cli.output import REFUSED, note
from gcs.cli.remote import add_connection, connected
from gcs.client import Client
from gcs.model.errors import GcsError, InvalidError, LinkError

RECORD: Final = "runs"
ANSWER_S: Final = 2.0
"""Longest wait for the service; then the kill goes on without it."""

WAIT_S: Final = 6.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
    parser.add_argument("--all", action="store_true", help="every vehicle, instead of names")
    parser.add_argument("--confirm", metavar="CODE", help="the second step, without a dialogue")
    parser.add_argument("--direct", action="store_true", help="without the service, though it may answer")
    record = os.environ.get("GCS_RECORD", RECORD)
    parser.add_argument(
        "--record", default=record, metavar="FOLDER", help=f"of the service ({RECORD}; GCS_RECORD)"
    )
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Kill vehicles. Returns: 0 when all motors are off, 1 when not, or when the kill was not confirmed.

    Raises: GcsError when nothing was sent.
    """
    if bool(arguments.vehicles) == arguments.all and arguments.confirm is None:
        raise InvalidError(
            "vehicles", " ".join(arguments.vehicles) or "none", "names, or --all in their place"
        )
    if not arguments.direct:
        try:
            with connected(arguments, timeout_s=ANSWER_S) as client:
                return _through_service(client, arguments)
        except LinkError as error:
            note(f"{error}; without the service then", as_json=arguments.json)
    return _without_service(arguments)


def _through_service(client: Client, arguments: argparse.Namespace) -> int:
    code = arguments.confirm
    if code is None:
        armed = client.arm_kill(arguments.vehicles or None)
        if not asked(armed.vehicles, armed.code, armed.valid_s, arguments):
            return REFUSED
        code = armed.code
    command = client.confirm_kill(code)
    try:
        command = client.wait_for(command.id, WAIT_S)
    except GcsError as error:  # the command was accepted: its outcomes are printed below
        note(str(error), as_json=arguments.json)
        command = client.command_record(command.id)
    return describe({name: (part.outcome, part.reason) for name, part in command.vehicles.items()}, arguments)


def _without_service(arguments: argparse.Namespace) -> int:
    """Kill with the addresses in the record. Its imports load only now, because they may take a second."""
    from gcs.cli import kill_direct as kill_directly  # noqa: PLC0415 (numpy, pydantic and the links)

    return kill_directly.run(arguments)
