"""The lock of a folder that several processes could write: held by an open file, it ends with its process.

Readers need no lock. Where a folder cannot be written, or its file system has no locks, there is none: that
prevents no flight, and is logged.
"""

import fcntl
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from gcs.model.errors import RefusedError

log = logging.getLogger(__name__)

LOCK: Final = ".lock"
"""Name of the file; it stays, and names the process that had the lock last."""

_HOLDER_BYTES: Final = 200


@contextmanager
def owned(folder: Path) -> Iterator[None]:
    """Be the only service that writes this folder of records until the block ends.

    Raises: RefusedError naming the process that does.
    """
    with _locked(folder, folder / LOCK, os.O_RDWR | os.O_CREAT, fcntl.LOCK_EX | fcntl.LOCK_NB) as handle:
        if handle is not None:
            with suppress(OSError):  # a full disk: the lock is held all the same
                os.ftruncate(handle, 0)
                os.pwrite(handle, f"pid {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        yield


@contextmanager
def in_turn(folder: Path) -> Iterator[None]:
    """Write a folder that several services share, each for milliseconds. Waits for its turn."""
    with _locked(folder, folder, os.O_RDONLY, fcntl.LOCK_EX):
        yield


@contextmanager
def _locked(folder: Path, file: Path, flags: int, kind: int) -> Iterator[int | None]:
    """Yields: the locked file; None: there is no lock. Raises: RefusedError when it is not free."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(file, flags | os.O_CLOEXEC, 0o644)
    except OSError as error:
        _note(folder, error)
        yield None
        return
    try:
        try:
            fcntl.flock(handle, kind)
        except BlockingIOError:
            holder = os.pread(handle, _HOLDER_BYTES, 0).decode(errors="replace").strip()
            raise RefusedError(
                f"another service ({holder or 'unknown'}) writes this record: {folder}; "
                "use another `record:` folder, or stop that one"
            ) from None
        except OSError as error:
            _note(folder, error)
        yield handle
    finally:
        os.close(handle)


def _note(folder: Path, error: OSError) -> None:
    log.warning("folder_not_locked", extra={"folder": str(folder), "cause": str(error)})
