"""`gcs key`: creates keys for MAVLink signing."""

import argparse
from pathlib import Path

from gcs.cli.output import print_json
from gcs.links.signing_keys import create_key


def add_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(dest="key_command", required=True)
    create = commands.add_parser("create", help="write a new key to a file")
    create.add_argument("file", metavar="FILE", help="must not exist; readable for you alone")
    create.set_defaults(run=_create)


def _create(arguments: argparse.Namespace) -> int:
    create_key(Path(arguments.file))
    if arguments.json:
        print_json({"file": str(arguments.file)})
    else:
        print(f"{arguments.file}: a new key; the vehicles need the same one")
    return 0
