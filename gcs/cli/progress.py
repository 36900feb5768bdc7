"""Progress of long work: on a terminal's standard error alone, and gone when the work is done.

What is printed on standard output stays as it is; in a pipe, in a log and with `--json` nothing is written.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)

Report = Callable[[float], None]
"""Is called with the share of the work that is done, from 0 to 1."""


@contextmanager
def working(
    text: str, total: int | None = None, console: Console | None = None, *, shown: bool = True
) -> Iterator[Callable[[], None]]:
    """Show what is going on, for how long, and with a `total` how much of it is done.

    Args:
        text: what is being done.
        total: how many parts it has; None: not known beforehand.
        console: where to; None: standard error.
        shown: False where nothing is to be shown, as with `--json`.

    Yields:
        What is to be called when a part is done.
    """
    counted = () if total is None or total < 2 else (BarColumn(), MofNCompleteColumn(), TaskProgressColumn())
    with _bar((SpinnerColumn(), *_text(), *counted, TimeElapsedColumn()), console, shown=shown) as progress:
        task = progress.add_task(text, total=total)
        yield lambda: progress.advance(task)


@contextmanager
def share_of(text: str, console: Console | None = None, *, shown: bool = True) -> Iterator[Report]:
    """Show which share of one long piece of work is done, in per cent.

    Args:
        text: what is being done.
        console: where to; None: standard error.
        shown: False where nothing is to be shown, as with `--json`.

    Yields:
        What is to be called with the share that is done. It never goes back.
    """
    columns = (*_text(), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with _bar(columns, console, shown=shown) as progress:
        task = progress.add_task(text, total=1.0)
        done = 0.0

        def report(share: float) -> None:
            nonlocal done
            done = max(done, min(share, 1.0))
            progress.update(task, completed=done)

        yield report


def part_of(report: Report, first: float, last: float) -> Report:
    """A report of one part of the work: from the share `first` of the whole to the share `last`."""
    return lambda share: report(first + (last - first) * share)


def _text() -> tuple[ProgressColumn, ...]:
    return (TextColumn("{task.description}", markup=False),)


def _bar(columns: tuple[ProgressColumn, ...], console: Console | None, *, shown: bool) -> Progress:
    console = console or Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not (shown and console.is_terminal))
