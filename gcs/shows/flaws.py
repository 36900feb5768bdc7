"""A problem of a show, before it has a line. Pure."""

from dataclasses import dataclass

from gcs.config.yaml_files import Loc


@dataclass(frozen=True, slots=True)
class Flaw:
    """A problem, and its path in the file."""

    loc: Loc
    text: str


def of_value(value: float | str, text: str, *loc: str | int) -> Flaw:
    """Return the flaw of a value; its path ends with its key."""
    return Flaw(loc, f"{loc[-1]} = {value if isinstance(value, str) else format(value, 'g')}: {text}")
