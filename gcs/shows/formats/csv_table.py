"""Reads a CSV file of numbers that is not trusted: rows, columns and lines are bounded.

Files of other programs may have comments from a # on, empty lines, and a comma at the end of each row.
"""

import re
from typing import Final

import numpy as np

from gcs.model.errors import DrawingError, quoted
from gcs.model.state import Array

ROWS_MAX: Final = 200_000
"""Of one drone: two hours at 27 Hz."""

NUMBERS_MAX: Final = 4_700_000
"""Of all drones together: 500 for five minutes at 4 Hz."""

NEEDED: Final = "rows of numbers with commas between them are needed"
LINE_MAX: Final = 2_000
"""Characters of a row; one of 33 polynomial coefficients has some 600."""


def table(data: bytes, place: str, columns: tuple[int, ...]) -> Array:
    """(k, c) Numbers of a file, with or without a line of names before them, with c one of `columns`.

    Raises: DrawingError.
    """
    if max(data.count(b"\n"), data.count(b"\r")) > ROWS_MAX:
        raise DrawingError(place, f"more than {ROWS_MAX} rows")
    if data.count(b",") > NUMBERS_MAX:
        raise DrawingError(place, f"more than {NUMBERS_MAX} numbers")
    try:
        lines = data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    except UnicodeDecodeError as error:
        wrong = f"byte {error.start} (0x{data[error.start]:02x}) is not UTF-8"
        raise DrawingError(place, f"{wrong}: save the file as CSV in UTF-8") from None
    if max(map(len, lines)) > LINE_MAX:
        raise DrawingError(place, f"a line of more than {LINE_MAX} characters")
    written = [(at, row) for at, line in enumerate(lines, start=1) if (row := _row(line))]
    if written and _is_names(written[0][1]):
        _, names = written.pop(0)
        if text := _misnamed(names.split(",")):
            raise DrawingError(place, text)
    if not written:
        raise DrawingError(place, f"{NEEDED}, it has none")
    try:
        rows: Array = np.loadtxt([row for _, row in written], delimiter=",", comments=None, ndmin=2)
    except ValueError:
        raise _wrong(written, place) from None
    if rows.shape[1] not in columns:
        needed = " or ".join(f"{count} ({MEANING[count]})" for count in columns)
        raise DrawingError(place, f"{rows.shape[1]} columns: {needed} are needed")
    return rows


MEANING: Final = {
    4: "time in ms, x, y, z in m",
    7: "time in ms, x, y, z in m, red, green, blue",
    33: "duration in s, 8 coefficients each of x, y, z, yaw",
}
"""Of rows with so many columns."""


def _row(line: str) -> str:
    """Return a row without its comment and a comma at its end; empty: there is none on this line."""
    return line.partition("#")[0].strip().removesuffix(",")


def _is_names(row: str) -> bool:
    """Whether these are the names of the columns."""
    first = row.lstrip("\"' ").lower()
    return first[:1].isalpha() and not first.startswith(("nan", "inf"))


MEANT: Final = (("time", "t"), ("x",), ("y",), ("z",), ("red", "r"), ("green", "g"), ("blue", "b"))
"""Names of the columns of a sampled trajectory, in their order: time in ms, metres, and a colour."""

OTHER_TIMES: Final = frozenset(
    {"s", "sec", "secs", "second", "seconds", "min", "us", "usec", "frame", "frames"}
)
OTHER_LENGTHS: Final = frozenset({"ft", "feet", "foot", "inch", "inches", "mm", "cm", "km", "yd"})


def _misnamed(names: list[str]) -> str:
    """Return how the names of 4 or 7 columns contradict their order or units; empty: they do not."""
    if len(names) not in {4, len(MEANT)}:
        return ""
    for at, name in enumerate(names):
        first, *units = re.findall("[a-z]+", name.lower()) or [""]
        if any(first in meant for meant in MEANT[:at] + MEANT[at + 1 :]):
            return f"column {at + 1} is called {quoted(name)}: {MEANT[at][0]} is needed there"
        if OTHER_TIMES.intersection((first, *units)) if at == 0 else OTHER_LENGTHS.intersection(units):
            unit = "milliseconds" if at == 0 else "metres"
            return f"column {at + 1} is called {quoted(name)}: {unit} are needed"
    return ""


def _wrong(written: list[tuple[int, str]], place: str) -> DrawingError:
    """Return what is wrong with the first row that is not as many numbers as the one before."""
    count = written[0][1].count(",") + 1
    for at, row in written:
        values = row.split(",")
        wrong = next((value for value in values if not _is_number(value)), None)
        if len(values) != count:
            return DrawingError(place, f"{NEEDED}: line {at} has {len(values)} values, {count} as before")
        if wrong is not None:
            return DrawingError(place, f"{NEEDED}: line {at}: {quoted(wrong)} is not a number")
    return DrawingError(place, NEEDED)


def _is_number(value: str) -> bool:
    try:
        float(value)
    except ValueError:
        return False
    return True
