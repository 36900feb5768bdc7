"""All ports of a link: beside UDP, streams. They arrive cut anywhere, and are sent frame by frame."""

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import inf
from selectors import EVENT_READ, BaseSelector, DefaultSelector
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.links.endpoints.channels import Channel, Dial, SerialDial, SocketChannel, TcpDial, listen
from gcs.links.endpoints.ports import Datagrams, host_number, socket_of, source_of, why_closed
from gcs.links.endpoints.udp import TURN_S, UdpPorts
from gcs.links.link import Address
from gcs.links.settings import Place, SerialPort, TcpIn, TcpOut
from gcs.mavlink.kernels import LONGEST_FRAME, Bytes, Whole
from gcs.model.errors import LinkError

log = logging.getLogger(__name__)

RETRY_S: Final = 1.0

_READ_BYTES: Final = 4096
_READS_PER_CALL: Final = 64
"""Of all connections together, of each at least one: the rest waits for the next call, held back by TCP."""

_SHARE_LEAST_S: Final = 0.001
_TEND_PERIOD_S: Final = 0.02
_SETPOINT_DELAY_S: Final = 0.05
_STALL_S: Final = 0.05
_CONNECTIONS_MAX: Final = 256


class Stream:
    """One open channel."""

    def __init__(self, channel: Channel, source: int, now_s: float) -> None:
        self.source = source
        self._channel = channel
        self.fileno, self.close = channel.fileno, channel.close
        self._half_sent = b""
        self._looked_s = now_s
        self._unread = False

    def read(self, now_s: float, reads: int) -> Iterator[tuple[bytes, float]]:
        """What has arrived, cut anywhere, and its time. Raises: OSError when the stream has ended.

        A stream has no times of arrival. Data read after the loop was blocked counts as old as it may be.
        The caller may stop iterating: the next call reads the rest.
        """
        time_s = now_s if now_s - self._looked_s < _STALL_S else self._looked_s
        self._unread = True  # until read empty
        for _ in range(reads):
            try:
                data = self._channel.read(_READ_BYTES)
            except BlockingIOError:
                self._unread, self._looked_s = False, now_s
                return
            if not data:
                raise ConnectionError("ended by the far end")
            yield data, time_s

    def send(self, data: bytes, *, waits: bool) -> None:
        """Send a frame, whole or not at all; one that does not wait is not sent behind a backlog.

        Raises: BlockingIOError when there is no room; OSError.
        """
        self._finish_half_sent()
        if self._half_sent or not (waits or self._channel.delay_s() <= _SETPOINT_DELAY_S):
            raise BlockingIOError("no room")
        self._half_sent = data[self._channel.write(data) :]

    def tend(self, now_s: float) -> None:
        """Continue a frame sent in part. After the selector was queried: nothing else is left to read.

        Raises: OSError when the stream has ended.
        """
        if not self._unread:
            self._looked_s = now_s
        self._finish_half_sent()

    def _finish_half_sent(self) -> None:
        if self._half_sent:
            try:
                self._half_sent = self._half_sent[self._channel.write(self._half_sent) :]
            except BlockingIOError:
                return


