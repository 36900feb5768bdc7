"""Many datagrams with one system call: sendmmsg and recvmmsg of Linux, through ctypes.

The structures are the C library's, seen as numpy arrays. Compiled loops fill and read them.
"""

import ctypes
import errno
import os
import socket
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.kernels import Bytes, Whole
from gcs.model.jit import kernel
from gcs.model.state import Array

Field: TypeAlias = NDArray[Any]
"""(count,) whole numbers: one field of a C structure in every row."""

SO_TIMESTAMPNS: Final = 35  # Linux; Python does not name it

_UDP_SEGMENT: Final = 103  # Linux 4.18; Python does not name it

_RUN_MOST: Final = 64
"""Most datagrams that the kernel splits from one piece."""

_ERRORS: Final = 16
"""Errors of earlier sends that a socket may report before a read."""

REFUSALS: Final = frozenset({errno.EIO, errno.EINVAL, errno.EMSGSIZE, errno.EOPNOTSUPP})
"""Errors of a route without runs: it has no checksums of its own, or its packets are too small."""

_ADDRESS: Final = np.dtype([("family", "=u2"), ("port", ">u2"), ("host", ">u4"), ("zero", "V8")])
"""struct sockaddr_in."""


def _aligned(**fields: str | np.dtype[np.void]) -> np.dtype[np.void]:
    return np.dtype(list(fields.items()), align=True)


_HEADER: Final = _aligned(
    name="P", name_length="u4", parts="P", part_count="P", control="P", control_length="P", flags="i4"
)
"""struct msghdr; pointers and size_t as integers of that size."""

_MESSAGE: Final = _aligned(header=_HEADER, length="u4")
"""struct mmsghdr."""

_PART: Final = _aligned(base="P", length="P")
"""struct iovec."""

_CONTROL: Final = _aligned(length="P", level="i4", kind="i4", seconds="l", nanoseconds="l")
"""struct cmsghdr with a timespec."""

_SEGMENT: Final = _aligned(length="P", level="i4", kind="i4", bytes="u2")
"""struct cmsghdr with the length of a run's datagrams."""

_ADDRESS_LENGTH: Final = _ADDRESS.itemsize
_CONTROL_LENGTH: Final = _CONTROL.itemsize
_SEGMENT_LENGTH: Final = _SEGMENT.itemsize
_SOCKET: Final = int(socket.SOL_SOCKET)
_STAMP: Final = SO_TIMESTAMPNS

_LIBC: Final[Any] = ctypes.CDLL(None, use_errno=True)


def sends_runs(source: socket.socket) -> bool:
    """Whether the kernel accepts many datagrams for one destination as one piece, and splits them itself."""
    try:
        source.setsockopt(socket.IPPROTO_UDP, _UDP_SEGMENT, 0)  # 0: each run states its own length
    except OSError:
        return False
    return True


