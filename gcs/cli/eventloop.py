"""An event loop with exact wake-ups: asyncio's own rounds every wait up to whole milliseconds."""

import asyncio
import select
import selectors
import sys
from collections.abc import Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


def run(main: Coroutine[Any, Any, T]) -> T:
    """As `asyncio.run`, on such a loop when the platform supports it."""
    with asyncio.Runner(loop_factory=_loop) as runner:
        return runner.run(main)


if sys.platform == "linux":

    class _ExactSelector(selectors.EpollSelector):
        """Waits with `select`, whose timeout is in microseconds, for epoll, whose own is in milliseconds."""

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            if timeout is not None and timeout > 0:
                select.select((self.fileno(),), (), (), timeout)
                timeout = 0
            return super().select(timeout)

    def _loop() -> asyncio.AbstractEventLoop:
        return asyncio.SelectorEventLoop(_ExactSelector())

else:

    def _loop() -> asyncio.AbstractEventLoop:
        return asyncio.new_event_loop()
