"""Virtual time: an event loop, a Unix clock, and an executor that works at once."""

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor, Future
from contextlib import closing
from typing import Any, TypeVar

import async_solipsism

T = TypeVar("T")


class UnixClock:
    """The Unix clock, which can be set wrong."""

    def __init__(self) -> None:
        self.ahead_s = 1_700_000_000.0  # of the loop's

    def __call__(self) -> float:
        return asyncio.get_running_loop().time() + self.ahead_s


class AtOnce(Executor):
    """Runs each job at once: in virtual time this takes no time and is deterministic.

    Attributes:
        instead: takes the place of this executor when a story sets it.
    """

    instead: Executor | None = None

    def submit(self, work: Callable[..., T], /, *given: Any, **named: Any) -> Future[T]:
        if self.instead is not None:
            return self.instead.submit(work, *given, **named)
        done: Future[T] = Future()
        done.set_result(work(*given, **named))
        return done


class Loop:
    """An event loop whose clock jumps to the next event. Between two runs its tasks stand still."""

    def __init__(self) -> None:
        self._runner = asyncio.Runner(loop_factory=async_solipsism.EventLoop)

    def play(self, story: Awaitable[T]) -> T:
        """Run until the story ends. Returns: its result."""
        reported: list[T] = []

        async def main() -> None:
            reported.append(await story)  # not returned: the runner puts a result into words, for seconds

        self._runner.run(main())
        return reported[0]

    def close(self) -> None:
        """Cancel every task."""
        self._runner.close()


def run_virtual(story: Callable[[], Awaitable[T]]) -> T:
    """Run on an event loop whose clock jumps to the next event."""
    with closing(Loop()) as loop:
        return loop.play(story())
