"""A byte stream of frames: reassembled when received, sent whole or not at all."""

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
        """Read what has arrived, up to `size`. Raises: BlockingIOError when there is nothing."""
        ...

    def write(self, data: bytes) -> int:
        """Number of bytes of `data` accepted. Raises: BlockingIOError when none were."""
        ...

    def delay_s(self) -> float:
        """How long data written now would wait behind data written before."""
        ...

    def close(self) -> None:
        """Discard what was not sent, and close."""
        ...


class Stream:
    """One channel and its frames. `read` is for the loop's thread, the other methods for any."""

    def __init__(self, channel: Channel, address: Address, now_s: float) -> None:
        """Use an open channel."""
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
        """Read what has arrived. Raises: OSError when the stream has ended.

        A stream has no times of arrival. Data read after the loop was blocked counts as old as it may be.
        """
        time_s = now_s if now_s - self._looked_s < _STALL_S else self._looked_s
        garbage_bytes = 0
        self._unread = True  # until read empty
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
        """The selector was queried: nothing is left to read except data left unread."""
        if not self._unread:
            self._looked_s = now_s

    def send(self, data: bytes, *, perishable: bool) -> None:
        """Send a frame, whole or not at all. Raises: BlockingIOError when there is no room; OSError."""
        with self._lock:
            if self._closed:
                raise ConnectionError("closed")
            self._finish_half_sent()
            if self._half_sent or (perishable and self._channel.delay_s() > _PERISHABLE_DELAY_S):
                raise BlockingIOError("no room")
            self._half_sent = data[self._channel.write(data) :]

    def flush(self) -> None:
        """Continue a frame sent in part. Raises: OSError when the stream has ended."""
        with self._lock:
            if not self._closed:
                self._finish_half_sent()

    def close(self) -> None:
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
