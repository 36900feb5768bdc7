"""What a feature reports, and what describes its fields: for displays, metrics, frames and `gcs status`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, TypeAlias, get_args, get_type_hints

from pydantic import GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

Line: TypeAlias = Iterator[tuple[str, Literal["", "bad", "urgent"]]]
"""Parts of a line, each with how much it matters."""


@dataclass(frozen=True, slots=True)
class Described:
    """What a field is, for the schema and its metric: a gauge, a count of whole numbers, or a word."""

    text: str
    metric: str = ""  # empty: it has none
    moves: bool = True  # it changes by itself, and no display is sent a new status for it

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return handler(schema) | {"description": self.text}


Metric: TypeAlias = tuple[Described, str, int | float | str | None, tuple[str, ...]]
"""What describes a field, its name, its value, and what it may be; nothing: any, or a number."""


class FeatureView:
    """What one feature reports."""

    __slots__ = ()
    described: ClassVar[dict[str, tuple[Any, Described]]]  # type of each such field, and what it is

    def __init_subclass__(cls) -> None:
        hints = {key: get_args(hint) for key, hint in get_type_hints(cls, include_extras=True).items()}
        cls.described = {
            key: (kind[0], about)
            for key, kind in hints.items()
            for about in kind[1:]
            if isinstance(about, Described)
        }

    def line(self, unix_time_s: float) -> Line:  # noqa: ARG002
        """How it is, for `gcs status`; without parts: nothing is to be said."""
        return iter(())

    def table(self) -> Iterator[Sequence[str]]:
        """All of it for a terminal: rows of cells, heads with their units first; one cell is a line."""
        return iter(())

    @property
    def parts(self) -> Sequence["FeatureView"]:
        """Views in it that have metrics of their own."""
        return ()

    @property
    def metrics(self) -> Iterator[Metric]:
        for key, (kind, about) in self.described.items():
            value = getattr(self, key)
            if about.metric:
                words = get_args(kind) if isinstance(value, str) else ()
                yield about, key, value, words
        for part in self.parts:
            yield from part.metrics

    def at_rest(self) -> "FeatureView":
        """Return it without what moves, to be compared."""
        moving = [key for key, (_, about) in self.described.items() if about.moves]
        return replace(self, **dict.fromkeys(moving))  # type: ignore[type-var]
