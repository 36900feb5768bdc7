"""One stream to one far end, reopened whenever it ends."""

import logging
from collections.abc import Iterator
from selectors import EVENT_READ, BaseSelector
from typing import Final, Protocol

from gcs.links.address_book import Address
from gcs.links.endpoints.endpoint import Arrival
from gcs.links.endpoints.stream import Channel, Stream

log = logging.getLogger(__name__)

RETRY_S: Final = 1.0


class Dial(Protocol):
    """Opens a channel without waiting for it."""

    def __call__(self, now_s: float) -> Channel | None:
        """The channel, or None while it takes longer: call again. Raises: OSError when it cannot open."""
        ...

    def cancel(self) -> None:
        """Abandon the attempt."""
        ...


class Redialled:
    """A TCP client, or a serial port that may be unplugged. An `Endpoint`."""

    def __init__(self, name: str, address: Address, dial: Dial) -> None:
        """`name` is the link's, for logs."""
        self._name = name
        self._address = address
        self._dial = dial
        self._selector: BaseSelector | None = None
        self._stream: Stream | None = None
        self._retry_s = 0.0
        self._failed = False
        self._gone: list[Address] = []

    @property
    def standing(self) -> tuple[Address, ...]:
        """The far end, while connected."""
        return () if self._stream is None else (self._address,)

    def open(self, selector: BaseSelector, now_s: float) -> None:
        """Begin to connect; a missing far end shows later."""
        self._selector, self._retry_s, self._failed = selector, now_s, False
        self.tend(now_s)

    def close(self) -> None:
        self._dial.cancel()
        self._drop()
        self._selector = None

    def tend(self, now_s: float) -> None:
        """Continue a frame sent in part, or reconnect."""
        if self._stream is not None:
            self._stream.looked(now_s)
            try:
                self._stream.flush()
            except OSError as error:
                self._lose(error, now_s)
        elif self._selector is not None and now_s >= self._retry_s:
            self._open_again(self._selector, now_s)

    def gone(self) -> tuple[Address, ...]:
        """The far end, if its connection has ended since the last call."""
        gone, self._gone = tuple(self._gone), []
        return gone

    def send(self, data: bytes, address: Address, *, perishable: bool) -> None:  # noqa: ARG002
        """Send one frame. Raises: OSError."""
        stream = self._stream
        if stream is None:
            raise ConnectionError("not connected")
        stream.send(data, perishable=perishable)

    def _open_again(self, selector: BaseSelector, now_s: float) -> None:
        try:
            channel = self._dial(now_s)
        except OSError as error:
            self._retry_s = now_s + RETRY_S
            if not self._failed:
                self._failed = True
                about = {"link": self._name, "address": str(self._address), "cause": str(error)}
                log.warning("cannot_connect", extra=about)
            return
        if channel is not None:
            stream = Stream(channel, self._address, now_s)
            selector.register(stream, EVENT_READ, self._read)
            self._stream, self._failed = stream, False
            log.info("connected", extra={"link": self._name, "address": str(self._address)})

    def _read(self, now_s: float) -> Iterator[Arrival]:
        if self._stream is None:
            return
        try:
            yield from self._stream.read(now_s)
        except OSError as error:
            self._lose(error, now_s)

    def _lose(self, error: OSError, now_s: float) -> None:
        self._drop()
        self._gone.append(self._address)
        self._retry_s = now_s + RETRY_S
        about = {"link": self._name, "address": str(self._address), "cause": str(error)}
        log.warning("connection_lost", extra=about)

    def _drop(self) -> None:
        stream, self._stream = self._stream, None
        if stream is not None:
            if self._selector is not None:
                self._selector.unregister(stream)
            stream.close()
