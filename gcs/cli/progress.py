"""Progress of long work: only on a terminal's standard error, and removed when the work is done.

Standard output is not affected; in a pipe, in a log and with `--json` nothing is written.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress as bars
from rich.console import Console

Report = Callable[[float], None]
"""Called with the finished share of the work, from 0 to 1."""


@contextmanager
def share_of(text: str, console: Console | None = None, *, shown: bool = True) -> Iterator[Report]:
    """Show the share of one long piece of work; call with it. The display never goes back."""
    text_column = bars.TextColumn("{task.description}", markup=False)
    columns = (text_column, bars.BarColumn(), bars.TaskProgressColumn(), bars.TimeElapsedColumn())
    with _bar(columns, console, shown=shown) as progress:
        task = progress.add_task(text, total=1.0)
        done = 0.0

        def report(share: float) -> None:
            nonlocal done
            done = max(done, min(share, 1.0))
            progress.update(task, completed=done)

        yield report


def part_of(report: Report, first: float, last: float) -> Report:
    """Map the progress of one part of the work to the shares `first` to `last` of the whole."""
    return lambda share: report(first + (last - first) * share)


def _bar(columns: tuple[bars.ProgressColumn, ...], console: Console | None, *, shown: bool) -> bars.Progress:
    console = console or Console(stderr=True)
    return bars.Progress(
        *columns, console=console, transient=True, disable=not (shown and console.is_terminal)
    )
