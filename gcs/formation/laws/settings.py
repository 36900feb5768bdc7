"""Settings of the law that flies: the rates that all share, and those of each law by its own model."""

from collections.abc import Mapping
from typing import Annotated, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Field, SerializeAsAny, ValidationError

from gcs.formation.law import LawSettings
from gcs.formation.laws.registry import SHIPPED, law_at, place_of
from gcs.model.errors import InvalidError
from gcs.model.settings import Settings


def _checked(given: object) -> object:
    """Settings by the name of their law, each made by the model of that law."""
    if not isinstance(given, Mapping):
        return given
    return {name: _own(name, values) for name, values in given.items()}


class Unchecked(Settings):
    """Settings of a law of another package, whose model is known in its own process only."""

    model_config = ConfigDict(extra="allow")


def _own(name: str, values: object) -> Settings:
    try:
        place = place_of(name)
        kind = law_at(place).settings if name in SHIPPED else Unchecked
        return kind.model_validate(values.model_dump() if isinstance(values, Unchecked) else values)
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
