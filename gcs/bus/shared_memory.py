"""Bundles between stations on one machine: each writes a file in memory, which the others read.

The file: u64 number of the newest bundle, then from its second page on `SLOTS` slots, written in turn. A
slot: u64 number of its bundle, u32 length, u32 CRC-32, the bundle. The number of the newest is written last,
so that a reader looks at no slot before it is whole; what is overwritten while it is read fails its CRC.
Decision 0053.
"""

import fcntl
import mmap
import os
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final
from zlib import crc32

from gcs.bus.bundles import BUNDLE_MAX
from gcs.bus.settings import Endpoint
from gcs.model.errors import LinkError

SLOTS: Final = 16
"""Bundles of a station that wait for the next tick of another; beyond that the oldest are dropped."""

PREFIX: Final = "gcs-bus-"
"""Of the names of these files."""

ATTEMPTS, AGAIN_S = 20, 0.01
"""Of taking the lock: a process that only checks whether a station writes the file has it for a moment."""

PAGE: Final = 4096

_NEWEST: Final = struct.Struct("<Q")
_SLOT: Final = struct.Struct("<QII")

SLOT_BYTES: Final = -(-(_SLOT.size + BUNDLE_MAX) // PAGE) * PAGE
FILE_BYTES: Final = PAGE + SLOTS * SLOT_BYTES


def shared_file(endpoint: Endpoint) -> Path:
    """The file of the station at this endpoint."""
    return Path("/dev/shm") / f"{PREFIX}{endpoint.host}-{endpoint.port}"  # noqa: S108 (the owner is checked)


@contextmanager
def _link_errors(file: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise LinkError(f"{file}: {error.strerror}") from None


def _opened(file: Path, flags: int) -> int:
    """Raises: LinkError for a file of another user, OSError."""
    handle = os.open(file, flags | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    if os.fstat(handle).st_uid != os.geteuid():
        os.close(handle)
        raise LinkError(f"{file} belongs to another user")
    return handle


def _locked(file: Path) -> int:
    """Open a file, made if it is missing, with the writer's lock. Raises: LinkError, OSError."""
    for _ in range(ATTEMPTS):
        handle = _opened(file, os.O_RDWR | os.O_CREAT)
        if _lock(handle) and os.fstat(handle).st_nlink:  # 0: it was removed before it was locked
            return handle
        os.close(handle)
        time.sleep(AGAIN_S)
    raise LinkError(f"{file}: another station writes it")


def _lock(handle: int) -> bool:
    """Take the writer's lock. Returns: whether it was free."""
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _remove_abandoned(folder: Path) -> None:
    """Remove the files of this user's stations that were killed."""
    for file in folder.glob(f"{PREFIX}*"):
        with suppress(LinkError, OSError):  # another user's, or gone already
            handle = _opened(file, os.O_RDONLY)
            try:
                if _lock(handle):
                    file.unlink()
            finally:
                os.close(handle)


class Writer:
    """One station's file. Its lock tells the others that the station runs."""

    def __init__(self, file: Path) -> None:
        """Raises: LinkError when another process writes it, or there is no memory for it."""
        self._file = file
        with _link_errors(file):
            _remove_abandoned(file.parent)
            self._handle = _locked(file)
            try:
                os.posix_fallocate(self._handle, 0, FILE_BYTES)  # else a write without memory is fatal
                self._memory = mmap.mmap(self._handle, FILE_BYTES)
            except OSError:
                os.close(self._handle)
                raise
        self._number: int = _NEWEST.unpack_from(self._memory)[0]

    def put(self, bundle: bytes) -> None:
        """Write a bundle of at most `BUNDLE_MAX` bytes."""
        self._number += 1
        at = _slot_at(self._number)
        begin = at + _SLOT.size
        self._memory[begin : begin + len(bundle)] = bundle
        _SLOT.pack_into(self._memory, at, self._number, len(bundle), crc32(bundle))
        _NEWEST.pack_into(self._memory, 0, self._number)

    def close(self) -> None:
        with suppress(FileNotFoundError):
            self._file.unlink()
        self._memory.close()
        os.close(self._handle)


class BundleReader:
    """Another station's file."""

    def __init__(self, file: Path) -> None:
        """What was written before is not read. Raises: LinkError when no process writes it."""
        with _link_errors(file):
            handle = _opened(file, os.O_RDONLY)
            try:
                if os.fstat(handle).st_size != FILE_BYTES or _lock(handle):
                    raise LinkError(f"{file}: no station writes it")
                self._memory = mmap.mmap(handle, FILE_BYTES, prot=mmap.PROT_READ)
            finally:
                os.close(handle)
        self._number: int = _NEWEST.unpack_from(self._memory)[0]

    def newest(self) -> Iterator[bytes]:
        """Bundles since the last call, in their order."""
        newest = _NEWEST.unpack_from(self._memory)[0]
        seen = self._number if self._number <= newest else 0
        first = max(seen, newest - SLOTS + 1) + 1  # without the slot that is written next
        self._number = newest
        for number in range(first, newest + 1):
            at = _slot_at(number)
            held, length, checksum = _SLOT.unpack_from(self._memory, at)
            begin = at + _SLOT.size
            bundle = self._memory[begin : begin + min(length, BUNDLE_MAX)]
            if held == number and crc32(bundle) == checksum:
                yield bundle

    def close(self) -> None:
        self._memory.close()


def _slot_at(number: int) -> int:
    return PAGE + number % SLOTS * SLOT_BYTES
