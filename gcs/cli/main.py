"""Arguments of `gcs`, and where each goes."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

import gcs.cli.certify as certify_command
import gcs.cli.demo as demo_command
import gcs.cli.kill as kill_command
import gcs.cli.params as params_command
import gcs.cli.preflight as preflight_command
import gcs.cli.remote as remote_commands
import gcs.cli.replay as replay_command
import gcs.cli.serve as serve_command
import gcs.cli.shows.command as show_command
import gcs.cli.simulation.command as simulate_command
import gcs.cli.status as status_command
import gcs.cli.token as token_command
import sim.cli
from gcs import config as configuration
from gcs import supervisor
from gcs.cli import logs
from gcs.errors import ConfigError
from gcs.links.keys import create_key


def build_parser() -> argparse.ArgumentParser:
    """Every command: those named here, and one for each call of the REST API."""
    parser = argparse.ArgumentParser(prog="gcs", description="Fly a self-organising formation of drones.")
    commands = parser.add_subparsers(dest="command", required=True)

    demo_parser = commands.add_parser("demo", help="fly the whole story with an embedded fake fleet")
    demo_command.add_arguments(demo_parser)
    demo_parser.set_defaults(run=demo_command.run)

    serve_parser = commands.add_parser("serve", help="run the service and its REST API", allow_abbrev=False)
    serve_parser.add_argument(
        "--config", required=True, metavar="FILE", help="a YAML file, or the name of one that is shipped"
    )
    serve_parser.add_argument("--host", help="where the API listens; 127.0.0.1 unless told otherwise")
    serve_parser.add_argument("--port", type=int, help="of the API; 8000 unless told otherwise")
    serve_parser.add_argument("--quiet", action="store_true", help="log warnings only")
    serve_parser.add_argument(
        supervisor.OPTION, action="store_true", help="by a parent that starts it again when it ends or hangs"
    )
    serve_parser.set_defaults(run=_serve)

    show_parser = commands.add_parser("show", help="check, draw or hash a show file")
    show_command.add_arguments(show_parser)
    show_parser.set_defaults(run=show_command.run)

    params_parser = commands.add_parser("params", help="check or set the parameters that decide what is safe")
    params_command.add_arguments(params_parser)
    params_parser.set_defaults(run=params_command.run)

    simulate_parser = commands.add_parser("simulate", help="fly scenarios in virtual time and judge them")
    simulate_command.add_arguments(simulate_parser)
    simulate_parser.set_defaults(run=simulate_command.run)

    replay_parser = commands.add_parser("replay", help="show a recorded flight through the API, as if live")
    replay_command.add_arguments(replay_parser)
    replay_parser.set_defaults(run=replay_command.run)

    certify_parser = commands.add_parser("certify", help="judge a recorded flight: separation, fence, limits")
    certify_command.add_arguments(certify_parser)
    certify_parser.set_defaults(run=certify_command.run)

    key_parser = commands.add_parser("key", help="keys for MAVLink signatures")
    key_commands = key_parser.add_subparsers(dest="key_command", required=True)
    create_parser = key_commands.add_parser("create", help="write a new key to a file")
    create_parser.add_argument("file", metavar="FILE", help="must not exist; readable for you alone")
    create_parser.set_defaults(run=_create_key)

    token_parser = commands.add_parser("token", help="tokens that the API asks for")
    token_command.add_arguments(token_parser)

    status_parser = commands.add_parser("status", help="the fleet of a running service, as a live table")
    status_command.add_arguments(status_parser)
    status_parser.set_defaults(run=status_command.run)
    preflight_parser = commands.add_parser("preflight", help="what a start would find, as a table")
    preflight_command.add_arguments(preflight_parser)
    preflight_parser.set_defaults(run=preflight_command.run)
    remote_commands.add_commands(commands)
    kill_parser = commands.add_parser(
        "kill", help="stop motors now, even in the air; works without the service"
    )
    kill_command.add_arguments(kill_parser)
    kill_parser.set_defaults(run=kill_command.run)

    sim_parser = commands.add_parser("sim", help="run a fake fleet alone, as python -m sim does")
    sim.cli.add_arguments(sim_parser)
    sim_parser.set_defaults(run=sim.cli.run)
    return parser


def _serve(arguments: argparse.Namespace) -> int:
    if arguments.supervised:
        return supervisor.run(sys.argv[1:])
    logs.set_up(logging.WARNING if arguments.quiet else logging.INFO)
    config = configuration.load(configuration.find(arguments.config))
    changes = {"host": arguments.host, "port": arguments.port}
    api = config.api.model_dump() | {key: value for key, value in changes.items() if value is not None}
    try:
        config = configuration.Config.model_validate(config.model_dump() | {"api": api})
    except ValidationError as error:
        raise configuration.explained(error, "with --host and --port") from None
    return serve_command.run(config, lambda text: print(text, flush=True))


def _create_key(arguments: argparse.Namespace) -> int:
    create_key(Path(arguments.file))
    print(f"{arguments.file}: a new key; the vehicles need the same one")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point. Returns: the exit code; 2 for bad arguments or configuration."""
    parsed = build_parser().parse_args(arguments)
    try:
        return int(parsed.run(parsed))
    except ConfigError as error:
        print(f"gcs: {error}", file=sys.stderr)
        return 2
