"""`python -m gcs` is `gcs`."""

import errno
import faulthandler
import os
import sys
from contextlib import suppress
from io import TextIOWrapper

from gcs.cli.service import supervisor

FIRST = -20
"""The nice value before all others."""

INTERRUPTED = 130
PIPE_CLOSED = 141
"""As a shell tells of those that ended by SIGINT and by SIGPIPE."""


def main() -> int:
    """Entry point. A supervisor is up before anything else is loaded. Returns: the exit code."""
    if supervisor.is_requested(sys.argv[1:]):
        return supervisor.run(sys.argv[1:])
    if sys.argv[1:2] == ["kill"]:  # on a busy machine it goes before all that has an ordinary priority
        with suppress(OSError):  # not permitted
            os.setpriority(os.PRIO_PROCESS, 0, FIRST)
    faulthandler.enable()  # what hangs and is sent SIGABRT says where
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a terminal may have ASCII only
            stream.reconfigure(errors="backslashreplace")
    # Before numpy is imported. OpenBLAS waits for its threads in a busy loop: with real-time priority,
    # control would keep them from running, and stand still for 0.9 s in one product of matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from gcs import cli  # noqa: PLC0415 (heavy)

        code = cli.main()
        sys.stdout.flush()
    except KeyboardInterrupt:  # also while it is still being loaded
        return INTERRUPTED
    except OSError as error:  # the reader closed the pipe (`gcs phase | head -1`), or the terminal is closed
        if error.errno not in {errno.EPIPE, errno.EIO}:
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # nothing is left to flush at the end
        return PIPE_CLOSED
    return code


if __name__ == "__main__":
    sys.exit(main())
