"""A byte stream that carries frames: put together on the way in, whole or not at all on the way out."""

from collections.abc import Iterator
from threading import Lock
from typing import Final, Protocol

from gcs.links.address_book import Address
from gcs.links.endpoints.endpoint import Arrival
from gcs.mavlink.framing import split_stream

_READ_BYTES: Final = 4096
_READS_PER_CALL: Final = 64
_GARBAGE_PER_CALL_BYTES: Final = 2048
_PERISHABLE_DELAY_S: Final = 0.05
_STALL_S: Final = 0.05


class Channel(Protocol):
    """An open file or socket that never blocks. Every method but `close` raises OSError when it has ended."""

    def fileno(self) -> int:
        """For the selector."""
        ...

    def read(self, size: int) -> bytes:
        """What has come, up to `size`. Raises: BlockingIOError when nothing has."""
        ...

    def write(self, data: bytes) -> int:
        """How much of `data` was taken. Raises: BlockingIOError when nothing was."""
        ...

    def delay_s(self) -> float:
        """How long what is written now would wait behind what was written before."""
        ...

    def close(self) -> None:
        """Throw away what was not sent, and end."""
        ...


class Stream:
    """One channel and its frames. `read` belongs to the loop's thread, the others to any."""

    def __init__(self, channel: Channel, address: Address, now_s: float) -> None:
        """Take over an open channel."""
        self.address = address
        self._channel = channel
        self._lock = Lock()
        self._closed = False
        self._arrived = b""
        self._half_sent = b""
        self._looked_s = now_s
        self._unread = False

    def fileno(self) -> int:
        """For the selector."""
        return self._channel.fileno()

    def read(self, now_s: float) -> Iterator[Arrival]:
        """Take in what has come. Raises: OSError when the stream has ended.

        A stream has no dates of arrival. What comes after the loop stood still counts as old as it may be.
        """
        time_s = now_s if now_s - self._looked_s < _STALL_S else self._looked_s
        garbage_bytes = 0
        self._unread = True  # until seen empty
        for _ in range(_READS_PER_CALL):
            try:
                data = self._channel.read(_READ_BYTES)
            except BlockingIOError:
                self._unread, self._looked_s = False, now_s
                return
            if not data:
                raise ConnectionError("ended by the far end")
            parts, self._arrived = split_stream(self._arrived + data)
            yield Arrival(self.address, parts, time_s)
            garbage_bytes += parts.garbage_bytes + parts.unknown_bytes
            if garbage_bytes > _GARBAGE_PER_CALL_BYTES:
                return

    def looked(self, now_s: float) -> None:
        """The selector has been asked: there is nothing to read but what was left unread."""
        if not self._unread:
            self._looked_s = now_s

    def send(self, data: bytes, *, perishable: bool) -> None:
        """Send a frame, whole or not at all. Raises: BlockingIOError for want of room; OSError."""
        with self._lock:
            if self._closed:
                raise ConnectionError("closed")
            self._finish_half_sent()
            if self._half_sent or (perishable and self._channel.delay_s() > _PERISHABLE_DELAY_S):
                raise BlockingIOError("no room")
            self._half_sent = data[self._channel.write(data) :]

    def flush(self) -> None:
        """Go on with a frame half sent. Raises: OSError when the stream has ended."""
        with self._lock:
            if not self._closed:
                self._finish_half_sent()

    def close(self) -> None:
        """End."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._channel.close()

    def _finish_half_sent(self) -> None:
        if self._half_sent:
            try:
                self._half_sent = self._half_sent[self._channel.write(self._half_sent) :]
            except BlockingIOError:
                return
