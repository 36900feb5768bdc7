"""Checklists by role: read from a file, signed item by item, and open again after what makes them untrue."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from pydantic import BeforeValidator, Field, TypeAdapter, ValidationError

from gcs.config import yaml_files
from gcs.config.yaml_files import Source
from gcs.model.errors import FileError, InvalidError, Problem, UnknownError
from gcs.model.preflight_report import Check, State
from gcs.model.settings import Settings
from gcs.model.state import VehicleId
from gcs.service.go import Checklist, ChecklistItem

ROLES_MAX, ITEMS_MAX, TEXT_MAX = 16, 64, 200

NAMED_MAX: Final = 3
"""Open items that a check names."""


class Reopening(StrEnum):
    """What opens an item again. A landing opens all."""

    SHOW = "show"  # another show is selected, or none
    PARAMETERS = "parameters"  # a vehicle's parameters are read, and differ from those read before


class _ListedItem(Settings):
    """An item of the file."""

    text: Annotated[str, Field(pattern=r"\S", max_length=TEXT_MAX)]
    kept_over: Annotated[tuple[Reopening, ...], Field(max_length=len(Reopening))] = ()


def _as_item(value: object) -> object:
    return {"text": value} if isinstance(value, str) else value


_Role: TypeAlias = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,31}$")]
_Items: TypeAlias = Annotated[
    tuple[Annotated[_ListedItem, BeforeValidator(_as_item)], ...], Field(min_length=1, max_length=ITEMS_MAX)
]
_FILE: Final[TypeAdapter[dict[str, tuple[_ListedItem, ...]]]] = TypeAdapter(
    Annotated[dict[_Role, _Items], Field(min_length=1, max_length=ROLES_MAX)]
)
SHAPE: Final = (
    f"up to {ROLES_MAX} roles in small letters, each a list of up to {ITEMS_MAX} items: texts of up to"
    f" {TEXT_MAX} characters, or text: with kept_over: [show, parameters]"
)


@dataclass(frozen=True, slots=True)
class SignedFor:
    """What signatures are given for: the selected show (empty: none), and each vehicle's parameters."""

    show: str = ""
    parameters: Mapping[VehicleId, str] = field(default_factory=dict)  # digests


def read_checklists(path: Path | None) -> "Checklists":
    """Read the file; None: there are no checklists. Raises: ConfigError that names the file and the line."""
    return Checklists({}) if path is None else parse_checklists(yaml_files.read(path), str(path))


def parse_checklists(text: str, source: str) -> "Checklists":
    """Read `text`; `source` names it in errors. Raises: ConfigError."""
    written = Source(text, source)
    raw = written.mapping(SHAPE)
    try:
        return Checklists(_FILE.validate_python(raw))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        loc = [part for part in first["loc"] if part != "[key]"]
        at = ".".join(map(str, loc))
        raise FileError(source, [Problem(written.line(*loc), None, f"{at}: {SHAPE}")]) from None


class Checklists:
    """All items with their signatures. Time and names come in as arguments."""

    def __init__(self, lists: Mapping[str, Sequence[_ListedItem]]) -> None:
        self._lists = {role: tuple(items) for role, items in lists.items()}
        self._signed: dict[tuple[str, int], tuple[str, float]] = {}  # name and Unix time, by role and number
        self._show, self._parameters = "", dict[VehicleId, str]()

    def sign(self, role: str, numbers: Sequence[int], by: str, unix_s: float) -> None:
        """Sign items of a role; the newest signature counts. Raises: UnknownError, InvalidError."""
        for number in self._checked(role, numbers):
            self._signed[role, number] = by, unix_s

    def reopen(self, role: str, numbers: Sequence[int]) -> None:
        """Take signatures back. Raises: UnknownError, InvalidError."""
        for number in self._checked(role, numbers):
            self._signed.pop((role, number), None)

    def _checked(self, role: str, numbers: Sequence[int]) -> Sequence[int]:
        items = self._lists.get(role)
        if items is None:
            raise UnknownError(
                f"there is no checklist {role!r}; there are {', '.join(self._lists) or 'none'}"
            )
        for number in numbers:
            if not 1 <= number <= len(items):
                raise InvalidError("items", number, f"from 1 to {len(items)}: the items of {role}")
        if not numbers:
            raise InvalidError("items", "none", f"at least one of the {len(items)} items of {role}")
        return numbers

    def note(self, seen: SignedFor) -> int:
        """Open what another show or other parameters make untrue.

        Parameters that are read for the first time open nothing: vehicles are switched on one by one.
        Those of a vehicle that is silent meanwhile are remembered.

        Returns: how many items were open again by that.
        """
        changed = set[Reopening]()
        if seen.show != self._show:
            changed.add(Reopening.SHOW)
        before = self._parameters
        if any(before.get(name, digest) != digest for name, digest in seen.parameters.items()):
            changed.add(Reopening.PARAMETERS)
        self._show = seen.show
        self._parameters |= seen.parameters
        return self._drop(lambda item: not changed.issubset(item.kept_over)) if changed else 0

    def note_landing(self) -> int:
        """Open everything: the next start is another flight. Returns: how many items were signed."""
        return self._drop(lambda _: True)

    def _drop(self, opens: Callable[[_ListedItem], bool]) -> int:
        dropped = [(role, number) for role, number in self._signed if opens(self._lists[role][number - 1])]
        for each in dropped:
            del self._signed[each]
        return len(dropped)

    def view(self) -> tuple[Checklist, ...]:
        """All lists with their signatures."""
        return tuple(
            Checklist(
                role,
                tuple(
                    ChecklistItem(item.text, *self._signed.get((role, number), ("", None)))
                    for number, item in enumerate(items, 1)
                ),
            )
            for role, items in self._lists.items()
        )

    def checks(self) -> Iterator[Check]:
        """Yield one check for each role."""
        for each in self.view():
            name, limit = f"checklist {each.role}", "every item is signed"
            if not (numbers := each.open):
                yield Check(name, State.PASS, 0, "open items", limit)
                continue
            # not "1.": the causes of a refused start are numbered like that
            texts = "; ".join(f"({number}) {each.items[number - 1].text}" for number in numbers[:NAMED_MAX])
            more = f"; and {len(numbers) - NAMED_MAX} more" if len(numbers) > NAMED_MAX else ""
            problem = (
                f"checklist {each.role}: {len(numbers)} of {len(each.items)} items are open: {texts}{more}"
            )
            to_do = f"do them, and sign each: gcs sign {each.role} NUMBER"
            yield Check(name, State.FAIL, len(numbers), "open items", limit, problem, to_do)
