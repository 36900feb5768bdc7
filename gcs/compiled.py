"""The one way in which kernels are compiled here.

Compiled code is kept on disk, so that only the first run after a change waits for the compiler. Arithmetic
stays as written (no fast-math), so that the same input gives the same output everywhere.
"""

from collections.abc import Callable
from typing import TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])


def kernel(function: Kernel) -> Kernel:
    """Compile at the first call; dividing by zero gives inf or NaN, as in numpy."""
    compiled: Kernel = numba.njit(cache=True, error_model="numpy")(function)
    return compiled
