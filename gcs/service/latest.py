"""The newest value of something, for many readers."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """The newest value of something, for any number of readers, none of whom can delay the writer."""

    def __init__(self, value: T) -> None:
        self._value = value
        self._make: Callable[[], T] | None = None
        self._changed = asyncio.Event()

    @property
    def value(self) -> T:
        """The newest."""
        make, self._make = self._make, None
        if make is not None:
            self._value = make()
        return self._value

    def set(self, value: T) -> None:
        """Replace it and wake everybody who waits."""
        self._value, self._make = value, None
        self._wake()

    def promise(self, make: Callable[[], T]) -> None:
        """The same, but the value is made only when somebody looks: most of them nobody looks at."""
        self._make = make
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def changed(self) -> None:
        """Return with the next change."""
        await self._changed.wait()

    async def values(self) -> AsyncIterator[T]:
        """The value now, then the newest after each change; a slow reader misses those between."""
        while True:
            changed = self._changed  # taken first, so that no change is missed
            yield self.value
            await changed.wait()
