"""How much work something is, whatever the machine: lines of Python that run."""

import gc
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any


def lines_run(work: Callable[[], object]) -> int:
    """Lines of Python that run while this is called; what C code does within one line counts once."""
    count = 0

    def trace(frame: FrameType, event: str, given: Any) -> Any:
        nonlocal count
        count += event in {"line", "call"}
        return trace

    before = sys.gettrace()
    gc.disable()  # what other tests left is not this work's
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
        gc.enable()
    return count
