"""Virtual time: an event loop with processes, a Unix clock, and an executor that works at once."""

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import Executor, Future
from contextlib import closing
from contextvars import Context, ContextVar, copy_context
from typing import Any, Final, TypeVar

import async_solipsism
from async_solipsism.selector import Selector

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


_PROCESS: ContextVar[str] = ContextVar("process", default="")


def as_process(name: str) -> Context:
    """A context for `create_task`: the task, and every task that it creates, belongs to that process."""
    context = copy_context()
    context.run(_PROCESS.set, name)
    return context


LONGEST_S: Final = 3600.0
"""A longer wait is left to async_solipsism, which refuses those without end."""


class ClockSelector(Selector):  # type: ignore[misc] # it has no types
    """Advances the clock at once, and looks at sockets only where there are some."""

    def select(self, timeout: float | None = None) -> list[Any]:
        if self._fd_to_key or timeout is None or timeout > LONGEST_S:
            ready: list[Any] = super().select(timeout)
            return ready
        if timeout > 0.0:
            self.clock.advance(timeout)
        return []


class ProcessLoop(async_solipsism.EventLoop):  # type: ignore[misc] # it has no types
    """An event loop in which processes stand still, as one does between SIGSTOP and SIGCONT."""

    _selector: Any

    def __init__(self) -> None:
        super().__init__()
        self._selector = ClockSelector(self._selector.clock)
        self.time = self._selector.clock.time  # asked for 45 times a tick
        self._stopped: dict[str, list[tuple[Context, Callable[..., Any], tuple[Any, ...]]]] = {}

    def stop_process(self, name: str) -> None:
        """Run nothing of that process until `continue_process`."""
        self._stopped[name] = []

    def continue_process(self, name: str) -> None:
        """Run at once what was due meanwhile, in its order."""
        for context, callback, args in self._stopped.pop(name):
            self.call_soon(callback, *args, context=context)

    def call_soon(
        self, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        context = copy_context() if context is None else context
        if context.get(_PROCESS):
            callback, args = self._unless_stopped, (context, callback, args)
        handle: asyncio.Handle = super().call_soon(callback, *args, context=context)
        return handle

    def call_at(
        self, when: float, callback: Callable[..., Any], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        context = copy_context() if context is None else context
        now_s = self.time()
        when = now_s if now_s < when < now_s + self._clock_resolution else when  # the clock cannot go there
        if context.get(_PROCESS):
            callback, args = self._unless_stopped, (context, callback, args)
        handle: asyncio.TimerHandle = super().call_at(when, callback, *args, context=context)
        return handle

    def _unless_stopped(self, context: Context, callback: Callable[..., Any], args: tuple[Any, ...]) -> None:
        stopped = self._stopped.get(context[_PROCESS])
        if stopped is None:
            callback(*args)
        else:
            stopped.append((context, callback, args))


class VirtualLoop:
    """An event loop whose clock jumps to the next event. Between two runs its tasks stand still."""

    def __init__(self) -> None:
        self._runner = asyncio.Runner(loop_factory=ProcessLoop)

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
    with closing(VirtualLoop()) as loop:
        return loop.play(story())