class StreamPort:
    """The streams of one port of ours, and the addresses whose stream has ended."""

    def __init__(self, name: str, address_of: Callable[[int], Address]) -> None:
        self.streams: dict[int, Stream] = {}
        self.gone: list[int] = []
        self._name = name
        self._address_of = address_of
        self._selector: BaseSelector | None = None

    def open(self, selector: BaseSelector, now_s: float) -> None:  # noqa: ARG002
        """Open the port. Raises: LinkError when that fails for another reason than a missing far end."""
        self._selector = selector

    def close(self) -> None:
        for source in tuple(self.streams):
            self.end(source, "closed", 0.0, level=logging.INFO)
        self._selector = None

    def tend(self, now_s: float) -> None:
        """Continue frames sent in part, and connect again. To be called about 50 times a second."""
        for source, stream in tuple(self.streams.items()):
            try:
                stream.tend(now_s)
            except OSError as error:
                self.end(source, str(error), now_s)

    def read(self, source: int, now_s: float, reads: int) -> Iterator[tuple[bytes, float]]:
        """See `Stream.read`; a stream that has ended is closed."""
        try:
            yield from self.streams[source].read(now_s, reads)
        except OSError as error:
            self.end(source, str(error), now_s)

    def begin(self, channel: Channel, source: int, now_s: float) -> None:
        stream = self.streams[source] = Stream(channel, source, now_s)
        if self._selector is not None:
            self._selector.register(stream, EVENT_READ, (self, source))
        self.log(logging.INFO, "connected", source)

    def end(self, source: int, cause: str, now_s: float, level: int = logging.WARNING) -> None:  # noqa: ARG002
        stream = self.streams.pop(source, None)
        if stream is None:
            return
        if self._selector is not None:
            self._selector.unregister(stream)
        stream.close()
        self.gone.append(source)
        self.log(level, "connection_lost", source, cause)

    def log(self, level: int, event: str, source: int, cause: str = "") -> None:
        about = {"link": self._name, "address": str(self._address_of(source))}
        log.log(level, event, extra=about | ({"cause": cause} if cause else {}))


class Redialled(StreamPort):
    """A TCP client, or a serial port that may be unplugged: opened again whenever it ends."""

    def __init__(self, name: str, address_of: Callable[[int], Address], source: int, dial: Dial) -> None:
        super().__init__(name, address_of)
        self._source = source
        self._dial = dial
        self._retry_s = 0.0
        self._failed = False

    def open(self, selector: BaseSelector, now_s: float) -> None:
        super().open(selector, now_s)
        self._retry_s, self._failed = now_s, False
        self.tend(now_s)

    def close(self) -> None:
        self._dial.cancel()
        super().close()

    def tend(self, now_s: float) -> None:
        super().tend(now_s)
        if self.streams or now_s < self._retry_s:
            return
        try:
            channel = self._dial(now_s)
        except OSError as error:
            self._retry_s = now_s + RETRY_S
            if not self._failed:
                self._failed = True
                self.log(logging.WARNING, "cannot_connect", self._source, str(error))
            return
        if channel is not None:
            self._failed = False
            self.begin(channel, self._source, now_s)

    def end(self, source: int, cause: str, now_s: float, level: int = logging.WARNING) -> None:
        super().end(source, cause, now_s, level)
        self._retry_s = now_s + RETRY_S


class TcpServer(StreamPort):
    """A listening port and all connections to it."""

    def __init__(self, name: str, address_of: Callable[[int], Address], index: int, at: TcpIn) -> None:
        super().__init__(name, address_of)
        self._index = index
        self._at = at

    def open(self, selector: BaseSelector, now_s: float) -> None:
        """Listen. Raises: LinkError naming the port."""
        super().open(selector, now_s)
        try:
            self._listening = listen(self._at.host, self._at.port)
        except (OSError, OverflowError) as error:
            text = f"{self._name}: TCP port {self._at.port} on {self._at.host}: {why_closed(error)}"
            raise LinkError(text) from error
        selector.register(self._listening, EVENT_READ, (self, None))

    def close(self) -> None:
        selector = self._selector
        super().close()
        if selector is not None and hasattr(self, "_listening"):
            selector.unregister(self._listening)
            self._listening.close()
            del self._listening

    def accept(self, now_s: float) -> None:
        try:
            connected, (host, port) = self._listening.accept()
        except OSError:  # ended again, or no file descriptor is left: the client tries again
            return
        if len(self.streams) >= _CONNECTIONS_MAX:
            connected.close()
            return
        source = source_of(host_number(host), port, self._index)
        self.end(source, "connected again", now_s)
        self.begin(SocketChannel(connected), source, now_s)


