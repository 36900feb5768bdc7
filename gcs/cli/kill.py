"""`gcs kill`: stops motors, in two steps; through the service if it answers, else without it."""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from gcs.cli.output import REFUSED, fail, note, print_json
from gcs.cli.remote import add_connection, connected
from gcs.client import Client
from gcs.model.errors import GcsError, InvalidError, LinkError

RECORD: Final = "runs"
ANSWER_S: Final = 2.0
"""Longest wait for the service; then the kill goes on without it."""

WAIT_S: Final = 6.0


def add_kill_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
    parser.add_argument("--all", action="store_true", help="every vehicle, instead of names")
    parser.add_argument("--confirm", metavar="CODE", help="the second step, without a dialogue")
    parser.add_argument("--direct", action="store_true", help="without the service, though it may answer")
    record = os.environ.get("GCS_RECORD", RECORD)
    parser.add_argument(
        "--record", default=record, metavar="FOLDER", help=f"of the service ({RECORD}; GCS_RECORD)"
    )
    add_connection(parser)


def run_kill(arguments: argparse.Namespace) -> int:
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
    from gcs.cli.kill_without_service import kill_by_record  # noqa: PLC0415 (numpy and the links take a second)

    outcomes = kill_by_record(arguments, partial(is_confirmed, arguments))
    return REFUSED if outcomes is None else describe(outcomes, arguments)


def _through_service(client: Client, arguments: argparse.Namespace) -> int:
    code = arguments.confirm
    if code is None:
        armed = client.arm_kill(arguments.vehicles or None)
        if not is_confirmed(arguments, armed.vehicles, armed.code, armed.valid_s):
            return REFUSED
        code = armed.code
    command = client.confirm_kill(code)
    try:
        command = client.wait_for(command.id, WAIT_S)
    except GcsError as error:  # the command was accepted: its outcomes are printed below
        note(str(error), as_json=arguments.json)
        command = client.command_record(command.id)
    return describe({name: (part.outcome, part.reason) for name, part in command.outcomes.items()}, arguments)


DONE: Final = "done"
"""A value of `gcs.service.Outcome`, whose import would load numpy."""


def is_confirmed(arguments: argparse.Namespace, names: Sequence[str], code: str, valid_s: float) -> bool:
    """Ask for the second step on a terminal: the operator types the code. Otherwise print how to confirm."""
    note(
        f"this stops the motors of {', '.join(names)}, now, even in the air: they fall",
        as_json=arguments.json,
    )
    if not sys.stdin.isatty():
        again = " ".join(["gcs kill", *(arguments.vehicles or ["--all"]), "--confirm", code])
        if arguments.json:
            armed = {"vehicles": list(names), "code": code, "valid_s": valid_s, "confirm_with": again}
            print_json({"action": "kill", "armed": armed})
        else:
            print(f"nothing has happened yet; within {valid_s:g} s: {again}")
        return False
    desired = "all" if arguments.all else " ".join(names)
    prompt = sys.stderr if arguments.json else sys.stdout
    print(f"type '{desired}' to kill: ", end="", flush=True, file=prompt)
    if sys.stdin.readline().split() == desired.split():
        return True
    refused = "confirmation does not match; no motors were stopped"
    fail(refused, REFUSED, as_json=arguments.json)
    return False


def describe(outcomes: Mapping[str, tuple[str, str]], arguments: argparse.Namespace) -> int:
    if arguments.json:
        parts = {name: {"outcome": outcome, "reason": reason} for name, (outcome, reason) in outcomes.items()}
        print_json({"action": "kill", "vehicles": parts})
    for name, (outcome, reason) in () if arguments.json else outcomes.items():
        print(f"{name}: {outcome}{f', {reason}' if reason else ''}")
    return 0 if all(outcome == DONE for outcome, _ in outcomes.values()) else REFUSED
