"""`gcs files`, `gcs key` and `gcs token`: shipped documents, keys for MAVLink and stations, API tokens."""

import argparse
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Final

from gcs.api.auth.tokens import create_token, read_tokens, revoke_token
from gcs.cli.output import answer, note, require_stations
from gcs.links.signing import create_key
from gcs.model.errors import ConfigError
from gcs.service.access import Role

FILE: Final = "tokens.json"


def add_token_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(dest="token_command", required=True)
    create = commands.add_parser("create", help="make a token; it is printed once, and kept nowhere")
    create.add_argument("name", metavar="NAME", help="recorded with every command given with this token")
    create.add_argument(
        "--role",
        required=True,
        choices=[role.value for role in Role],
        help="watch reads; emergency also pauses, stops, lands and kills; operate may do everything",
    )
    create.set_defaults(run=_create_token)
    listing = commands.add_parser("list", help="names, roles, and since when")
    listing.set_defaults(run=_list_tokens)
    revoke = commands.add_parser("revoke", help="forget a token; a running service notices at once")
    revoke.add_argument("name", metavar="NAME")
    revoke.set_defaults(run=_revoke_token)
    for command in (create, listing, revoke):
        command.add_argument("--file", type=Path, default=Path(FILE), help=f"the token file ({FILE})")


def _create_token(arguments: argparse.Namespace) -> int:
    token = create_token(arguments.file, arguments.name, Role(arguments.role))
    answer(arguments, {"name": arguments.name, "role": arguments.role, "token": token}, token)
    note(
        f"{arguments.name} may {arguments.role}; {arguments.file} keeps a hash of it: this is its only copy",
        as_json=arguments.json,
    )
    return 0


def _list_tokens(arguments: argparse.Namespace) -> int:
    entries = read_tokens(arguments.file)
    document = [entry.model_dump(mode="json", exclude={"sha256"}) for entry in entries]
    made = [datetime.fromtimestamp(entry.created_unix_time_s, UTC) for entry in entries]
    lines = [
        f"{entry.name:<24} {entry.role:<10} {at.isoformat(timespec='seconds')}"
        for entry, at in zip(entries, made, strict=True)
    ]
    answer(arguments, document, "\n".join(lines))
    return 0


def _revoke_token(arguments: argparse.Namespace) -> int:
    revoke_token(arguments.file, arguments.name)
    answer(arguments, {"revoked": arguments.name}, f"{arguments.name}: revoked")
    return 0


def add_key_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(dest="key_command", required=True)
    create = commands.add_parser("create", help="write a new key to a file")
    create.add_argument("file", metavar="FILE", help="must not exist; readable for you alone")
    create.set_defaults(run=_create_key)
    site = commands.add_parser("site", help="write certificates for the stations of a configuration")
    site.add_argument("folder", metavar="FOLDER", help="its files must not exist; readable for you alone")
    site.add_argument("--config", required=True, metavar="FILE", help="as for gcs serve, with stations")
    site.set_defaults(run=_create_site_keys)


def _create_key(arguments: argparse.Namespace) -> int:
    create_key(Path(arguments.file))
    text = f"{arguments.file}: a new key; the vehicles need the same one"
    answer(arguments, {"file": str(arguments.file)}, text)
    return 0


def _create_site_keys(arguments: argparse.Namespace) -> int:
    from gcs.config import schema  # noqa: PLC0415 (a second, which the other commands here do not need)

    require_stations("gcs key site", "cryptography")
    path = schema.find(arguments.config)
    stations = schema.load(path).stations
    if not stations:
        raise ConfigError(f"{path}: it has no stations, which need no keys then")
    from gcs.bus.keys import make_site_keys  # noqa: PLC0415 (needs the extra)

    folder = Path(arguments.folder)
    files = make_site_keys(folder, {each.name: [each.endpoint.host] for each in stations})
    text = (
        f"{folder}: a certificate and a key for each of {', '.join(each.name for each in stations)};"
        f" set bus.keys: {folder}, and copy ca.pem and NAME.pem, NAME.key to the host of that station only"
    )
    answer(arguments, {"folder": str(folder), "files": [file.name for file in files]}, text)
    return 0


TEXTS: Final = {".json", ".md", ".py", ".service"}
"""Suffixes of the documents that `gcs files` lists; hatch_build.py puts them into the wheel."""


def names() -> list[str]:
    """Return the documents of the folder, without pictures."""
    texts = (path for path in folder().rglob("*") if path.suffix in TEXTS)
    return sorted(str(path.relative_to(folder())) for path in texts)


def add_files_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("list", help="their names, and where they are")
    show = actions.add_parser("show", help="print one, as it is")
    show.add_argument("name", metavar="NAME", help="as gcs files list prints it")


def folder() -> Path:
    """Folder of the files: inside an installed wheel, or `docs` of a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_docs"
    return packed if packed.is_dir() else package.parent / "docs"


def run_files(arguments: argparse.Namespace) -> int:
    """List the files or print one. Returns: 0. Raises: ConfigError when there is no such file."""
    if arguments.action == "list":
        paths = {name: str(folder() / name) for name in names()}
        document = [{"name": name, "path": path} for name, path in paths.items()]
        answer(arguments, document, "\n".join(f"{name:<52} {path}" for name, path in paths.items()))
        return 0
    if arguments.name not in names():
        raise ConfigError(f"{arguments.name}: there is no such file; gcs files list names them")
    text = (folder() / arguments.name).read_text(encoding="utf-8")
    answer(arguments, {"name": arguments.name, "text": text}, text.removesuffix("\n"))
    return 0
