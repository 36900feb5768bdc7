"""Every module of `gcs`: `python -m tests.support.every_module` prints as JSON what their import changes."""

import gc
import json
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping
from importlib import import_module
from pkgutil import walk_packages
from types import FunctionType
from typing import Any

import gcs


def import_all() -> None:
    """All but programs."""
    for module in walk_packages(gcs.__path__, "gcs."):
        if not module.name.endswith(".__main__"):
            import_module(module.name)


def import_others() -> list[str]:
    """Import the installed modules that those of `gcs` import. Returns: their names."""
    reader, writer = os.pipe()
    if os.fork() == 0:  # a copy finds out which they are
        import_all()
        there = [name for name, module in sys.modules.items() if _is_installed(module)]
        os.write(writer, json.dumps(there).encode())
        os._exit(0)
    os.close(writer)
    names = []
    with os.fdopen(reader) as answer:
        for name in json.load(answer):
            try:
                import_module(name)
            except ImportError:  # a part that only its package can import
                continue
            names.append(name)
    return names


def _is_installed(module: Any) -> bool:
    return "site-packages" in (getattr(module, "__file__", None) or "")


def state(names: list[str]) -> dict[str, object]:
    """What an import could change: of the process, of the standard library, of the modules `names`."""
    modules: Mapping[str, Any] = sys.modules
    loggers = [logging.root, *(logging.getLogger(name) for name in names if "." not in name)]
    found: dict[str, object] = {
        "environment": dict(os.environ),
        "path": list(sys.path),
        "hidden modules": [name for name, module in modules.items() if module is None],
        "warnings": list(map(str, warnings.filters)),
        "signals": [str(signal.getsignal(number)) for number in signal.valid_signals()],
        "garbage collector": [gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()],
        "threads": threading.active_count(),
        "priority": os.getpriority(os.PRIO_PROCESS, 0),
        "hooks": [str(sys.excepthook), str(threading.excepthook)],
        "loggers": [(each.name, each.level, len(each.handlers)) for each in loggers],
    }
    for name in names:
        found |= {f"{name}.{key}": value for key, value in _public(vars(modules[name]))}
    return found


def _public(space: Mapping[str, Any]) -> Iterator[tuple[str, object]]:
    """Names and what can be compared: plain values and functions, sizes, the methods of classes."""
    for name, value in space.items():
        if name.startswith("_"):  # caches grow in use
            continue
        if isinstance(value, str | int | float | FunctionType):
            yield name, str(value)
        elif isinstance(value, dict | list | set):
            yield name, len(value)
        elif isinstance(value, type):
            yield name, [(key, str(each)) for key, each in vars(value).items() if callable(each)]


def changes() -> list[str]:
    """The names of what the import of `gcs` changes."""
    names = import_others()
    before = state(names)
    import_all()
    after = state(names)
    return [name for name in before if before[name] != after.get(name)]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(changes()))
