"""`gcs files`: documents, Grafana dashboard and systemd unit of the installed gcs."""

import argparse
import sys
from importlib import resources
from pathlib import Path

from gcs.cli.output import print_json
from gcs.model.errors import ConfigError

NAMES = (
    "architecture.md",
    "flight-quality.md",
    "formation-gcs.service",
    "grafana/formation.json",
    "invariants.md",
    "operations.md",
    "records.md",
    "stream.md",
)
"""Files of the repository's folder `docs`; pyproject.toml puts the same files into the wheel."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True)
    actions.add_parser("list", help="their names, and where they are")
    show = actions.add_parser("show", help="print one, as it is")
    show.add_argument("name", metavar="NAME", help="as gcs files list prints it")


def folder() -> Path:
    """Folder of the files: inside an installed wheel, or `docs` of a checkout."""
    package = Path(str(resources.files("gcs")))
    packed = package / "_docs"
    return packed if packed.is_dir() else package.parent / "docs"


def run(arguments: argparse.Namespace) -> int:
    """List the files or print one. Returns: 0. Raises: ConfigError when there is no such file."""
    if arguments.action == "list":
        if arguments.json:
            print_json([{"name": name, "path": str(folder() / name)} for name in NAMES])
        for name in () if arguments.json else NAMES:
            print(f"{name:<24} {folder() / name}")
        return 0
    if arguments.name not in NAMES:
        raise ConfigError(f"{arguments.name}: there is no such file; there are {', '.join(NAMES)}")
    text = (folder() / arguments.name).read_text(encoding="utf-8")
    if arguments.json:
        print_json({"name": arguments.name, "text": text})
    else:
        sys.stdout.write(text)
    return 0
