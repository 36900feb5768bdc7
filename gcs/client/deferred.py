"""Modules loaded at their first use, so that a command is sent before they load."""

from importlib import import_module
from typing import Any


class Deferred:
    """Proxy of a module, which is imported at the first access to one of its names.

    For type checkers, import the module itself under `TYPE_CHECKING`.
    """

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)
