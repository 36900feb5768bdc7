"""The newest value of something, for many readers."""

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """The newest value of something, for any number of readers that cannot delay the writer."""

    def __init__(self, value: T) -> None:
        self._value = value
        self._make: Callable[[], T] | None = None
        self._changed = asyncio.Event()

    @property
    def value(self) -> T:
        """The newest value."""
        make, self._make = self._make, None
        if make is not None:
            self._value = make()
        return self._value

    def set(self, value: T) -> None:
        """Replace the value and wake all waiting readers."""
        self._value, self._make = value, None
        self._wake()

    def promise(self, make: Callable[[], T]) -> None:
        """Set a value that is computed on the first read: most values are never read."""
        self._make = make
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    async def changed(self) -> None:
        """Return with the next change."""
        await self._changed.wait()

    async def values(self) -> AsyncIterator[T]:
        """Yield the value now, then the newest after each change; a slow reader misses those between."""
        while True:
            changed = self._changed  # taken first, so that no change is missed
            yield self.value
            await changed.wait()
