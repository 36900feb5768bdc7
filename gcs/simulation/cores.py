"""Work on all cores, in processes that end at once when it is left: by an error, by Ctrl-C, by `close`.

Not by `concurrent.futures`: an interpreter that ends waits there for all that was submitted.
"""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from pathlib import Path
from typing import Any, Final, TypeVar

from rich.console import Console
from rich.progress import track

from gcs.formation.laws.registry import allow_code, code_folder
from gcs.model.errors import GcsError, RefusedError

S = TypeVar("S")
T = TypeVar("T")

AHEAD: Final = 2
"""Runs that a process is given at once: while its result is taken, the next one waits in its pipe."""

KEPT: Final = 8
"""Results of each process, at most, that are kept because an earlier run is not done yet."""


def on_all_cores(
    do: Callable[[S], T],
    runs: Sequence[S],
    workers: int | None = None,
    *,
    progress: bool = False,
    console: Console | None = None,
) -> Iterator[T]:
    """Yield what `do` returns, in the order of the runs; `progress`: on a terminal or in a notebook.

    Raises: RefusedError when a process ended; its own error is on standard error.
    """
    console = console or Console(stderr=True)
    shown = progress and (console.is_terminal or console.is_jupyter)
    text = f"flying {len(runs)} in virtual time"
    done = _done(do, runs, workers)
    yield from track(done, text, len(runs), console=console, transient=True, disable=not shown)


def _done(do: Callable[[S], T], runs: Sequence[S], workers: int | None) -> Iterator[T]:
    count = min(workers or os.cpu_count() or 1, len(runs))
    if count <= 1:
        yield from map(do, runs)
        return
    with _processes(do, count) as pipes:
        for pipe in pipes:  # not as arguments: a process that ends before it has read them all is not noticed
            _sent(pipe, runs)
        yield from _in_order(pipes, len(runs))


def _in_order(pipes: Sequence[Connection], count: int) -> Iterator[Any]:
    """Give each process the number of its next run as soon as it has sent a result."""
    results: dict[int, Any] = {}
    given, taken, under_way = 0, 0, dict.fromkeys(pipes, 0)
    while taken < count:
        for pipe in pipes:
            while under_way[pipe] < AHEAD and given < min(count, taken + KEPT * len(pipes)):
                _sent(pipe, given)
                given, under_way[pipe] = given + 1, under_way[pipe] + 1
        ready = [] if taken in results else wait([pipe for pipe in pipes if under_way[pipe]])
        for pipe in [pipe for pipe in pipes if pipe in ready]:
            number, result = _received(pipe)
            results[number], under_way[pipe] = result, under_way[pipe] - 1
        while taken in results:
            result = results.pop(taken)
            if isinstance(result, GcsError):
                raise result
            yield result
            taken += 1


def _received(pipe: Connection) -> tuple[int, Any]:
    with _ended():
        number, result = pipe.recv()
    return number, result


def _sent(pipe: Connection, value: object) -> None:
    with _ended():
        pipe.send(value)


@contextmanager
def _ended() -> Iterator[None]:
    """Raises: RefusedError for a process that is no more."""
    try:
        yield
    except (EOFError, ConnectionError):
        words = 'its own error is above. A script that calls this needs `if __name__ == "__main__":`'
        raise RefusedError(f"a process that flew ended: {words}") from None


@contextmanager
def _processes(do: Callable[[S], T], count: int) -> Iterator[list[Connection]]:
    """Yield the pipes of so many processes, which end with the block, whatever they do then.

    Ctrl-C is blocked in them: a terminal sends it to all, and this process ends the others.
    """
    spawn, pipes = get_context("spawn"), []
    resource_tracker.ensure_running()  # it unblocks Ctrl-C when it starts
    with ExitStack() as left:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            for _ in range(count):
                own, of_process = spawn.Pipe()
                with of_process:
                    arguments = of_process, do, code_folder()
                    process = spawn.Process(target=_serve, args=arguments, daemon=True)
                    process.start()
                left.callback(_end, process, own)
                pipes.append(own)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield pipes


def _end(process: SpawnProcess, pipe: Connection) -> None:
    process.kill()
    process.join()
    pipe.close()


def _serve(pipe: Connection, do: Callable[[Any], Any], folder: str) -> None:
    """Do the runs whose numbers a pipe brings after them, until it is closed."""
    if folder:
        allow_code(Path(folder))
    with suppress(EOFError, ConnectionError):
        runs = pipe.recv()
        while True:
            number = pipe.recv()
            pipe.send((number, _done_or_refused(do, runs[number])))


def _done_or_refused(do: Callable[[S], T], run: S) -> T | GcsError:
    try:
        return do(run)
    except GcsError as error:
        return error
