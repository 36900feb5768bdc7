"""Output of commands: text, or with `--json` one document or one object per line, for errors as well.

An error is one line on standard error, in one shape (docs/operations/administrator.md, Programs):

    {"error": {"exit_code": 2, "detail": "...", "problems": [...], "notes": [...]}}

This module has no slow imports, because every command loads it.
"""

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NoReturn

from gcs.cli.outlet import Outlet
from gcs.model import errors
from gcs.model.errors import ConfigError, GcsError

JSON: Final = "--json"
WRONG: Final = 2
REFUSED: Final = 1

EXIT_CODES: Final[dict[type[GcsError], int]] = {
    errors.AccessError: 4,
    ConfigError: WRONG,
    errors.InvalidError: WRONG,
    errors.CommandError: REFUSED,
    errors.LinkError: 3,
}


def kinds(counts: Mapping[str, int]) -> str:
    """How many vehicles have each autopilot, in words."""
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()) if name)


NEGATIVE: Final = re.compile(r"-\.?[0-9]")
"""How a value that begins with a minus begins, for example a list of coordinates; no option does so."""


class Parser(argparse.ArgumentParser):
    """A parser that prints errors as JSON if `--json` was given, and that knows its subcommands."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._negative_number_matcher = NEGATIVE  # argparse's own matches one number, but no list of them
        self._inside: Mapping[str, Parser] = {}
        self._is_json = False

    def add_subparsers(self, **options: Any) -> Any:
        added = super().add_subparsers(**options)
        self._inside = added.choices
        return added

    def leaves(self) -> "Iterator[Parser]":
        """Yield the parsers without subcommands: this one, or those inside it."""
        if not self._inside:
            yield self
        for each in self._inside.values():
            yield from each.leaves()

    def parse_known_args(  # type: ignore[override] # argparse's two overloads are equal for one namespace
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As in argparse; looks for `--json` before any other argument is read."""
        self._is_json = is_json(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        if self._is_json:
            fail(message, WRONG, as_json=True)
            raise SystemExit(WRONG)
        super().error(message)


def is_json(given: Sequence[str]) -> bool:
    return JSON in (given[: given.index("--")] if "--" in given else given)


def print_json(value: Any, *, indent: int | None = 2) -> None:
    """Print one document. NaN and infinities become `null`."""
    print(_dumped(value, indent), flush=indent is None)


def answer(arguments: argparse.Namespace, document: Any, text: str, *, indent: int | None = 2) -> None:
    if arguments.json:
        print_json(document, indent=indent)
    elif text:
        print(errors.visible(text))


def failed(error: GcsError, arguments: argparse.Namespace, code: int | None = None) -> int:
    """Print an error. Returns: the exit code: `code`, or that of the error's class."""
    code = exit_code(error) if code is None else code
    notes = tuple(getattr(error, "__notes__", ()))
    station = station_of(arguments)
    fail(str(error), code, as_json=arguments.json, problems=_problems(error), notes=notes, station=station)
    return code


def exit_code(error: GcsError) -> int:
    return next((code for kind, code in EXIT_CODES.items() if isinstance(error, kind)), REFUSED)


def fail(
    detail: str,
    code: int,
    *,
    as_json: bool,
    problems: Sequence[Mapping[str, object]] = (),
    notes: Sequence[str] = (),
    station: str | None = None,
) -> None:
    """Print an error; `station` names the one of several stations that has it."""
    if as_json:
        named = {} if station is None else {"station": station}
        error = {"exit_code": code, "detail": detail, "problems": list(problems), "notes": list(notes)}
        print(_dumped({"error": named | error}, None), file=sys.stderr)
        return
    for text in (detail, *notes):
        prefix = "" if station is None else f"{station}: "
        print(errors.visible(f"{prefix}gcs: {text}"), file=sys.stderr)


def station_of(arguments: argparse.Namespace) -> str | None:
    """The station given with `--station`, which all lines name then."""
    found: str | None = getattr(arguments, "station", None)
    return found


def noted(text: str, *, as_json: bool) -> str:
    return _dumped({"note": text}, None) if as_json else errors.visible(f"gcs: {text}")


def note(text: str, *, as_json: bool) -> None:
    print(noted(text, as_json=as_json), file=sys.stderr, flush=True)


Say = Callable[..., None]
"""Prints an event of a long-running command: `say(event, text, **facts)`."""


def lines(arguments: argparse.Namespace) -> Say:
    """Return a function that prints text lines or, with `--json`, objects of event, text and facts.

    With `--station` each line names it. A terminal that is gone or does not read is not waited for.
    """
    station = station_of(arguments)
    named = {} if station is None else {"station": station}
    prefix = "" if station is None else f"{station}: "

    def line(event: str, text: str, **facts: object) -> str:
        whole = {"event": event, **named, "text": text, **facts}
        return _dumped(whole, None) if arguments.json else errors.visible(f"{prefix}{text}")

    outlet = Outlet(
        sys.stdout, lambda count: line("lines_not_written", f"({count} lines dropped)", count=count)
    )
    return lambda event, text, **facts: outlet.write(line(event, text, **facts))


def _problems(error: GcsError) -> list[dict[str, object]]:
    """List the single problems of an error, if known: lines of a file, or a field as the API names it."""
    if isinstance(error, errors.FileError):
        cues = isinstance(error, errors.ShowError)
        return [
            {"file": error.file, "line": one.line, **({"cue": one.cue} if cues else {}), "text": one.text}
            for one in error.problems
        ]
    if isinstance(error, errors.InvalidError):
        plain = error.value is None or isinstance(error.value, str | int | float | bool)
        value = error.value if plain else errors.quoted(error.value)
        return [{"field": error.field, "value": value, "allowed": error.allowed}]
    return []


def _dumped(value: Any, indent: int | None) -> str:
    try:
        return json.dumps(value, indent=indent, allow_nan=False)
    except ValueError:
        return json.dumps(_finite(value), indent=indent, allow_nan=False)


def _finite(value: Any) -> Any:
    """Replace NaN and infinities by None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return value


UNITS: Final = frozenset({"s", "m", "m/s"})


def aligned(rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table, the heads first; a row with one cell is a line above it.

    A column with a unit at the end of its head is aligned at its end. No cell is cut.
    """
    cells = list(rows)
    heads, *others = table = [row for row in cells if len(row) > 1]
    yield from (row[0] for row in cells if len(row) == 1)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table if others else ():
        found = zip(heads, row, widths, strict=True)
        padded = (
            text.rjust(width) if head.split()[-1] in UNITS else text.ljust(width)
            for head, text, width in found
        )
        yield "  ".join(padded).rstrip()


PICTURES: Final = (".png", ".svg", ".pdf")
MOVING: Final = ".gif"


def output_file(name: str, suffixes: Sequence[str], option: str = "-o ") -> Path:
    """Return the path of a file to write. Raises: ConfigError for another suffix, or a missing folder."""
    file = Path(name)
    if file.suffix.lower() not in suffixes:
        raise ConfigError(f"{option}{file}: a name that ends with {' or '.join(suffixes)} is needed")
    if not file.parent.is_dir():
        raise ConfigError(f"{option}{file}: there is no folder {file.parent}: make it first")
    return file


def require_matplotlib(what: str) -> None:
    """Check for matplotlib before the flight to be drawn. Raises: ConfigError that names the extra."""
    if find_spec("matplotlib") is None:
        raise ConfigError(
            f"{what} needs matplotlib, which is not installed; to install it:"
            " pip install 'formation-gcs[plots]'"
        )


def require_stations(what: str, module: str) -> None:
    """Check for a module of the extra `stations`. Raises: ConfigError that names the extra."""
    if find_spec(module) is None:
        raise ConfigError(
            f"{what} needs {module}, which is not installed; to install it:"
            " pip install 'formation-gcs[stations]'"
        )
