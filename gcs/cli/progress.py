"""Progress of long work: on a terminal's standard error alone, and gone when the work is done.

What is printed on standard output stays as it is; in a pipe or a log nothing is written.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)


@contextmanager
def working(
    text: str, total: int | None = None, console: Console | None = None
) -> Iterator[Callable[[], None]]:
    """Show what is going on, for how long, and with a `total` how much of it is done.

    Args:
        text: what is being done.
        total: how many parts it has; None: not known beforehand.
        console: where to; None: standard error.

    Yields: what is to be called when a part is done.
    """
    console = console or Console(stderr=True)
    counted = () if total is None or total < 2 else (BarColumn(), MofNCompleteColumn())
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), *counted, TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(text, total=total)
        yield lambda: progress.advance(task)
