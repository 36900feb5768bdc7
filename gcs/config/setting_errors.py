"""Error messages for settings: key, value, what is allowed, the key that was meant."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Final, NamedTuple, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from gcs.config.yaml_source import Loc, Source
from gcs.model.errors import ConfigError, FileError, Problem
from gcs.model.quoting import cut, quoted

LOCATED: Final = "located"
KEYS_REPORTED: Final = 12
"""Of a section: so many are named where none is like the one that was written."""

_WORDS: Final[Mapping[str, Callable[[Mapping[str, Any]], str]]] = {
    "float_type": lambda _: "a number is needed",
    "float_parsing": lambda _: "a number is needed",
    "finite_number": lambda _: "a number is needed, neither infinite nor nan",
    "int_type": lambda _: "a whole number is needed",
    "int_parsing": lambda _: "a whole number is needed",
    "int_from_float": lambda _: "a whole number is needed",
    "bool_type": lambda _: "true or false is needed",
    "bool_parsing": lambda _: "true or false is needed",
    "string_type": lambda _: "text is needed",
    "path_type": lambda _: "a file or folder is needed",
    "tuple_type": lambda _: "a list is needed",
    "list_type": lambda _: "a list is needed",
    "dict_type": lambda _: "a section is needed",
    "greater_than": lambda ctx: f"must be greater than {ctx['gt']:g}",
    "greater_than_equal": lambda ctx: f"at least {ctx['ge']:g}",
    "less_than": lambda ctx: f"must be less than {ctx['lt']:g}",
    "less_than_equal": lambda ctx: f"at most {ctx['le']:g}",
    "literal_error": lambda ctx: f"one of {ctx['expected']}",
    "enum": lambda ctx: f"one of {ctx['expected']}",
    "too_short": lambda ctx: f"at least {ctx['min_length']} entries are needed",
    "too_long": lambda ctx: f"at most {ctx['max_length']} entries are possible",
    "string_too_short": lambda ctx: f"at least {ctx['min_length']} characters are needed",
    "string_too_long": lambda ctx: f"at most {ctx['max_length']} characters are possible",
    "union_tag_invalid": lambda ctx: f"one of {ctx['expected_tags']}",
}


class Misfit(NamedTuple):
    """One thing that is wrong, and the way to it."""

    loc: Loc
    key: str
    value: str | None  # as it was written; None: a section, a list, or missing
    text: str

    def __str__(self) -> str:
        value = "" if self.value is None else f" = {self.value}"
        return f"{self.key}{value}: {self.text}" if self.key else self.text


def located(text: str, *loc: str | int) -> PydanticCustomError:
    """For a validator to raise: what is wrong with the value that `loc` leads to, from where it stands."""
    return PydanticCustomError(LOCATED, "{text}", {"text": text, "loc": list(loc)})


def explained(
    error: ValidationError, file: str, model: type[BaseModel], source: Source | None
) -> ConfigError:
    """What a reader of `file` can mend: every key, its value and what would be right.

    With the lines, where the `source` is given.
    """
    found = misfits(error, model, source)
    if source is None:
        return ConfigError(f"{file}: " + "; ".join(map(str, found)))
    return FileError(file, [Problem(source.line(*misfit.loc), None, str(misfit)) for misfit in found])


def misfits(error: ValidationError, model: type[BaseModel], source: Source | None) -> list[Misfit]:
    """Each once: what only follows from something inside it is left out."""
    problems = [_with_whole_loc(problem) for problem in error.errors()]
    return [_misfit(problem, model, source) for problem in problems if not _follows(problem["loc"], problems)]


def _with_whole_loc(problem: ErrorDetails) -> ErrorDetails:
    if problem["type"] != LOCATED:
        return problem
    return ErrorDetails({**problem, "loc": (*problem["loc"], *problem["ctx"]["loc"])})


def _follows(loc: Loc, problems: Sequence[ErrorDetails]) -> bool:
    """Whether another lies inside: a list lacks what could not be read."""
    return any(len(other["loc"]) > len(loc) and other["loc"][: len(loc)] == loc for other in problems)


def _misfit(problem: ErrorDetails, model: type[BaseModel], source: Source | None) -> Misfit:
    loc, kind, value = problem["loc"], problem["type"], problem["input"]
    known = tuple(dict.fromkeys(_fields_at(model, loc[:-1]))) if kind == "extra_forbidden" else ()
    keys = loc if source is None else source.keys(*loc)
    if source is not None and kind in {"missing", LOCATED} and loc:
        keys = (*source.keys(*loc[:-1]), loc[-1])
    key = ".".join(cut(str(part)) for part in keys)
    if kind == "missing":
        return Misfit(loc, key, None, "is required, and missing")
    shown = source.written(*loc) if source is not None else None
    if source is None and not isinstance(value, dict | BaseModel | list | tuple):
        shown = quoted(value)
    if kind == "extra_forbidden":
        return Misfit(loc, key, shown, _unknown(str(loc[-1]), known))
    if kind == LOCATED:
        return Misfit(loc, key, shown, problem["ctx"]["text"])
    if kind in {"model_type", "model_attributes_type"}:
        return Misfit(loc, key, shown or "", _section(model, loc))
    words = _WORDS.get(kind)
    if words is not None:
        return Misfit(loc, key, shown, words(problem.get("ctx", {})))
    text = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return Misfit(loc, key, shown if loc else None, text)


def _unknown(key: str, known: Sequence[str]) -> str:
    like = get_close_matches(key, known, 1)
    if like:
        return f"unknown key; did you mean {like[0]}?"
    more = ", ..." if len(known) > KEYS_REPORTED else ""
    return f"unknown key; known here: {', '.join(known[:KEYS_REPORTED])}{more}" if known else "unknown key"


def _section(model: type[BaseModel], loc: Loc) -> str:
    known = tuple(dict.fromkeys(_fields_at(model, loc)))
    return f"a section is needed, with {', '.join(known[:KEYS_REPORTED])}" if known else "a section is needed"


def _fields_at(model: type[BaseModel], loc: Loc) -> Iterator[str]:
    """The keys of the section that `loc` leads to."""
    places: list[object] = [model]
    for part in loc:
        places = list(_inside(places, part)) or places  # a part that is no key names an alternative
    for one in _sections(places):
        yield from one.model_fields


def _inside(places: Sequence[object], part: str | int) -> Iterator[object]:
    for one in _sections(places):
        if part in one.model_fields:
            yield one.model_fields[str(part)].annotation
    if isinstance(part, int):
        yield from places  # of a list: what is in it is looked for by `_sections`


def _sections(places: Sequence[object]) -> Iterator[type[BaseModel]]:
    """Every model that these annotations name."""
    for place in places:
        if isinstance(place, type) and issubclass(place, BaseModel):
            yield place
        else:
            yield from _sections(get_args(place))
