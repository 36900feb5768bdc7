"""Values quoted in messages, limited in length."""

from reprlib import Repr
from typing import Final

SHOWN_MAX: Final = 80
"""Characters of a value that a message shows: enough to recognise it."""

_REPR: Final = Repr()
_REPR.maxlevel = 3
_REPR.maxlist = _REPR.maxtuple = _REPR.maxdict = _REPR.maxset = _REPR.maxfrozenset = 6
_REPR.maxstring = _REPR.maxlong = _REPR.maxother = SHOWN_MAX


def cut(text: str) -> str:
    """At most `SHOWN_MAX` characters of a text, on one line; an ellipsis replaces the rest."""
    line = text[: SHOWN_MAX + 1].replace("\n", " ")
    return line if len(line) <= SHOWN_MAX else line[: SHOWN_MAX - 1] + "…"


def quoted(value: object) -> str:
    """Any value as a message shows it; only the shown part is formatted, whatever its size and depth."""
    return cut(_REPR.repr(value))
