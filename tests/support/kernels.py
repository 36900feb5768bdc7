"""Which kernels have been compiled, for tests of what is compiled when."""

import sys

from numba.core.dispatcher import Dispatcher


def signatures() -> dict[str, int]:
    """For how many types of arguments each kernel of ours has been compiled or loaded."""
    return {
        f"{name}.{key}": len(value.signatures)
        for name, module in list(sys.modules.items())
        if name.startswith("gcs.")
        for key, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.__module__ == name
    }
