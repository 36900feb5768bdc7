"""Compilation of kernels with numba.

Compiled code is kept on disk, so that only the first run after a change waits for the compiler. Arithmetic
stays as written (no fast-math), so that the same input gives the same output everywhere.
"""

import os
import re
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., object])

MARK = b"@kernel"

_IMPORTED = re.compile(rb"^(?:from|import) ([\w.]+)", re.MULTILINE)

PACKAGE = Path(__file__).parents[1]


def kept_beside(package: Path) -> Path:
    """The folder for the compiled code of a package."""
    if numba.config.CACHE_DIR:
        base = Path(numba.config.CACHE_DIR)
    elif os.access(package, os.W_OK):
        base = package / "__pycache__"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / package.name
    return base / "kernels"


KEPT_IN = kept_beside(PACKAGE)


@cache
def _own(package: str) -> frozenset[str]:
    return frozenset(name.partition(".")[0] for name in os.listdir(package))  # noqa: PTH208 - texts are faster


@cache
def _read(package: str, module: str) -> tuple[bytes, tuple[str, ...]]:
    """A hash of a module's source if it has kernels, else empty; and the modules that it imports."""
    source = Path(module).read_bytes()
    names = {name.decode() for name in _IMPORTED.findall(source)}
    inside = [name.removeprefix(f"{os.path.basename(package)}.").split(".") for name in names]  # noqa: PTH119
    places = ("/".join((package, *name)) for name in inside if name[0] in _own(package))
    files = (file for place in places for file in (f"{place}.py", f"{place}/__init__.py"))
    imported = tuple(file for file in files if os.path.isfile(file))  # noqa: PTH113
    return sha256(source).digest() if MARK in source else b"", imported


@cache
def _reached(package: str, module: str) -> frozenset[str]:
    """A module, and all of the package that it imports, and these."""
    reached, new = {module}, [module]
    while new:
        imported = set(_read(package, new.pop())[1]) - reached
        new += imported
        reached |= imported
    return frozenset(reached)


@cache
def digest_of(package: Path, module: Path) -> str:
    """A hash of all kernel sources that those of a module may call: its own, and of what it imports.

    Numba checks the file of the kernel that is called, but not the files of the kernels that it calls: after
    a change in one of those it would keep running the old code. With another folder name it is compiled
    again, and nothing else is.
    """
    reached = sorted(_reached(str(package), str(module)))
    sources = b"\0".join(_read(str(package), file)[0] for file in reached)
    return sha256(sources).hexdigest()[:16]


def is_compiled() -> bool:
    """Whether an earlier run has kept compiled code of kernels that begin every flight as they are now."""
    kept = KEPT_IN / digest_of(PACKAGE, PACKAGE / "safety" / "filter.py")
    return any(kept.rglob("*.nbi"))  # numba makes the folder before it compiles


def _kept(compiled: Callable[[Kernel], Kernel], function: Kernel) -> Kernel:
    """Decorate the function; its machine code is kept in `KEPT_IN`, other functions' where numba has it."""
    usual, module = numba.config.CACHE_DIR, Path(function.__code__.co_filename)
    package = PACKAGE if module.is_relative_to(PACKAGE) else module.parent
    numba.config.CACHE_DIR = str(KEPT_IN / digest_of(package, module))  # read while a function is decorated
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
