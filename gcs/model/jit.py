"""Compilation of kernels with numba.

Compiled code is kept on disk, so that only the first run after a change waits for the compiler. Arithmetic
stays as written (no fast-math), so that the same input gives the same output everywhere.
"""

import os
import sys
from collections.abc import Callable
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite.binding import parse_bitcode  # type: ignore[import-untyped]
from numba.core.codegen import JITCodeLibrary

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


numba.config.CACHE_DIR = str(kept_in(Path(__file__).parents[1]))


def _load_without_blas() -> None:
    """Keep numba from importing scipy's BLAS on first use: 15 MB, though no kernel multiplies matrices."""
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules:
        return
    sys.modules[blas] = None  # type: ignore[assignment]  # as documented: importing it fails
    try:
        import_module("numba.np.arraymath")
    finally:
        del sys.modules[blas]


_load_without_blas()


def _drop_loaded_modules() -> None:
    """Have numba drop the LLVM module of each loaded kernel: 45 MB in flight.

    It needs the module only to compile another kernel that calls this one, and then makes it again. A version
    of numba that does this with other methods keeps the modules.
    """
    # ruff: noqa: SLF001  (numba offers no other way)
    if not (hasattr(JITCodeLibrary, "_unserialize") and hasattr(JITCodeLibrary, "_get_module_for_linking")):
        return
    load, module_of = JITCodeLibrary._unserialize.__func__, JITCodeLibrary._get_module_for_linking

    def unserialize(cls: Any, codegen: Any, state: tuple[str, str, Any]) -> Any:
        library = load(cls, codegen, state)
        _, kind, data = state
        if kind == "object":
            library._shared_module, library.dropped = None, data[1]
        return library

    def get_module_for_linking(self: Any) -> Any:
        if self._shared_module is None and hasattr(self, "dropped"):
            self._shared_module = parse_bitcode(self.dropped)
        return module_of(self)

    JITCodeLibrary._unserialize = classmethod(unserialize)
    JITCodeLibrary._get_module_for_linking = get_module_for_linking


_drop_loaded_modules()


def kernel(function: Kernel) -> Kernel:
    """Compile at the first call; division by zero gives inf or NaN, as in numpy."""
    compiled: Kernel = numba.njit(cache=True, error_model="numpy")(function)
    return compiled


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
    compiled: Kernel = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return compiled


def kernel_in_any_order(function: Kernel) -> Kernel:
    """As `kernel`, but sums may be formed in any order, so that they can be vectorised.

    Roots and quotients of single precision may begin from the processor's estimate: right to 4e-7.
    """
    loosely = {"reassoc", "nsz", "contract", "arcp", "afn"}
    compiled: Kernel = numba.njit(cache=True, error_model="numpy", fastmath=loosely)(function)
    return compiled
