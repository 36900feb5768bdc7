"""Error messages for settings: key, value, what is allowed, and the probable key for a misspelt one."""

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import Final, NamedTuple, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from gcs.config.yaml_files import Loc, Source
from gcs.model.errors import ConfigError, FileError, Problem, cut, quoted

LOCATED: Final = "located"
KEYS_REPORTED: Final = 12
"""Most keys of a section that an error names when none resembles the unknown key."""

_WORDS: Final = {
    kind: words
    for kinds, words in (
        ("float_type float_parsing", "a number is needed"),
        ("finite_number", "a number is needed, neither infinite nor nan"),
        ("int_type int_parsing int_from_float", "a whole number is needed"),
        ("bool_type bool_parsing", "true or false is needed"),
        ("string_type", "text is needed"),
        ("path_type", "a file or folder is needed"),
        ("tuple_type list_type", "a list is needed"),
        ("dict_type", "a section is needed"),
        ("greater_than", "must be greater than {gt:g}"),
        ("greater_than_equal", "at least {ge:g}"),
        ("less_than", "must be less than {lt:g}"),
        ("less_than_equal", "at most {le:g}"),
        ("literal_error enum", "one of {expected}"),
        ("too_short", "at least {min_length} entries are needed"),
        ("too_long", "at most {max_length} entries are possible"),
        ("string_too_short", "at least {min_length} characters are needed"),
        ("string_too_long", "at most {max_length} characters are possible"),
        ("union_tag_invalid", "one of {expected_tags}"),
    )
    for kind in kinds.split()
}


class Misfit(NamedTuple):
    """One problem and its location."""

    loc: Loc
    key: str
    value: str | None  # as in the file; None: a section, a list, or missing
    text: str

    def __str__(self) -> str:
        value = "" if self.value is None else f" = {self.value}"
        return f"{self.key}{value}: {self.text}" if self.key else self.text


def located(text: str, *loc: str | int) -> PydanticCustomError:
    """Make the error that a validator raises for the value at `loc`, relative to the validated model."""
    return PydanticCustomError(LOCATED, "{text}", {"text": text, "loc": list(loc)})


def explained(
    error: ValidationError, file: str, model: type[BaseModel], source: Source | None
) -> ConfigError:
    """Convert to a ConfigError with every wrong key, its value and what is allowed.

    With `source` it also has the line numbers.
    """
    problems = misfits(error, model, source)
    if source is None:
        return ConfigError(f"{file}: " + "; ".join(map(str, problems)))
    return FileError(file, [Problem(source.line(*misfit.loc), None, str(misfit)) for misfit in problems])


def misfits(error: ValidationError, model: type[BaseModel], source: Source | None) -> list[Misfit]:
    """List the problems, without those that only follow from a problem inside the same value."""
    problems = [_with_whole_loc(problem) for problem in error.errors()]
    return [_misfit(problem, model, source) for problem in problems if not _follows(problem["loc"], problems)]


def _with_whole_loc(problem: ErrorDetails) -> ErrorDetails:
    if problem["type"] != LOCATED:
        return problem
    return ErrorDetails({**problem, "loc": (*problem["loc"], *problem["ctx"]["loc"])})


def _follows(loc: Loc, problems: Sequence[ErrorDetails]) -> bool:
    """Whether another problem lies inside `loc`: a list lacks its entries that could not be read."""
    return any(len(other["loc"]) > len(loc) and other["loc"][: len(loc)] == loc for other in problems)


def _misfit(problem: ErrorDetails, model: type[BaseModel], source: Source | None) -> Misfit:
    loc, kind, value = problem["loc"], problem["type"], problem["input"]
    allowed = tuple(dict.fromkeys(_fields_at(model, loc[:-1]))) if kind == "extra_forbidden" else ()
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
        return Misfit(loc, key, shown, _unknown(str(loc[-1]), allowed))
    if kind == LOCATED:
        return Misfit(loc, key, shown, problem["ctx"]["text"])
    if kind in {"model_type", "model_attributes_type"}:
        return Misfit(loc, key, shown or "", _section(model, loc))
    words = _WORDS.get(kind)
    if words is not None:
        return Misfit(loc, key, shown, words.format_map(problem.get("ctx", {})))
    text = problem["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return Misfit(loc, key, shown if loc else None, text)


def _unknown(key: str, allowed: Sequence[str]) -> str:
    like = get_close_matches(key, allowed, 1)
    if like:
        return f"unknown key; did you mean {like[0]}?"
    more = ", ..." if len(allowed) > KEYS_REPORTED else ""
    return (
        f"unknown key; known here: {', '.join(allowed[:KEYS_REPORTED])}{more}" if allowed else "unknown key"
    )


def _section(model: type[BaseModel], loc: Loc) -> str:
    allowed = tuple(dict.fromkeys(_fields_at(model, loc)))
    return (
        f"a section is needed, with {', '.join(allowed[:KEYS_REPORTED])}"
        if allowed
        else "a section is needed"
    )


def _fields_at(model: type[BaseModel], loc: Loc) -> Iterator[str]:
    places: list[object] = [model]
    for part in loc:
        places = list(_inside(places, part)) or places  # a part that is not a key names an alternative
    for section in _sections(places):
        yield from section.model_fields


def _inside(places: Sequence[object], part: str | int) -> Iterator[object]:
    for section in _sections(places):
        if part in section.model_fields:
            yield section.model_fields[str(part)].annotation
    if isinstance(part, int):
        yield from places  # a list: `_sections` looks for the models in it


def _sections(places: Sequence[object]) -> Iterator[type[BaseModel]]:
    for place in places:
        if isinstance(place, type) and issubclass(place, BaseModel):
            yield place
        else:
            yield from _sections(get_args(place))
