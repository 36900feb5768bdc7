"""The one way in which kernels are compiled here.

Compiled code is kept on disk, so that only the first run after a change waits for the compiler. Arithmetic
stays as written (no fast-math), so that the same input gives the same output everywhere.
"""

import os
import sys
from collections.abc import Callable
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])

MARK = b"@kernel"


def kept_in(package: Path) -> Path:
    """The folder for the compiled code of a package, named after what all its kernels say.

    Numba looks at the file of the kernel that is called, but not at those of the kernels that it calls: after
    a change in one of them it would go on flying the old code. With another name all is compiled anew.
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
    """Numba looks for scipy's BLAS as soon as it is used: 15 MB, though no kernel multiplies matrices."""
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules:
        return
    sys.modules[blas] = None  # type: ignore[assignment]  # as documented: importing it fails
    try:
        import_module("numba.np.arraymath")
    finally:
        del sys.modules[blas]


_load_without_blas()


def kernel(function: Kernel) -> Kernel:
    """Compile at the first call; dividing by zero gives inf or NaN, as in numpy."""
    compiled: Kernel = numba.njit(cache=True, error_model="numpy")(function)
    return compiled


def kernel_apart(function: Kernel) -> Kernel:
    """As `kernel`; called in a thread of its own it holds up no other: it lets the interpreter's lock go."""
    compiled: Kernel = numba.njit(cache=True, error_model="numpy", nogil=True)(function)
    return compiled


def kernel_in_any_order(function: Kernel) -> Kernel:
    """As `kernel`; sums may be formed in any order, so that they can be vectorised."""
    compiled: Kernel = numba.njit(cache=True, error_model="numpy", fastmath={"reassoc", "nsz"})(function)
    return compiled
