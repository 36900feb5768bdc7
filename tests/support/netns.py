"""Network namespaces for tests of several hosts, and whether there can be some here."""

import ctypes
import os
import shutil
from pathlib import Path
from typing import Final

GET_THEM: Final = "run as root, with `ip`: sudo apt-get install -y iproute2"

NOT_RUN: Final = f"Tests of several hosts were not run: they need network namespaces. To get them: {GET_THEM}"

REQUIRED: Final = "REQUIRE_NETNS"
"""In the environment, 1: to have none is an error."""

_CLONE_NEWNET: Final = 0x40000000


def are_possible() -> bool:
    """Whether this user can make network namespaces."""
    return os.geteuid() == 0 and shutil.which("ip") is not None


def enter(namespace: str) -> None:
    """Let sockets that this thread opens belong to that namespace. Raises: OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    handle = os.open(Path("/run/netns") / namespace, os.O_RDONLY)
    try:
        if libc.setns(handle, _CLONE_NEWNET):
            number = ctypes.get_errno()
            raise OSError(number, f"namespace {namespace}: {os.strerror(number)}")
    finally:
        os.close(handle)
