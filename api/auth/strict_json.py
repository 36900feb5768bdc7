"""Refuses JSON that Python's reader accepts but a request must not contain.

With a repeated name Python's reader would silently use the last value. Very deep JSON and very long numbers
are refused here, so that no later code has to handle them.
"""

import json
import re
from collections.abc import Iterator, Sequence
from typing import Any, Final

from starlette.datastructures import Headers

from gcs.api.errors import echo
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import cut

DEPTH_MAX: Final = 32
"""Most nested objects and lists; the deepest valid request has 3."""

DIGITS_MAX: Final = 300
"""Most digits of an integer; the largest float has 309."""

_MARKS: Final = re.compile(r'"(?:[^"\\]|\\.)*"?|[\[{]|[\]}]', re.DOTALL)


class _Twice(dict[str, Any]):
    """A JSON object with a repeated name."""

    def __init__(self, pairs: Sequence[tuple[str, Any]]) -> None:
        super().__init__(pairs)
        seen: set[str] = set()
        self.name = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]


class _Long(str):
    """The digits of an integer that is too long."""

    __slots__ = ()


def find_problem(headers: Headers, body: bytes) -> schemas.Problem | None:
    """Return the first problem of a body that is declared as JSON; None when it has none.

    A body that cannot be parsed as JSON also returns None: its route reports the error.
    """
    kind = headers.get("content-type", "").partition(";")[0].strip().lower()
    if not body.strip() or not (kind == "application/json" or kind.endswith("+json")):
        return None
    try:
        text = body.decode()
    except UnicodeDecodeError as error:
        return schemas.Problem(field="body", value=None, allowed=f"JSON in UTF-8; byte {error.start} is not")
    if text.count("[") + text.count("{") > DEPTH_MAX and _depth(text) > DEPTH_MAX:
        return schemas.Problem(field="body", value=None, allowed=f"JSON at most {DEPTH_MAX} levels deep")
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_int=_whole)
    except json.JSONDecodeError:
        return None
    return next(_problems(value, ()), None)


def _depth(text: str) -> int:
    """Nesting depth of objects and lists; counting stops above `DEPTH_MAX`."""
    depth = deepest = 0
    for mark in _MARKS.finditer(text):
        depth += (mark[0] in "[{") - (mark[0] in "]}")
        deepest = max(deepest, depth)
        if deepest > DEPTH_MAX:
            break
    return deepest


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    return made if len(made) == len(pairs) else _Twice(pairs)


def _whole(digits: str) -> int | _Long:
    return int(digits) if len(digits) <= DIGITS_MAX else _Long(digits)


def _problems(value: object, path: tuple[str, ...]) -> Iterator[schemas.Problem]:
    """Yield every problem inside a value, with the dotted name of its field."""
    if isinstance(value, _Twice):
        name = _field((*path, value.name))
        yield schemas.Problem(field=name, value=echo(value[value.name]), allowed="given once, not twice")
    if isinstance(value, _Long):
        allowed = f"a number of at most {DIGITS_MAX} digits"
        yield schemas.Problem(field=_field(path), value=echo(str(value)), allowed=allowed)
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _problems(part, (*path, name))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _problems(part, (*path, str(index)))


def _field(path: Sequence[str]) -> str:
    return cut(".".join(path)) or "body"
