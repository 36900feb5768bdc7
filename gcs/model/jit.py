"""Compilation of kernels with numba.

Compiled code is kept on disk, so that only the first run after a change waits for the compiler. Arithmetic
stays as written (no fast-math), so that the same input gives the same output everywhere.
"""

import os
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])

MARK = b"@kernel"


def kept_in(package: Path) -> Path:
    """The folder for the compiled code of a package, named by a hash of all its kernel sources.

    Numba checks the file of the kernel that is called, but not the files of the kernels that it calls: after
    a change in one of those it would keep running the old code. With another folder name all is compiled
    again.
    """
    sources = [path.read_bytes() for path in sorted(package.rglob("*.py"))]
    digest = sha256(b"\0".join(source for source in sources if MARK in source)).hexdigest()[:16]
    if numba.config.CACHE_DIR:
        base = Path(numba.config.CACHE_DIR)
    elif os.access(package, os.W_OK):
        base = package / "__pycache__"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / package.name
    return base / f"kernels-{digest}"


KEPT_IN = str(kept_in(Path(__file__).parents[1]))


def is_compiled() -> bool:
    """Whether an earlier run has kept compiled code of these sources."""
    return any(Path(KEPT_IN).rglob("*.nbi"))  # numba makes the folder before it compiles


def _kept(compiled: Callable[[Kernel], Kernel], function: Kernel) -> Kernel:
    """Decorate the function; its machine code is kept in `KEPT_IN`, other functions' where numba has it."""
    usual = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = KEPT_IN  # read while a function is decorated
    try:
        return compiled(function)
    finally:
        numba.config.CACHE_DIR = usual


def kernel(function: Kernel) -> Kernel:
    """Compile at the first call; division by zero gives inf or NaN, as in numpy."""
    return _kept(numba.njit(cache=True, error_model="numpy"), function)


def kernel_within(function: Kernel) -> Kernel:
    """As `kernel`, but becomes part of the kernels that call it.

    For what is called for each row: handing arrays to a function counts the references to each of them, and
    to a tuple of arrays the references to all. Within the caller this is left out only where a straight line
    uses them last: not in a branch, nor in the branch of another `kernel_within`.
    """
    compiled: Kernel = numba.njit(inline="always", error_model="numpy")(function)
    return compiled


def kernel_apart(function: Kernel) -> Kernel:
    """As `kernel`, but releases the interpreter's lock, so that in a thread of its own it blocks no other."""
    return _kept(numba.njit(cache=True, error_model="numpy", nogil=True), function)


def kernel_in_any_order(function: Kernel) -> Kernel:
    """As `kernel`, but sums may be formed in any order, so that they can be vectorised.

    Roots and quotients of single precision may begin from the processor's estimate: right to 4e-7.
    """
    loosely = {"reassoc", "nsz", "contract", "arcp", "afn"}
    return _kept(numba.njit(cache=True, error_model="numpy", fastmath=loosely), function)
