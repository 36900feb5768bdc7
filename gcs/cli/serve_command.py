"""`gcs serve`: the service for a configuration, by itself or under a supervisor."""

import argparse
import logging
import sys

from pydantic import ValidationError

from gcs import config as configuration
from gcs import supervisor
from gcs.cli import logs, serve
from gcs.setting_errors import explained


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `gcs serve`."""
    parser.add_argument(
        "--config", required=True, metavar="FILE", help="a YAML file, or the name of one that is shipped"
    )
    parser.add_argument("--host", help="where the API listens; 127.0.0.1 unless told otherwise")
    parser.add_argument("--port", type=int, help="of the API; 8000 unless told otherwise")
    parser.add_argument("--quiet", action="store_true", help="log warnings only")
    parser.add_argument(
        supervisor.OPTION, action="store_true", help="by a parent that starts it again when it ends or hangs"
    )


def run(arguments: argparse.Namespace) -> int:
    """Serve. Returns: the exit code. Raises: ConfigError."""
    if arguments.supervised:
        return supervisor.run(sys.argv[1:])
    logs.set_up(logging.WARNING if arguments.quiet else logging.INFO)
    config = configuration.load(configuration.find(arguments.config))
    changes = {"host": arguments.host, "port": arguments.port}
    api = config.api.model_dump() | {key: value for key, value in changes.items() if value is not None}
    try:
        config = configuration.Config.model_validate(config.model_dump() | {"api": api})
    except ValidationError as error:
        raise explained(error, "with --host and --port", configuration.Config, None) from None
    return serve.run(config, lambda text: print(text, flush=True))