class LinkPorts(UdpPorts):
    """UDP, TCP and serial ports. UDP ports come first in the numbering of ports, in the order of `places`."""

    def __init__(
        self,
        name: str,
        places: Place | Sequence[Place],
        clock: Callable[[], float],
        *,
        replace_busy: bool = False,
    ) -> None:
        super().__init__(name, places, clock, replace_busy=replace_busy)
        self._first = self.udp_count
        self._devices: dict[int, str] = {}
        self._streams: list[StreamPort] = []
        for place in places if isinstance(places, Sequence) else (places,):
            index = self._first + len(self._streams)
            match place:
                case TcpIn():
                    self._streams.append(TcpServer(name, self.address, index, place))
                case TcpOut(host, port):
                    source = source_of(host_number(host), port, index)
                    self._streams.append(Redialled(name, self.address, source, TcpDial(host, port)))
                case SerialPort(device, baud):
                    self._devices[index] = device
                    source = source_of(0, 0, index)
                    self._streams.append(Redialled(name, self.address, source, SerialDial(device, baud)))
        self._stream_selector: BaseSelector | None = None
        self._tend_s = -inf

    def open(self) -> None:
        super().open()
        self._stream_selector = DefaultSelector()
        for each in self._streams:
            try:
                each.open(self._stream_selector, self._clock())
            except LinkError as error:
                if not self._replace_busy:
                    self.close()
                    raise
                self.problems.append(str(error))

    def close(self) -> None:
        super().close()
        for each in self._streams:
            each.close()
        if self._stream_selector is not None:
            self._stream_selector.close()
            self._stream_selector = None

    def receive(self, take: Callable[[Datagrams], None]) -> None:
        super().receive(take)
        if not self._streams or self._stream_selector is None:
            return
        now_s = self._clock()
        self._read_streams(self._stream_selector, now_s, take)
        if now_s >= self._tend_s:
            self._tend_s = now_s + _TEND_PERIOD_S
            for each in self._streams:
                each.tend(now_s)

    def send(
        self, data: Bytes, length: Whole, destination: Whole, *, until_s: float = inf
    ) -> NDArray[np.bool_]:
        left = super().send(data, length, destination, until_s=until_s)
        if not self._streams or self._stream_selector is None:
            return left
        for at in np.flatnonzero(destination >> 48 >= self._first).tolist():
            # Check again right before every call: the process may have been suspended since the last check.
            if self._clock() > until_s:
                break
            left[at] = self._send_stream(int(destination[at]), data[at, : length[at]].tobytes(), until_s)
        return left

    def standing(self) -> Iterable[int]:
        """The far ends of UDP, and all connections: a vehicle may wait for the first frame."""
        return (*super().standing(), *(source for each in self._streams for source in each.streams))

    def gone(self) -> Sequence[int]:
        gone: list[int] = []
        for each in self._streams:
            if each.gone:
                gone += each.gone
                each.gone = []
        for source in gone:
            self.failures.pop(source, None)
        return gone

    def address(self, source: int) -> Address:
        device = self._devices.get(socket_of(source))
        return super().address(source) if device is None else Address(device, 0, socket_of(source))

    def _send_stream(self, destination: int, data: bytes, until_s: float) -> bool:
        stream = self._streams[socket_of(destination) - self._first].streams.get(destination)
        try:
            if stream is None:
                raise ConnectionError("not connected")
            stream.send(data, waits=until_s == inf)
        except OSError as error:
            self._note_failure(destination, error)
            return False
        return True

    def _read_streams(self, selector: BaseSelector, now_s: float, take: Callable[[Datagrams], None]) -> None:
        ready = selector.select(0)
        share_s = max(TURN_S / max(len(ready), 1), _SHARE_LEAST_S)
        reads = max(_READS_PER_CALL // max(len(ready), 1), 1)
        arrived: list[tuple[bytes, int, float]] = []
        for key, _ in ready:
            port, source = key.data
            if source is None:
                port.accept(now_s)
                continue
            until_s = self._clock() + share_s
            for part, time_s in port.read(source, now_s, reads):
                arrived.append((part, source, time_s))
                if self._clock() > until_s:
                    break
        if not arrived:
            return
        parts, sources, times_s = zip(*arrived, strict=True)
        length = np.array([len(part) for part in parts], np.int64)
        room = bytes(LONGEST_FRAME)
        data = np.frombuffer(bytearray(room) + room.join(parts), np.uint8)
        start = np.cumsum(length + LONGEST_FRAME) - length
        take(Datagrams(data, start, length, np.array(sources, np.int64), np.array(times_s), LONGEST_FRAME))
