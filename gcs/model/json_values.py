"""Reads JSON that is not trusted: size, depth and counts are bounded, and each error names the place."""

from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from pydantic_core import from_json

from gcs.model.errors import ConfigError, DrawingError, quoted

DEPTH_MAX: Final = 32
LISTS_MAX: Final = 400_000
OBJECTS_MAX: Final = 100_000
COMMAS_MAX: Final = 1_000_000
"""With these counts the values of one document take less than 150 MB; a trajectory has some thousands."""

_BRACKETS: Final = np.zeros(256, np.int8)
"""What each byte adds to the depth."""

_BRACKETS[list(b"[{")], _BRACKETS[list(b"]}")] = 1, -1


MadeError: TypeAlias = Callable[[str, str], ConfigError]
"""Makes the error of a kind of file, from a place and what is wrong there."""


def parsed(data: bytes, place: str, error: MadeError = DrawingError) -> "Value":
    """Parse a document in UTF-8. Raises: `error` when it is not JSON within the bounds."""
    counts = (("lists", b"[", LISTS_MAX), ("objects", b"{", OBJECTS_MAX), ("values", b",", COMMAS_MAX))
    for what, sign, most in counts:
        if data.count(sign) > most:
            text = f"more than {most} {what} in one document: give each drone's trajectory a file of its own"
            raise error(place, text)
    if _depth(data) > DEPTH_MAX:
        raise error(place, f"nested deeper than {DEPTH_MAX} levels")
    try:
        return Value(from_json(data.removeprefix(BOM_UTF8), allow_inf_nan=False), place, error=error)
    except ValueError as wrong:
        raise error(place, f"not JSON: {wrong}") from None


def _depth(data: bytes) -> int:
    """Return the greatest depth of brackets; those in texts count, too."""
    steps = _BRACKETS[np.frombuffer(data, np.uint8)]
    return int(np.cumsum(steps[steps != 0], dtype=np.int32).max(initial=0))


@dataclass(frozen=True, slots=True)
class Value:
    """A value and its place. Every method raises `error` for a value of another kind."""

    raw: object
    document: str  # file and entry
    path: str = ""  # in the document, for example swarm.drones[3]
    error: MadeError = DrawingError

    @property
    def place(self) -> str:
        return f"{self.document}: {self.path}" if self.path else self.document

    def wrong(self, needed: str) -> ConfigError:
        return self.error(self.place, f"{quoted(self.raw)}: {needed} is needed")

    def items(self, most: int) -> list[object]:
        """Return the elements of a list."""
        if not isinstance(self.raw, list):
            raise self.wrong("a list")
        if len(self.raw) > most:
            raise self.error(self.place, f"{len(self.raw)} elements: at most {most}")
        return self.raw

    def element(self, at: int, raw: object) -> "Value":
        """Return an element of this list with its place."""
        return Value(raw, self.document, f"{self.path}[{at}]", self.error)

    def values(self, most: int) -> Iterator["Value"]:
        """Return the elements of a list with their places."""
        return (self.element(at, raw) for at, raw in enumerate(self.items(most)))

    def get(self, key: str) -> "Value | None":
        """Return the value of a key of an object; None when the key is not there, or null."""
        if not isinstance(self.raw, dict):
            raise self.wrong("an object")
        raw = self.raw.get(key)
        if raw is None:
            return None
        return Value(raw, self.document, f"{self.path}.{key}".lstrip("."), self.error)

    def need(self, key: str) -> "Value":
        """Return the value of a key of an object."""
        value = self.get(key)
        if value is None:
            raise self.error(self.place, f"'{key}' is missing")
        return value

    def number(self, least: float = -1e9, most: float = 1e9) -> float:
        """Return a finite number within bounds; true and false are none."""
        if isinstance(self.raw, bool) or not isinstance(self.raw, int | float):
            raise self.wrong("a number")
        if not least <= self.raw <= most:  # of NaN and of whole numbers beyond all floats, too
            raise self.wrong(f"a number from {least:g} to {most:g}")
        return float(self.raw)

    def text(self, most: int) -> str:
        """Return a text of at most so many characters."""
        if not isinstance(self.raw, str):
            raise self.wrong("a text")
        if len(self.raw) > most:
            raise self.error(self.place, f"{len(self.raw)} characters: at most {most}")
        return self.raw

    def version(self, *readable: int) -> int:
        """Return the object's `version`, one of those that can be read."""
        version = self.need("version")
        if version.raw not in readable or isinstance(version.raw, bool):
            raise version.wrong(" or ".join(map(str, readable)))
        return int(version.number())
