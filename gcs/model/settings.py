"""Base of all settings (frozen, no unknown keys, finite numbers), and what published dataclasses share."""

from dataclasses import dataclass
from functools import cache
from math import isfinite
from types import UnionType
from typing import Annotated, Final, TypeAlias, Union, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

Positive: TypeAlias = Annotated[float, Field(gt=0)]
NotNegative: TypeAlias = Annotated[float, Field(ge=0)]


def _known(value: object) -> object:
    """Convert NaN and infinities to None (not known)."""
    return None if isinstance(value, float) and not isfinite(value) else value


Measured: TypeAlias = Annotated[float | None, BeforeValidator(_known)]
"""A number that may be unknown: NaN in arrays, null in JSON."""

PUBLISHED: Final = ConfigDict(json_schema_serialization_defaults_required=True)
"""`__pydantic_config__` of dataclasses that the API returns: fields with a default are in every answer."""


class Settings(BaseModel):
    """Base of every group; `gcs.config` reads them from YAML, tests and tools construct them directly."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,  # what the reference says of each key
    )

    @model_validator(mode="before")
    @classmethod
    def _no_numbers_in_words(cls, values: object) -> object:
        """Refuse strings and booleans for numbers; pydantic would convert them."""
        if not isinstance(values, dict):
            return values
        return {
            key: _Word(value) if isinstance(value, str | bool) and _is_number(cls, key) else value
            for key, value in values.items()
        }


@dataclass(frozen=True, slots=True)
class _Word:
    """A value refused where a number is needed."""

    value: str | bool

    def __repr__(self) -> str:
        return repr(self.value)


@cache
def _is_number(model: type[BaseModel], key: str) -> bool:
    field = model.model_fields.get(key)
    return field is not None and _kinds(field.annotation) - {type(None)} <= {int, float}


def _kinds(annotation: object) -> frozenset[object]:
    """The types that an annotation allows; all members of a union."""
    if get_origin(annotation) is Annotated:
        return _kinds(get_args(annotation)[0])
    if get_origin(annotation) in {Union, UnionType}:
        return frozenset().union(*(_kinds(each) for each in get_args(annotation)))
    return frozenset({annotation})
