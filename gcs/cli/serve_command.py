"""`gcs serve`: runs the service for a configuration, alone or under a supervisor."""

import argparse
import logging
import sys

from pydantic import ValidationError

from gcs.cli import logs, serve, supervisor
from gcs.cli.configuration import load_here
from gcs.cli.output import REFUSED, failed, lines
from gcs.config import schema as configuration
from gcs.config.setting_errors import explained
from gcs.model.errors import GcsError


def run(arguments: argparse.Namespace) -> int:
    """Serve. Returns: the exit code. Raises: ConfigError."""
    if arguments.supervised:
        return supervisor.run(sys.argv[1:])
    logs.set_up(logging.WARNING if arguments.quiet else logging.INFO)
    config = load_here(arguments.config)
    changes = {"host": arguments.host, "port": arguments.port}
    api = config.api.model_dump() | {key: value for key, value in changes.items() if value is not None}
    try:
        config = configuration.Config.model_validate(config.model_dump() | {"api": api})
    except ValidationError as error:
        raise explained(error, "with --host and --port", configuration.Config, None) from None
    try:
        serve.run(config, lines(arguments))
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    return 0
