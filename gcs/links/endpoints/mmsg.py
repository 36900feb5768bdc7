"""Many datagrams with one system call: sendmmsg and recvmmsg of Linux, through ctypes.

The structures are the C library's, filled through numpy views, so that a batch costs no Python per datagram.
"""

import ctypes
import errno
import os
import socket
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gcs.mavlink.kernels import Bytes, Whole

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
        data: (count, longest) bytes of each.
        length: (count,) of each; to be written before `send`.
        host, port: (count,) IPv4 addresses as numbers.
        time_s: (count,) the kernel's wall-clock time of arrival, NaN where it gave none.
    """

    def __init__(self, count: int, longest: int) -> None:
        self.data: Bytes = np.zeros((count, longest), np.uint8)
        self.length: Whole = np.zeros(count, np.int64)
        self.time_s = np.full(count, np.nan)
        self._addresses = np.zeros(count, _ADDRESS)
        self.host, self.port = self._addresses["host"], self._addresses["port"]
        self._parts = np.zeros(count, _PART)
        self._control = np.zeros(count, _CONTROL)
        self._messages = np.zeros(count, _MESSAGE)
        self._addresses["family"] = socket.AF_INET
        rows = np.arange(count, dtype=np.uint64)
        self._parts["base"] = self.data.ctypes.data + rows * np.uint64(longest)
        headers = self._messages["header"]
        headers["name"] = self._addresses.ctypes.data + rows * np.uint64(_ADDRESS.itemsize)
        headers["parts"] = self._parts.ctypes.data + rows * np.uint64(self._parts.itemsize)
        headers["part_count"] = 1
        headers["name_length"] = _ADDRESS.itemsize
        self._control_places = self._control.ctypes.data + rows * np.uint64(self._control.itemsize)
        self._runs = np.zeros(count, _MESSAGE)
        self._segments = np.zeros(count, _SEGMENT)
        self._segments["length"] = socket.CMSG_LEN(2)
        self._segments["level"], self._segments["kind"] = socket.IPPROTO_UDP, _UDP_SEGMENT
        self._segment_places = self._segments.ctypes.data + rows * np.uint64(self._segments.itemsize)

    def receive(self, fd: int, first: int, most: int) -> int:
        """Read datagrams into row `first` and the following rows. Returns: number; never waits.

        Raises: OSError; BlockingIOError when there is nothing to read.
        """
        rows = slice(first, first + most)
        headers = self._messages["header"][rows]
        self._parts["length"][rows] = self.data.shape[1]
        self._control["length"][rows] = 0
        headers["name_length"] = _ADDRESS.itemsize
        headers["control"] = self._control_places[rows]
        headers["control_length"] = self._control.itemsize
        count = _call(_LIBC.recvmmsg, fd, self._messages[rows], None)
        came = slice(first, first + count)
        self.length[came] = self._messages["length"][came]
        control = self._control[came]
        stamped = (
            (control["length"] >= _CONTROL.itemsize)
            & (control["level"] == socket.SOL_SOCKET)
            & (control["kind"] == SO_TIMESTAMPNS)
        )
        time_s = control["seconds"] + control["nanoseconds"] * 1e-9
        self.time_s[came] = np.where(stamped, time_s, np.nan)
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

    def send(self, fd: int, first: int, end: int) -> int:
        """Send rows `first` to `end` - 1, in order. Returns: number of rows sent; never waits.

        Raises: OSError when the first of them could not be sent.
        """
        rows = slice(first, end)
        self._parts["length"][rows] = self.length[rows]
        headers = self._messages["header"][rows]
        headers["control"] = 0
        headers["control_length"] = 0
        return _call(_LIBC.sendmmsg, fd, self._messages[rows])

    def send_runs(self, fd: int, first: int, end: int) -> int:
        """As `send`; neighbours of equal length and destination cost the kernel little more than one."""
        rows = slice(first, end)
        self._parts["length"][rows] = self.length[rows]
        begins = self._begins(first, end)
        counts = np.diff(begins, append=end)
        k, several = len(begins), counts > 1
        self._segments["bytes"][:k] = self.length[begins]
        headers = self._runs["header"][:k]
        headers["name"] = self._messages["header"]["name"][begins]
        headers["name_length"] = _ADDRESS.itemsize
        headers["parts"] = self._messages["header"]["parts"][begins]
        headers["part_count"] = counts
        headers["control"] = np.where(several, self._segment_places[:k], 0)
        headers["control_length"] = np.where(several, self._segments.itemsize, 0)
        return int(counts[: _call(_LIBC.sendmmsg, fd, self._runs[:k])].sum())

    def _begins(self, first: int, end: int) -> Whole:
        """Where runs begin among rows `first` to `end` - 1."""
        rows = np.arange(first, end)
        address, length = self._addresses[first:end], self.length[first:end]
        begins = np.ones(len(rows), np.bool_)
        begins[1:] = length[1:] != length[:-1]
        for part in ("host", "port"):
            begins[1:] |= address[part][1:] != address[part][:-1]
        begins |= (rows - np.maximum.accumulate(np.where(begins, rows, 0))) % _RUN_MOST == 0
        return np.flatnonzero(begins) + first


def _call(function: Any, fd: int, messages: NDArray[np.void], *more: object) -> int:
    """Result of sendmmsg or recvmmsg with these messages. Raises: OSError."""
    place, count = ctypes.c_void_p(messages.ctypes.data), ctypes.c_uint(len(messages))
    done: int = function(fd, place, count, 0, *more)
    if done < 0:
        number = ctypes.get_errno()
        if number in (errno.EAGAIN, errno.EWOULDBLOCK):
            raise BlockingIOError(number, os.strerror(number))
        raise OSError(number, os.strerror(number))
    return done
