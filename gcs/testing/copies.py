"""Work in a copy of this process, which leaves everything here as it is."""

import asyncio
import gc
import os
import pickle
import signal
import traceback
import warnings
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def in_a_copy(work: Callable[[], T]) -> T:
    """Call `work` in a fork of this process.

    Returns: the result, pickled there. Raises: AssertionError with the traceback of the copy.
    """
    loop = asyncio._get_running_loop()
    reader, writer = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the copy needs no thread of xdist
        child = os.fork()
    if child == 0:
        try:
            gc.freeze()  # collected objects would be copied page by page
            asyncio._set_running_loop(loop)  # which asyncio knows by process
            try:
                answer = pickle.dumps((work(), ""))
            except BaseException:  # noqa: BLE001  what ends a test is raised in this process, below
                answer = pickle.dumps((None, traceback.format_exc()))
            with os.fdopen(writer, "wb") as stream:
                stream.write(answer)
        finally:
            os._exit(0)
    os.close(writer)
    try:
        with os.fdopen(reader, "rb") as stream:
            answer = stream.read()
    finally:
        os.kill(child, signal.SIGKILL)  # after a timeout of the test it still runs
        os.waitpid(child, 0)
    assert answer, "the copy of this process ended without a result"
    result, problem = pickle.loads(answer)  # noqa: S301
    assert not problem, problem
    return result  # type: ignore[no-any-return]
