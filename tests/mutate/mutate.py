"""`make mutate`: break `gcs/safety` on purpose, one place at a time, and demand that a test fails.

Works on copies: nothing is ever changed in the checkout. Fails when a mutant survives that
`tests/mutate/survivors.yaml` gives no reason for; after a full run without one docs/mutation.md is brought up
to date. Arguments: see `--help`.
"""

import argparse
import json
import os
import re
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path

from tests.mutate import reviewed
from tests.mutate.judge import begin, complaint, copy, judge
from tests.mutate.mutants import LEFT_OUT, PACKAGE, Change, Mutant, mutants_of

LAST = Path("runs/mutation.json")
DOCUMENT = Path("docs/mutation.md")
FIGURES = re.compile(r"(<!-- figures -->\n).*?(<!-- end -->)", re.DOTALL)
TABLE = re.compile(r"(<!-- survivors -->\n).*?(<!-- end -->)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Run:
    """What was judged the last time, and what of it survived."""

    everything: bool
    mutants: int
    survived: tuple[tuple[str, str, int], ...]

    @classmethod
    def load(cls, path: Path) -> "Run":
        """As `save` left it."""
        raw = json.loads(path.read_text(encoding="utf-8"))
        return cls(
            raw["everything"], raw["mutants"], tuple((file, name, nth) for file, name, nth in raw["survived"])
        )

    def save(self, path: Path) -> None:
        """For `--again`."""
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")


def key(mutant: Mutant) -> tuple[str, str, int]:
    """What tells it from the others as long as nothing of `gcs/safety` changes."""
    return mutant.file, mutant.operator, mutant.occurrence


def every(modules: Sequence[str]) -> list[Mutant]:
    """The mutants of these modules, or of all."""
    paths = modules or [str(path) for path in sorted(PACKAGE.glob("*.py")) if path.name not in LEFT_OUT]
    return [mutant for path in paths for mutant in mutants_of(path)]


def outcomes(pool: ProcessPoolExecutor, mutants: Sequence[Mutant]) -> Iterator[tuple[Mutant, Change | None]]:
    """Each mutant with what survived of it, as they are judged; tells how far it is.

    Exits where the tests fail even without a mutant.
    """
    if stated := pool.submit(complaint).result():
        sys.exit(f"the tests fail without any mutant:\n{stated}")
    running = {pool.submit(judge, mutant): mutant for mutant in mutants}
    for count, done in enumerate(as_completed(running), 1):
        yield running[done], done.result()
        if count % 100 == 0:
            print(f"{count} of {len(mutants)}", file=sys.stderr, flush=True)


def update(document: Path, figures: str, table: str) -> None:
    """Replace what stands between the document's marks."""
    text = document.read_text(encoding="utf-8")
    text = FIGURES.sub(lambda found: f"{found[1]}{figures}\n{found[2]}", text)
    text = TABLE.sub(lambda found: f"{found[1]}\n{table}\n\n{found[2]}", text)
    document.write_text(text, encoding="utf-8")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make mutate", description=__doc__)
    parser.add_argument("modules", nargs="*", help="files of gcs/safety; all of them if none is named")
    parser.add_argument("--again", action="store_true", help="only what survived the last run")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    return parser.parse_args()


def judged(mutants: Sequence[Mutant], workers: int) -> dict[Mutant, Change]:
    """What survives, of the checkout as it is now."""
    with tempfile.TemporaryDirectory(prefix="mutate-") as folder:
        snapshot = Path(folder) / "snapshot"
        copy(Path(), snapshot)
        pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=begin, initargs=(snapshot,))
        try:
            return {mutant: change for mutant, change in outcomes(pool, mutants) if change is not None}
        finally:
            pool.shutdown(cancel_futures=True)


def main() -> int:
    """Judge, compare with what was reviewed, tell."""
    asked = arguments()
    groups = reviewed.load(reviewed.SURVIVORS)
    mutants = every(asked.modules)
    run = Run(not asked.modules, len(mutants), ())
    if asked.again:
        run = Run.load(LAST)
        mutants = [mutant for mutant in mutants if key(mutant) in run.survived]
    survived = judged(mutants, asked.workers)
    replace(run, survived=tuple(key(mutant) for mutant in survived)).save(LAST)
    known = {change for group in groups for change in group.changes()}
    lines = {change: mutant.start[0] for mutant, change in survived.items()}
    unknown = sorted(set(lines) - known, key=lambda one: (one.file, lines[one]))
    figures = f"{run.mutants} mutants: {run.mutants - len(survived)} killed, {len(survived)} survived."
    table = reviewed.as_markdown(groups, lines)
    print(table, figures, sep="\n\n")
    if unknown:
        print(f"{len(unknown)} without a reason in {reviewed.SURVIVORS}:\n\n{reviewed.as_yaml(unknown)}")
        return 1
    if run.everything:
        for change in sorted(known - set(lines), key=lambda one: (one.file, one.function)):
            print(f"no longer survives, take it out of {reviewed.SURVIVORS}: {asdict(change)}")
        update(DOCUMENT, figures, table)
    return 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
