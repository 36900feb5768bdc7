"""Whether this machine's clock is synchronised, as the kernel knows it: `gcs serve` says so."""

import ctypes
import sys
from typing import Final

TIME_ERROR: Final = 5
"""What adjtimex returns for a clock that is not synchronised: adjtimex(2)."""

ERROR_MAX_US: Final = 20_000
"""The kernel's own bound of the clock's error, beyond which a show could begin noticeably early or late."""


class _Timex(ctypes.Structure):
    """The beginning of struct timex, and room for the rest."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * 256),
    )


def problem() -> str:
    """Why the clock is not to be trusted, in words; empty where the kernel says that it is synchronised."""
    if not sys.platform.startswith("linux"):
        return "this system does not say whether it is synchronised"
    timex = _Timex()  # modes = 0: only read
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.byref(timex))
    if state < 0:
        return "the kernel does not say whether it is synchronised"
    if state == TIME_ERROR:
        return "it is not synchronised"
    if timex.esterror > ERROR_MAX_US:
        return f"its error is estimated at {timex.esterror / 1e3:.0f} ms"
    return ""
