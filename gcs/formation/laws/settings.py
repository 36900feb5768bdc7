"""Settings of the law that flies: the rates that all share, and those of each law by its own model."""

import json
from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Field, SerializeAsAny, ValidationError

from gcs.formation.law import LawSettings
from gcs.formation.laws.registry import SHIPPED, law_at, place_of
from gcs.model.errors import InvalidError
from gcs.model.settings import Settings

SETTINGS_MAX: Final = 32_768
"""Characters of one law's settings, as JSON: they go to its process as one of its arguments."""

DEPTH_MAX: Final = 8


def _checked(given: object) -> object:
    """Settings by the name of their law, each made by the model of that law."""
    if not isinstance(given, Mapping):
        return given
    return {name: of_law(name, values) for name, values in given.items()}


class Unchecked(Settings):
    """Settings of a law of another package, whose model is known in its own process only."""

    model_config = ConfigDict(extra="allow")


def _check_values(key: str, value: object, depth: int = 0) -> None:
    """Raises: ValueError unless it is what goes to a process: words, finite numbers, lists and groups."""
    if isinstance(value, Mapping | list | tuple):
        if depth >= DEPTH_MAX:
            raise ValueError(f"{key}: groups in groups; at most {DEPTH_MAX} are possible")
        pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
        for name, part in pairs:
            _check_values(f"{key}.{name}", part, depth + 1)
    elif isinstance(value, float) and not isfinite(value):
        raise ValueError(f"{key} = {value}: a finite number is needed")
    elif not (value is None or isinstance(value, str | int | float)):
        raise ValueError(f"{key} = {value!r}: a word, a number, a list or a group is needed")
    if depth == 0 and len(text := json.dumps(value)) > SETTINGS_MAX:
        raise ValueError(f"{key}: {len(text)} characters; at most {SETTINGS_MAX} are possible")


def of_law(name: str, values: object) -> Settings:
    """Settings of one law. Raises: ValueError, in words, for what it cannot have."""
    if name in LawSettings.model_fields:
        raise ValueError(f"{name}: its settings are those of control.law.{name}")
    try:
        place = place_of(name)
        given = values.model_dump() if isinstance(values, Settings) else values
        kind = law_at(place).settings if name in SHIPPED else Unchecked
        if kind is LawSettings:
            raise ValueError(f"{name}: its settings are those of control.law")
        if name in SHIPPED:
            return kind.model_validate(given)
        _check_values(name, given)
        return Unchecked.model_validate(given)
    except InvalidError as error:
        raise ValueError(f"{name}: {error.allowed}") from None
    except ValidationError as error:
        wrong = error.errors()[0]
        key = ".".join(map(str, (name, *wrong["loc"])))
        raise ValueError(f"{key} = {wrong['input']!r}: {wrong['msg']}") from None


OfLaws: TypeAlias = Annotated[dict[str, SerializeAsAny[Settings]], BeforeValidator(_checked)]


class FlownLawSettings(LawSettings):
    """Rates and limits of the law; docs/decisions/law.md says how they were found."""

    laws: OfLaws = Field(default_factory=dict)
    """Settings of further laws, by the name of each: `gcs law list` shows them."""

    def own(self, law: str, kind: type[Settings]) -> Settings:
        """The settings of a law, by its name and the model that it has for them."""
        if isinstance(self, kind):
            return self
        settings = getattr(self, law, self.laws.get(law))
        return settings if isinstance(settings, kind) else kind()

    def given(self, law: str) -> dict[str, object]:
        """What is configured for a law of another package, for its own process."""
        settings = self.laws.get(law)
        return {} if settings is None else settings.model_dump(mode="json")