class Batch:
    """Memory for a number of datagrams, in or out, and the C structures that point to it.

    Attributes:
        data: (count, headroom + longest) bytes of each, behind the headroom.
        length: (count,) of each.
        host, port: (count,) IPv4 addresses as numbers.
        time_s: (count,) the kernel's wall-clock time of arrival, NaN where it gave none.
    """

    def __init__(self, count: int, longest: int, headroom: int = 0) -> None:
        self.data: Bytes = np.zeros((count, headroom + longest), np.uint8)
        self._longest = longest
        self.length: Whole = np.zeros(count, np.int64)
        self.time_s = np.full(count, np.nan)
        self._addresses = np.zeros(count, _ADDRESS)
        self.host, self.port = self._addresses["host"], self._addresses["port"]
        self._parts = np.zeros(count, _PART)
        self._control = np.zeros(count, _CONTROL)
        self._messages = np.zeros(count, _MESSAGE)
        self._runs = np.zeros(count, _MESSAGE)
        self._segments = np.zeros(count, _SEGMENT)
        self._addresses["family"] = socket.AF_INET
        self._parts["base"] = _places(self.data) + np.uint64(headroom)
        self._part_length = self._parts["length"]
        for messages in (self._messages, self._runs):
            messages["header"]["name_length"] = _ADDRESS.itemsize
        headers, runs = self._messages["header"], self._runs["header"]
        headers["name"], headers["parts"] = _places(self._addresses), _places(self._parts)
        headers["part_count"] = 1
        self._receives = False  # a batch is only received into, or only sent from
        self._segments["length"] = socket.CMSG_LEN(2)
        self._segments["level"], self._segments["kind"] = socket.IPPROTO_UDP, _UDP_SEGMENT
        self._address_bytes = self._addresses.view(np.uint8).reshape(count, _ADDRESS.itemsize)
        control = self._control
        self._received = (
            *(headers["name_length"], headers["control_length"], self._messages["length"]),
            *(control["length"], control["level"], control["kind"]),
            *(control["seconds"], control["nanoseconds"], self.length, self.time_s),
        )
        self._described = (
            *(headers["name"], headers["parts"], _places(self._segments), self._segments["bytes"]),
            *(runs["name"], runs["parts"], runs["part_count"], runs["control"], runs["control_length"]),
        )
        self._message_places, self._run_place = _places(self._messages), int(_places(self._runs)[0])
        nothing = np.zeros(0, np.int64)  # compiles or loads the kernels now, not in flight
        _take(0, 0, *self._received)
        self.put(self.data[:0], nothing, nothing)
        self.arrivals(nothing, 0.0, 0.0, self.time_s[:0])
        _describe_runs(0, 0, self._address_bytes, self.length, *self._described)

    def receive(self, fd: int, first: int, most: int) -> int:
        """Read datagrams into row `first` and the following rows. Returns: number; never waits.

        Raises: OSError; BlockingIOError when there is nothing to read.
        """
        if not self._receives:
            self._receives = True
            self._parts["length"] = self._longest
            headers = self._messages["header"]
            headers["control"], headers["control_length"] = _places(self._control), _CONTROL_LENGTH
        count = _call(_LIBC.recvmmsg, fd, int(self._message_places[first]), most, None)
        _take(first, first + count, *self._received)
        return count

    def read(self, fd: int, first: int, most: int) -> int:
        """As `receive`, after errors of earlier sends, which a socket reports here; 0: nothing to read."""
        for _ in range(_ERRORS):
            try:
                return self.receive(fd, first, most)
            except BlockingIOError:
                return 0
            except OSError:  # the socket still works
                continue
        return 0

    def arrivals(self, index: Whole, now_s: float, wall_s: float, drained_s: Array) -> tuple[Whole, Array]:
        """Where the datagrams of the first rows came from, and when.

        Args:
            index: (n,) the socket of ours that received each.
            now_s: when they were read, on our clock.
            wall_s: the same on the wall clock, which stamps them.
            drained_s: (s,) when each socket was last empty.

        Returns: (n,) of `source_of`; (n,) arrival of each, after `drained_s` and not after `now_s`.
        """
        return _arrivals(index, self._address_bytes, self.time_s, now_s, wall_s, drained_s)

    def put(self, data: Bytes, length: Whole, destination: Whole) -> Whole:
        """Write datagrams to the first rows, to be sent: (n, longest), (n,), and (n,) of `source_of`.

        Returns: (c,) rows that leave through another socket than those before.
        """
        room = self.data, self.length, self._part_length, self._address_bytes
        return _put(data, length, destination, *room)

    def send(self, fd: int, first: int, end: int) -> int:
        """Send rows `first` to `end` - 1, in order. Returns: number of rows sent; never waits.

        Raises: OSError when the first of them could not be sent.
        """
        return _call(_LIBC.sendmmsg, fd, int(self._message_places[first]), end - first)

    def send_runs(self, fd: int, first: int, end: int) -> int:
        """As `send`; neighbours of equal length and destination cost the kernel little more than one."""
        runs = _describe_runs(first, end, self._address_bytes, self.length, *self._described)
        done = _call(_LIBC.sendmmsg, fd, self._run_place, runs)
        if done == runs:
            return end - first
        return int(self._runs["header"]["part_count"][:done].sum())


def _places(rows: NDArray[Any]) -> NDArray[np.uint64]:
    """(n,) address of each row in memory."""
    return np.uint64(rows.ctypes.data) + np.arange(len(rows), dtype=np.uint64) * np.uint64(rows.strides[0])


