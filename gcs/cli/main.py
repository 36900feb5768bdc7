"""Arguments of `gcs`, and where each goes. What a command needs is loaded when it is asked for."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Final, NamedTuple

from gcs.errors import ConfigError


class Command(NamedTuple):
    """One of our own: its module has `add_arguments(parser)` and, unless that names others, `run`."""

    module: str
    help: str


COMMANDS: Final = {
    "demo": Command("gcs.cli.demo", "fly the whole story with an embedded fake fleet"),
    "serve": Command("gcs.cli.serve_command", "run the service and its REST API"),
    "show": Command("gcs.cli.shows.command", "check, draw or hash a show file"),
    "params": Command("gcs.cli.params", "check or set the parameters that decide what is safe"),
    "simulate": Command("gcs.cli.simulation.command", "fly scenarios in virtual time and judge them"),
    "replay": Command("gcs.cli.replay", "show a recorded flight through the API, as if live"),
    "certify": Command("gcs.cli.certify", "judge a recorded flight: separation, fence, limits"),
    "key": Command("gcs.cli.key", "keys for MAVLink signatures"),
    "token": Command("gcs.cli.token", "tokens that the API asks for"),
    "status": Command("gcs.cli.status", "the fleet of a running service, as a live table"),
    "preflight": Command("gcs.cli.preflight", "what a start would find, as a table"),
    "kill": Command("gcs.cli.kill", "stop motors now, even in the air; works without the service"),
    "sim": Command("sim.cli", "run a fake fleet alone, as python -m sim does"),
}


def build_parser(asked: str | None) -> argparse.ArgumentParser:
    """For the command that is asked for; for all, and each call of the API, where there is no such one."""
    parser = argparse.ArgumentParser(prog="gcs", description="Fly a self-organising formation of drones.")
    commands = parser.add_subparsers(dest="command", required=True)
    remote = None if asked in COMMANDS else import_module("gcs.cli.remote")
    is_call = remote is not None and asked in remote.words()
    for name, (module, text) in COMMANDS.items():
        if asked == name or (remote is not None and not is_call):
            command = import_module(module)
            own = commands.add_parser(name, help=text, allow_abbrev=False)
            command.add_arguments(own)
            if own.get_default("run") is None and hasattr(command, "run"):
                own.set_defaults(run=command.run)
    if remote is not None:
        remote.add_commands(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Returns: the exit code; 2 for bad arguments or configuration."""
    given = sys.argv[1:] if arguments is None else arguments
    parsed = build_parser(given[0] if given else None).parse_args(given)
    try:
        return int(parsed.run(parsed))
    except ConfigError as error:
        print(f"gcs: {error}", file=sys.stderr)
        return 2
