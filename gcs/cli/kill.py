"""`gcs kill`: motors off, in two steps; through the service where it answers, else without it."""

import argparse
import getpass
import hashlib
import os
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from gcs.cli.remote import REFUSED, add_connection, connected, failed
from gcs.client import Client
from gcs.config import Config
from gcs.direct_kill import direct_kill
from gcs.errors import ConfigError, GcsError, InvalidError, LinkError, RefusedError, UnknownError
from gcs.records.known import KnownVehicle, LastKnown, last_known
from gcs.records.outside import Outside
from gcs.service import Outcome, VehicleOutcome
from gcs.setting_errors import explained
from gcs.state import VehicleId

RECORD: Final = "runs"
ANSWER_S: Final = 2.0
"""A service that does not answer so soon is not waited for."""

WAIT_S: Final = 6.0
CODE_S: Final = 30.0
"""A code without the service is good for this long at least, and for twice as long at most."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`gcs kill`."""
    parser.add_argument("vehicles", metavar="VEHICLE", nargs="*")
    parser.add_argument("--all", action="store_true", help="everybody, in place of names")
    parser.add_argument("--confirm", metavar="CODE", help="the second step, where nobody can be asked")
    parser.add_argument("--direct", action="store_true", help="without the service, though it may answer")
    record = os.environ.get("GCS_RECORD", RECORD)
    parser.add_argument(
        "--record", default=record, metavar="FOLDER", help=f"of the service ({RECORD}; GCS_RECORD)"
    )
    add_connection(parser)


def run(arguments: argparse.Namespace) -> int:
    """Kill. Returns: 0 when everybody's motors are off, 1 when not, or when nothing was confirmed."""
    try:
        if bool(arguments.vehicles) == arguments.all and arguments.confirm is None:
            raise InvalidError("vehicles", arguments.vehicles, "names, or --all in their place")
        if not arguments.direct:
            try:
                with connected(arguments, timeout_s=ANSWER_S) as client:
                    return _through_service(client, arguments)
            except LinkError as error:
                _say(f"{error}; without the service then")
        return _without_service(arguments)
    except GcsError as error:
        return failed(error)


def _say(text: str) -> None:
    print(f"gcs: {text}", file=sys.stderr)


def _through_service(client: Client, arguments: argparse.Namespace) -> int:
    code = arguments.confirm
    if code is None:
        armed = client.arm_kill(arguments.vehicles or None)
        if not _asked(armed.vehicles, armed.code, f"{armed.valid_s:g} s", arguments):
            return REFUSED
        code = armed.code
    order = client.confirm_kill(code)
    try:
        order = client.wait_for(order.id, WAIT_S)
    except GcsError as error:  # it was given: how far it got is told below
        _say(str(error))
        order = client.order(order.id)
    parts = {name: VehicleOutcome(part.outcome, part.reason) for name, part in order.vehicles.items()}
    return _told(parts)


def _asked(names: Sequence[VehicleId], code: str, valid: str, arguments: argparse.Namespace) -> bool:
    """The second step on a terminal: whoever kills types whom. Elsewhere it is told how to go on."""
    _say(f"this stops the motors of {', '.join(names)}, now, even in the air: they fall")
    if not sys.stdin.isatty():
        again = " ".join(["gcs kill", *(arguments.vehicles or ["--all"]), "--confirm", code])
        print(f"nothing has happened yet; within {valid}: {again}")
        return False
    wanted = "all" if arguments.all else " ".join(names)
    print(f"type '{wanted}' to kill: ", end="", flush=True)
    if sys.stdin.readline().split() == wanted.split():
        return True
    _say("nothing has happened: that was something else")
    return False


def _without_service(arguments: argparse.Namespace) -> int:
    known = last_known(Path(arguments.record))
    config, chosen = _config(known, arguments.record), _chosen(known, arguments)
    names = [vehicle.id for vehicle in chosen]
    codes = [_code(known, chosen, time.time() - age_s) for age_s in (0.0, CODE_S)]
    if arguments.confirm is None:
        if not _asked(names, codes[0], f"{CODE_S:g} s", arguments):
            return REFUSED
    elif arguments.confirm not in codes:
        raise RefusedError(f"{arguments.confirm!r} does not confirm {', '.join(names)}: leave --confirm out")
    who = f"gcs kill ({getpass.getuser()})"
    with Outside(Path(arguments.record), known, who) as record:
        order_id = record.opened("kill", names)
        outcomes = direct_kill(config, chosen)
        for name, part in outcomes.items():
            record.closed(order_id, name, part)
            if part.outcome is Outcome.DONE:
                record.killed(name)
    if record.problem:
        _say(f"not recorded: {record.problem}")
    return _told(outcomes)


def _config(known: LastKnown, record: str) -> Config:
    if known.session is None:
        raise ConfigError(f"{record}: no session is in this record")
    try:
        return Config.model_validate(dict(known.session.config))
    except ValidationError as error:
        raise explained(error, f"{record}: session {known.session.id}", Config, None) from None


def _chosen(known: LastKnown, arguments: argparse.Namespace) -> list[KnownVehicle]:
    if arguments.all:
        heard = [one for one in known.vehicles.values() if one.host is not None]
        if not heard:
            raise RefusedError(f"{arguments.record}: nobody was ever heard")
        return heard
    if not arguments.vehicles:
        raise InvalidError(
            "vehicles", "none", "names, or --all: without the service a code does not know them"
        )
    unknown = [name for name in arguments.vehicles if name not in known.vehicles]
    if unknown:
        there = ", ".join(known.vehicles) or "nobody"
        raise UnknownError(f"{arguments.record}: never heard of {', '.join(unknown)}; there are {there}")
    return [known.vehicles[name] for name in dict.fromkeys(arguments.vehicles)]


def _code(known: LastKnown, chosen: Sequence[KnownVehicle], unix_s: float) -> str:
    """Names whom, and when: nothing needs to be remembered between the two steps."""
    session = "" if known.session is None else known.session.id
    said = [session, str(int(unix_s / CODE_S)), *sorted(one.id for one in chosen)]
    return hashlib.sha256("\0".join(said).encode()).hexdigest()[:6]


def _told(outcomes: Mapping[VehicleId, VehicleOutcome]) -> int:
    for name, part in outcomes.items():
        print(f"{name}: {part.outcome}{f', {part.reason}' if part.reason else ''}")
    return 0 if all(part.outcome is Outcome.DONE for part in outcomes.values()) else REFUSED
