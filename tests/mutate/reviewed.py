"""Survivors that somebody has looked at, each with the reason why it may live: `survivors.yaml`."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import yaml
from pydantic import BaseModel, ConfigDict

from tests.mutate.mutants import Change

SURVIVORS = Path("tests/mutate/survivors.yaml")


class Line(BaseModel):
    """One line, and what it may become without any test noticing."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    function: str = ""
    was: str
    nth: int = 1
    becomes: tuple[str, ...]


class Group(BaseModel):
    """Survivors of one file that live for the same reason."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    file: str
    reason: str
    lines: tuple[Line, ...]

    def changes(self) -> list[Change]:
        """All of them, one by one."""
        return [
            Change(self.file, line.function, line.was, line.nth, becomes)
            for line in self.lines
            for becomes in line.becomes
        ]


def load(path: Path) -> tuple[Group, ...]:
    """Every group of the reviewed file."""
    return tuple(Group.model_validate(raw) for raw in yaml.safe_load(path.read_text(encoding="utf-8")) or ())


def as_yaml(changes: Iterable[Change]) -> str:
    """To be pasted into the reviewed file, the reason to be written."""
    groups: dict[str, dict[tuple[str, str, int], list[str]]] = {}
    for one in changes:
        lines = groups.setdefault(one.file, {})
        lines.setdefault((one.function, one.was, one.nth), []).append(one.becomes)
    raw = [
        {
            "file": file,
            "reason": "",
            "lines": [
                {"function": function, "was": was, **({"nth": nth} if nth > 1 else {}), "becomes": becomes}
                for (function, was, nth), becomes in lines.items()
            ],
        }
        for file, lines in groups.items()
    ]
    return yaml.safe_dump(raw, sort_keys=False, width=1000, allow_unicode=True)


def as_markdown(groups: Sequence[Group], survived: Mapping[Change, int]) -> str:
    """A heading a file, below it a list of reasons, each followed by the places, with today's lines."""
    parts = []
    for file in sorted({group.file for group in groups}):
        parts.append(f"### {file}")
        for group in groups:
            found = [one for one in group.changes() if one in survived]
            if group.file != file or not found:
                continue
            rows = [
                f"- {survived[one]}: {_code(one.was)} becomes {_code(one.becomes)}"
                for one in sorted(found, key=lambda one: survived[one])
            ]
            parts.append("\n".join([f"**{group.reason.strip()}**", "", *rows]))
    return "\n\n".join(parts)


def _code(text: str) -> str:
    return f"`{text}`"
