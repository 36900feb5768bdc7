"""Memory that numba and pymavlink keep and `gcs serve` and `gcs demo` do not need in flight.

It changes these libraries for the whole process, so no import does it: a program calls `save_memory` first.
"""

import sys
from functools import cache
from importlib import import_module
from typing import Any

from llvmlite.binding import parse_bitcode  # type: ignore[import-untyped]
from numba.core.codegen import JITCodeLibrary
from pymavlink.dialects.v20 import ardupilotmega, development


@cache
def save_memory() -> None:
    """Before the first kernel runs."""
    _load_without_blas()
    _drop_loaded_modules()
    for dialect in (ardupilotmega, development):
        dialect.enums.clear()  # descriptions of thousands of values, which nothing here reads


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
