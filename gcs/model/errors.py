"""Every error this package raises on purpose.

GcsError
├── ShapeError       an array has the wrong shape (a bug in the caller)
├── ConfigError      a configuration file says something impossible
│   └── FileError    names the line of every problem
│       └── ShowError    of a show file; names the cue, too
├── InvalidError     a value from outside is out of range; names the field and what is allowed
├── AccessError      the caller may not do this, or calls too often
├── RefusedError     a proper request at the wrong moment; says why
├── UnknownError     a vehicle, obstacle or order that does not exist
└── LinkError        a transport does not work; the supervisor retries
    └── CommandError   a vehicle refused an order or did not answer
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gcs.model.quoting import cut

PROBLEMS_MAX: Final = 100
"""Problems listed for one file; further ones show once these are fixed."""


class GcsError(Exception):
    """Root of the tree; its text is meant for a person."""


class ShapeError(GcsError):
    """An array does not fit its fleet."""


class ConfigError(GcsError):
    """A configuration that cannot be flown; the text names file and key."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong with a file, and where to mend it."""

    line: int  # of the file, from 1
    cue: str | None  # None: not in the timeline
    text: str  # what is wrong, and what would be right

    def __str__(self) -> str:
        cue = "" if self.cue is None else f" cue '{self.cue}':"
        return f"line {self.line}:{cue} {self.text}"


class FileError(ConfigError):
    """A file of which every problem is known by its line.

    Attributes:
        file: its name.
        problems: the first `PROBLEMS_MAX` that are known, by line.
    """

    def __init__(self, file: str, problems: Sequence[Problem]) -> None:
        self.file = file
        found = sorted(problems, key=lambda problem: problem.line)
        more = len(found) - PROBLEMS_MAX
        if more > 0:
            found[PROBLEMS_MAX:] = [Problem(found[PROBLEMS_MAX].line, None, f"and {more} more from here on")]
        self.problems = tuple(found)
        super().__init__("\n".join(f"{file}: {problem}" for problem in self.problems))


class ShowError(FileError):
    """A show that cannot be flown."""


class InvalidError(GcsError):
    """A value that can never be accepted.

    Attributes:
        field: dotted name as the caller knows it, for example ``radius_m``.
        value: what was given.
        allowed: what would be right, in words or numbers, units included.
    """

    def __init__(self, field: str, value: object, allowed: str) -> None:
        super().__init__(f"{field} = {cut(str(value))}: {allowed}")
        self.field = field
        self.value = value
        self.allowed = allowed


class AccessError(GcsError):
    """The caller's token does not allow it, or it called too often; the text says what would."""


class RefusedError(GcsError):
    """A request that is proper but not now; the text says why and what to do."""


class UnknownError(GcsError):
    """Something named does not exist."""


class LinkError(GcsError):
    """A transport failed; whoever supervises the link retries."""


class CommandError(LinkError):
    """A vehicle refused an order, or its obedience was not seen in time."""
