"""The confirmation of `gcs kill` and its result, with the service and without it."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import Final

from gcs.cli.output import REFUSED, fail, note, print_json

DONE: Final = "done"
"""A value of `gcs.service.Outcome`, whose import would load numpy."""


def asked(names: Sequence[str], code: str, valid_s: float, arguments: argparse.Namespace) -> bool:
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
    if arguments.json:
        fail(refused, REFUSED, as_json=True)
    else:
        note(refused, as_json=arguments.json)
    return False


def describe(outcomes: Mapping[str, tuple[str, str]], arguments: argparse.Namespace) -> int:
    """Print outcome and reason for each vehicle. Returns: the exit code."""
    if arguments.json:
        parts = {name: {"outcome": outcome, "reason": reason} for name, (outcome, reason) in outcomes.items()}
        print_json({"action": "kill", "vehicles": parts})
    for name, (outcome, reason) in () if arguments.json else outcomes.items():
        print(f"{name}: {outcome}{f', {reason}' if reason else ''}")
    return 0 if all(outcome == DONE for outcome, _ in outcomes.values()) else REFUSED
