"""The command line of `gcs show`."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from gcs.cli.shows.rehearsal import rehearse
from gcs.cli.shows.verdict import judge, table
from gcs.errors import ConfigError, ShowError
from gcs.show import LoadedShow, find, load


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """`gcs show check`, `gcs show plot`, `gcs show hash`."""
    actions = parser.add_subparsers(dest="action", required=True)
    check = actions.add_parser("check", help="fly it in virtual time; say what is wrong, by line and cue")
    _show(check)
    check.add_argument("--seed", type=int, default=1, metavar="S", help="of the vehicles' errors; 1")
    check.add_argument("--json", action="store_true", help="one JSON object")
    check.add_argument(
        "--model",
        action="store_true",
        help="with --json: and everything that is flown, as a service takes it",
    )
    plot = actions.add_parser("plot", help="draw it: paths, and what happens when")
    _show(plot)
    plot.add_argument("picture", metavar="OUT.png", help="a .png, .svg or .pdf file")
    plot.add_argument("--seed", type=int, default=1, metavar="S", help="of the vehicles' errors; 1")
    _show(actions.add_parser("hash", help="what a start must name: the hash of all that is flown"))


def _show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="a show file, or the name of one that is shipped")


def run(arguments: argparse.Namespace) -> int:
    """Do it. Returns: 0; 1 when the show is not good to fly. Raises: ConfigError when it is no show."""
    if arguments.action == "check":
        return _check(arguments)
    loaded = load(find(arguments.file))
    if arguments.action == "hash":
        print(loaded.show.digest)
        return 0
    return _plot(loaded, arguments)


def _check(arguments: argparse.Namespace) -> int:
    path = find(arguments.file)
    try:
        loaded = load(path)
    except ShowError as error:
        if arguments.json:
            problems = [asdict(problem) for problem in error.problems]
            print(json.dumps({"show": path.stem, "file": error.file, "good": False, "problems": problems}))
        else:
            print(error, file=sys.stderr)
        return 1
    verdict = judge(*rehearse(loaded, arguments.seed))
    model = {"model": loaded.show.model_dump(mode="json")} if arguments.model else {}
    print(json.dumps(verdict.told() | model) if arguments.json else table(verdict))
    return 0 if verdict.good else 1


def _plot(loaded: LoadedShow, arguments: argparse.Namespace) -> int:
    from gcs.cli.shows.plot import draw  # noqa: PLC0415  (a second that only a plot need wait for)

    file = Path(arguments.picture)
    if not file.parent.is_dir() or file.suffix not in {".png", ".svg", ".pdf"}:
        raise ConfigError(f"{file}: a .png, .svg or .pdf file in a folder that exists")
    verdict = draw(*rehearse(loaded, arguments.seed), file)
    return 0 if verdict.good else 1