def _call(function: Any, fd: int, place: int, count: int, *more: object) -> int:
    """Result of sendmmsg or recvmmsg with `count` messages at `place` in memory. Raises: OSError."""
    done: int = function(fd, ctypes.c_void_p(place), ctypes.c_uint(count), 0, *more)
    if done < 0:
        number = ctypes.get_errno()
        if number in (errno.EAGAIN, errno.EWOULDBLOCK):
            raise BlockingIOError(number, os.strerror(number))
        raise OSError(number, os.strerror(number))
    return done


@kernel
def _take(
    first: int,
    end: int,
    name_room: Field,
    control_room: Field,
    message_length: Field,
    control_length: Field,
    level: Field,
    kind: Field,
    seconds: Field,
    nanoseconds: Field,
    length: Whole,
    time_s: Array,
) -> None:
    """Read what the kernel wrote of rows `first` to `end` - 1 into `length` and `time_s`.

    The other arguments are fields of the C structures, by row; those that recvmmsg changes, and reads again
    when it next writes the row, are as before it.
    """
    for row in range(first, end):
        length[row] = message_length[row]
        stamped = control_length[row] >= _CONTROL_LENGTH and level[row] == _SOCKET and kind[row] == _STAMP
        time_s[row] = seconds[row] + nanoseconds[row] * 1e-9 if stamped else np.nan
        name_room[row], control_room[row], control_length[row] = _ADDRESS_LENGTH, _CONTROL_LENGTH, 0


@kernel
def _arrivals(
    index: Whole, address: Bytes, stamp_s: Array, now_s: float, wall_s: float, drained_s: Array
) -> tuple[Whole, Array]:
    """As `Batch.arrivals`; (count, 16) addresses as of `_put`, (count,) stamps of the wall clock, or NaN."""
    source, time_s = np.empty(len(index), np.int64), np.empty(len(index))
    for row in range(len(index)):
        place = index[row]
        for byte in (4, 5, 6, 7, 2, 3):
            place = place << 8 | np.int64(address[row, byte])
        source[row] = place
        at_s = now_s - (wall_s - stamp_s[row])
        time_s[row] = now_s if np.isnan(at_s) else min(max(at_s, drained_s[index[row]]), now_s)
    return source, time_s


@kernel
def _put(
    data: Bytes,
    length: Whole,
    destination: Whole,
    room: Bytes,
    room_length: Whole,
    part_length: Field,
    address: Bytes,
) -> Whole:
    """As `Batch.put`; `address` (count, 16) is struct sockaddr_in, big-endian from its second byte on."""
    changes, count = np.empty(len(length), np.int64), 0
    for row in range(len(length)):
        if row > 0 and destination[row] >> 48 != destination[row - 1] >> 48:
            changes[count] = row
            count += 1
        for at in range(length[row]):
            room[row, at] = data[row, at]
        room_length[row] = part_length[row] = length[row]
        for byte in range(2):
            address[row, 2 + byte] = destination[row] >> 8 * (1 - byte) & 0xFF
        for byte in range(4):
            address[row, 4 + byte] = destination[row] >> 8 * (5 - byte) & 0xFF
    return changes[:count]


@kernel
def _describe_runs(
    first: int,
    end: int,
    address: Bytes,
    length: Whole,
    name: Field,
    parts: Field,
    segment: Field,
    segment_bytes: Field,
    run_name: Field,
    run_parts: Field,
    run_count: Field,
    run_control: Field,
    run_control_length: Field,
) -> int:
    """Describe rows `first` to `end` - 1 as runs of equal length and destination. Returns: number of runs."""
    run = -1
    for row in range(first, end):
        goes_on = row > first and run_count[run] < _RUN_MOST and length[row] == length[row - 1]
        for byte in range(2, 8):
            goes_on = goes_on and address[row, byte] == address[row - 1, byte]
        if not goes_on:
            run += 1
            run_name[run], run_parts[run], run_count[run] = name[row], parts[row], 0
            segment_bytes[run] = length[row]
        run_count[run] += 1
        several = run_count[run] > 1
        run_control[run] = segment[run] if several else 0
        run_control_length[run] = _SEGMENT_LENGTH if several else 0
    return run + 1
