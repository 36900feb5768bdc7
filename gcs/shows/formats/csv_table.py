"""Reads a CSV file of numbers that is not trusted: rows, columns and lines are bounded."""

from typing import Final

import numpy as np

from gcs.model.errors import DrawingError, cut
from gcs.model.state import Array

ROWS_MAX: Final = 200_000
"""Of one drone: two hours at 27 Hz."""

NUMBERS_MAX: Final = 4_700_000
"""Of all drones together: 500 for five minutes at 4 Hz."""

LINE_MAX: Final = 2_000
"""Characters of a row; one of 33 polynomial coefficients has some 600."""


def table(data: bytes, place: str, columns: tuple[int, ...]) -> Array:
    """(k, c) Numbers of a file, with or without a line of names before them, with c one of `columns`.

    Raises: DrawingError.
    """
    if data.count(b"\n") > ROWS_MAX:
        raise DrawingError(place, f"more than {ROWS_MAX} rows")
    if data.count(b",") > NUMBERS_MAX:
        raise DrawingError(place, f"more than {NUMBERS_MAX} numbers")
    try:
        lines = data.decode("utf-8-sig").split("\n")
    except UnicodeDecodeError as error:
        raise DrawingError(place, f"not text: {error}") from None
    if max(map(len, lines)) > LINE_MAX:
        raise DrawingError(place, f"a line of more than {LINE_MAX} characters")
    first = lines[0].strip().lower()
    named = first[:1].isalpha() and not first.startswith(("nan", "inf"))
    if not any(line.strip() for line in lines[named:]):
        raise DrawingError(place, "rows of numbers are needed, it has none")
    try:
        rows: Array = np.loadtxt(lines[named:], delimiter=",", comments=None, ndmin=2)
    except ValueError as error:  # names the row, from 1, and the text that is no number
        raise DrawingError(place, f"rows of numbers are needed: {cut(str(error))}") from None
    if rows.shape[1] not in columns:
        raise DrawingError(place, f"{rows.shape[1]} columns: {' or '.join(map(str, columns))} are needed")
    return rows
