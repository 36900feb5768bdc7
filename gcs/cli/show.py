"""`gcs show`: checks, plots or hashes a show file."""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path

from gcs.cli.output import print_json
from gcs.cli.plots import require_matplotlib
from gcs.cli.progress import share_of
from gcs.model.errors import ConfigError, ShowError
from gcs.shows import LoadedShow, find, load
from gcs.simulation.rehearsal.flight import rehearse
from gcs.simulation.rehearsal.verdict import judge, table


def run(arguments: argparse.Namespace) -> int:
    """Run the command. Returns: 0; 1 when the show fails its check. Raises: ConfigError for a bad file."""
    if arguments.action == "check":
        return _check(arguments)
    loaded = load(find(arguments.file))
    if arguments.action == "hash":
        digest = loaded.show.digest
        if arguments.json:
            print_json({"hash": digest})
        else:
            print(digest)
        return 0
    return _plot(loaded, arguments)


def _check(arguments: argparse.Namespace) -> int:
    path = find(arguments.file)
    try:
        loaded = load(path)
    except ShowError as error:
        if arguments.json:
            problems = [asdict(problem) for problem in error.problems]
            print_json({"show": path.stem, "file": error.file, "good": False, "problems": problems})
        else:
            print(error, file=sys.stderr)
        return 1
    with share_of(f"flying {path.stem} in virtual time", shown=not arguments.json) as report:
        verdict = judge(*rehearse(loaded, arguments.seed, report))
    model = {"model": loaded.show.model_dump(mode="json")} if arguments.model else {}
    if arguments.json:
        print_json(verdict.describe() | model, indent=None)
    else:
        print(table(verdict))
    return 0 if verdict.good else 1


def _plot(loaded: LoadedShow, arguments: argparse.Namespace) -> int:
    require_matplotlib("gcs show plot")
    from gcs.simulation.rehearsal.plot import draw  # noqa: PLC0415  (takes a second, only for plots)

    file = Path(arguments.picture)
    if not file.parent.is_dir() or file.suffix not in {".png", ".svg", ".pdf"}:
        raise ConfigError(f"{file}: a .png, .svg or .pdf file in a folder that exists")
    with share_of("flying it in virtual time", shown=not arguments.json) as report:
        verdict = draw(*rehearse(loaded, arguments.seed, report), file)
    if arguments.json:
        print_json({"picture": str(file), "good": verdict.good})
    return 0 if verdict.good else 1
