"""`gcs token`: creates, lists and revokes tokens for the API."""

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from gcs.api.auth.tokens import create_token, read_tokens, revoke_token
from gcs.cli.output import REFUSED, failed, note, print_json
from gcs.model.errors import GcsError
from gcs.service.access import Role

FILE: Final = "tokens.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(dest="token_command", required=True)
    create = commands.add_parser("create", help="make a token; it is printed once, and kept nowhere")
    create.add_argument("name", metavar="NAME", help="recorded with every command given with this token")
    create.add_argument(
        "--role",
        required=True,
        choices=[role.value for role in Role],
        help="watch reads; emergency also pauses, stops, lands and kills; operate may do everything",
    )
    create.set_defaults(run=_create)
    listing = commands.add_parser("list", help="names, roles, and since when")
    listing.set_defaults(run=_list)
    revoke = commands.add_parser("revoke", help="forget a token; a running service notices at once")
    revoke.add_argument("name", metavar="NAME")
    revoke.set_defaults(run=_revoke)
    for command in (create, listing, revoke):
        command.add_argument("--file", type=Path, default=Path(FILE), help=f"the token file ({FILE})")


def _create(arguments: argparse.Namespace) -> int:
    try:
        token = create_token(arguments.file, arguments.name, Role(arguments.role))
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    if arguments.json:
        print_json({"name": arguments.name, "role": arguments.role, "token": token})
    else:
        print(token)
    note(
        f"{arguments.name} may {arguments.role}; {arguments.file} keeps a hash of it: this is its only copy",
        as_json=arguments.json,
    )
    return 0


def _list(arguments: argparse.Namespace) -> int:
    try:
        entries = read_tokens(arguments.file)
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    if arguments.json:
        reported = [
            {"name": entry.name, "role": entry.role, "created_unix_time_s": entry.created_unix_time_s}
            for entry in entries
        ]
        print_json(reported)
        return 0
    for entry in entries:
        since = datetime.fromtimestamp(entry.created_unix_time_s, UTC).isoformat(timespec="seconds")
        print(f"{entry.name:<24} {entry.role:<10} {since}")
    return 0


def _revoke(arguments: argparse.Namespace) -> int:
    try:
        revoke_token(arguments.file, arguments.name)
    except GcsError as error:
        return failed(error, arguments, REFUSED)
    if arguments.json:
        print_json({"revoked": arguments.name})
    else:
        print(f"{arguments.name}: revoked")
    return 0
