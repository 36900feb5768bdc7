"""Starts the API's program: `python -m gcs.cli.service.api_child CONTROL LINE LISTENER EMERGENCY_LISTENER`.

CONTROL is the process id of control's process, the other words are numbers of inherited sockets. This process
is started with SIGINT, SIGTERM and SIGHUP blocked: these ask control to bring the vehicles home, and an
operator wants to see that.
"""

import ctypes
import os
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1


def main(control: int, line: int, *listeners: int) -> None:
    if sys.platform == "linux":  # one that is stopped, or still starts, keeps no port from the next service
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() == control:
        from gcs.cli.service.api_program import run  # noqa: PLC0415 (takes a second, in which control may end)

        run(line, *listeners)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
