"""Every error that `gcs` raises on purpose.

GcsError
├── ShapeError       an array has the wrong shape (a bug in the caller)
├── ConfigError      a configuration file contains an impossible value
│   ├── FileError    names the line of every problem
│   │   └── ShowError    of a show file; also names the cue
│   ├── DrawingError a file of another program with a drawn show; names the place in it
│   └── SiteError    a site that cannot be flown; names file, area and corner
├── InvalidError     a value from outside is out of range; names the field and what is allowed
├── AccessError      the caller may not do this, or calls too often
├── RefusedError     a proper request at the wrong moment; gives the reason
├── UnknownError     a vehicle, obstacle or command that does not exist
└── LinkError        a transport does not work; the supervisor retries
    └── CommandError   a vehicle refused a command or did not answer
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from reprlib import Repr
from typing import Any, Final

SHOWN_MAX: Final = 80
"""Characters of a value that a message shows: enough to recognise it."""

_REPR: Final = Repr()
_REPR.maxlevel = 3
_REPR.maxlist = _REPR.maxtuple = _REPR.maxdict = _REPR.maxset = _REPR.maxfrozenset = 6
_REPR.maxstring = _REPR.maxlong = _REPR.maxother = SHOWN_MAX


_UNSEEN: Final = "\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
"""Characters that a terminal obeys, that turn the direction of text, or that no encoding has."""

UNSEEN: Final = re.compile(f"[{_UNSEEN}]")
UNSEEN_IN_LINE: Final = re.compile(f"[\t\n{_UNSEEN}]")


def visible(text: str) -> str:
    """A text with its control characters written out; line ends and tabs stay."""
    return UNSEEN.sub(lambda matched: repr(matched[0])[1:-1], text)


def cut(text: str) -> str:
    """At most `SHOWN_MAX` characters of a text, on one visible line; an ellipsis replaces the rest."""
    line = visible(text[: SHOWN_MAX + 1].replace("\n", " "))
    return line if len(line) <= SHOWN_MAX else line[: SHOWN_MAX - 1] + "…"


def quoted(value: object) -> str:
    """Any value as a message shows it; only the shown part is formatted, whatever its size and depth."""
    return cut(_REPR.repr(value))


PROBLEMS_MAX: Final = 100
"""Problems listed for one file; further ones are listed once these are fixed."""


class GcsError(Exception):
    """Root of the tree; its text is written for a person."""

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), self.args, vars(self))


def _restored(kind: type[GcsError], args: tuple[object, ...], attributes: dict[str, object]) -> GcsError:
    """The error as it was pickled; its constructor is not called, as `args` are not its parameters."""
    error = kind.__new__(kind, *args)
    error.__dict__ |= attributes
    return error


class ShapeError(GcsError):
    """An array does not fit its fleet."""


class ConfigError(GcsError):
    """A configuration that cannot be flown; the text names file and key."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem of a file, and where to fix it."""

    line: int  # of the file, from 1
    cue: str | None  # None: not in the timeline
    text: str  # what is wrong, and what is allowed

    def __str__(self) -> str:
        cue = "" if self.cue is None else f" cue '{self.cue}':"
        return f"line {self.line}:{cue} {self.text}"


class FileError(ConfigError):
    """A file with problems, each with its line.

    Attributes:
        file: its name.
        problems: the first `PROBLEMS_MAX`, by line.
    """

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.file = file
        shown = sorted(problems, key=lambda problem: problem.line)
        more = len(shown) - PROBLEMS_MAX
        if more > 0:
            shown[PROBLEMS_MAX:] = [Problem(shown[PROBLEMS_MAX].line, None, f"and {more} more from here on")]
        self.problems = tuple(shown)
        super().__init__("\n".join(f"{file}: {problem}" for problem in self.problems))


class ShowError(FileError):
    """A show that cannot be flown."""


class DrawingError(ConfigError):
    """A drawn show that cannot be imported.

    Attributes:
        place: file, entry and path of what is wrong, for example ``a.skyc: show.json: swarm.drones[3]``.
        problem: what is wrong, and what would be right.
    """

    def __init__(self, place: str, problem: str) -> None:
        super().__init__(f"{place}: {problem}")
        self.place = place
        self.problem = problem


class SiteError(ConfigError):
    """A site that cannot be flown, or a file of one that cannot be read.

    Attributes:
        place: the file, and what of it is meant, for example ``field.geojson: features[2].geometry``.
        problems: everything that is wrong there, and what would be right.
    """

    def __init__(self, place: str, *problems: str) -> None:
        super().__init__("\n".join(f"{place}: {problem}" for problem in problems))
        self.place = place
        self.problems = problems


class InvalidError(GcsError):
    """A value that can never be accepted.

    Attributes:
        field: dotted name as the caller knows it, for example ``radius_m``.
        value: the value given.
        allowed: what is allowed, in words or numbers, units included.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field} = {cut(str(value))}: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class AccessError(GcsError):
    """The caller's token does not allow it, or it calls too often; the text says what is allowed."""


class RefusedError(GcsError):
    """A proper request at the wrong moment; the text gives the reason and what to do."""


class UnknownError(GcsError):
    """The named vehicle, obstacle or command does not exist."""


class LinkError(GcsError):
    """A transport failed; the link's supervisor retries."""


class CommandError(LinkError):
    """A vehicle refused a command, or its execution was not seen in time."""
