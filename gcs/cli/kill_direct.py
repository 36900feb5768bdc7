"""`gcs kill` without the service: the service's record has vehicles, addresses and configuration."""

import argparse
import getpass
import hashlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from gcs.cli.kill_dialogue import asked, describe
from gcs.cli.kill_without_service import direct_kill
from gcs.cli.output import REFUSED, note
from gcs.config.schema import Config
from gcs.config.setting_errors import explained
from gcs.model.errors import ConfigError, InvalidError, RefusedError, UnknownError
from gcs.recording.audit import OfflineAudit
from gcs.recording.audit_reader import KnownVehicle, LastKnown, last_known
from gcs.service import Outcome

CODE_S: Final = 30.0
"""A code is valid for at least this long, and at most twice as long."""


def run(arguments: argparse.Namespace) -> int:
    """Kill vehicles. Returns: the exit code. Raises: GcsError when nothing was sent."""
    known = last_known(Path(arguments.record))
    config, chosen = _config(known, arguments.record), _chosen(known, arguments)
    names = [vehicle.id for vehicle in chosen]
    codes = [_code(known, chosen, time.time() - age_s) for age_s in (0.0, CODE_S)]
    if arguments.confirm is None:
        if not asked(names, codes[0], CODE_S, arguments):
            return REFUSED
    elif arguments.confirm not in codes:
        raise RefusedError(f"{arguments.confirm!r} does not confirm {', '.join(names)}: leave --confirm out")
    who = f"gcs kill ({getpass.getuser()})"
    with OfflineAudit(Path(arguments.record), known, who) as record:
        command_id = record.opened("kill", names)
        outcomes = direct_kill(config, chosen)
        for name, part in outcomes.items():
            record.closed(command_id, name, part)
            if part.outcome is Outcome.DONE:
                record.killed(name)
    if record.problem:
        note(f"not recorded: {record.problem}", as_json=arguments.json)
    return describe({name: (part.outcome, part.reason) for name, part in outcomes.items()}, arguments)


def _config(known: LastKnown, record: str) -> Config:
    if known.session is None:
        raise ConfigError(f"{record}: no session is in this record")
    try:
        return Config.model_validate(dict(known.session.config))
    except ValidationError as error:
        raise explained(error, f"{record}: session {known.session.id}", Config, None) from None


def _chosen(known: LastKnown, arguments: argparse.Namespace) -> list[KnownVehicle]:
    if arguments.all:
        received = [one for one in known.vehicles.values() if one.host is not None]
        if not received:
            raise RefusedError(f"{arguments.record}: no vehicle was ever received")
        return received
    if not arguments.vehicles:
        raise InvalidError(
            "vehicles", "none", "names, or --all: without the service a code does not know them"
        )
    unknown = [name for name in arguments.vehicles if name not in known.vehicles]
    if unknown:
        there = ", ".join(known.vehicles) or "none"
        raise UnknownError(f"{arguments.record}: no such vehicle: {', '.join(unknown)}; there are {there}")
    return [known.vehicles[name] for name in dict.fromkeys(arguments.vehicles)]


def _code(known: LastKnown, chosen: Sequence[KnownVehicle], unix_s: float) -> str:
    """Make the code, a hash of vehicles and time, so that nothing is stored between the two steps."""
    session = "" if known.session is None else known.session.id
    stated = [session, str(int(unix_s / CODE_S)), *sorted(one.id for one in chosen)]
    return hashlib.sha256("\0".join(stated).encode()).hexdigest()[:6]
