"""Events in plain words, whatever was logged."""

import ast
import re
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import NamedTuple

import pytest

from gcs.service.event_log import WORDS, words

ROOT = Path(__file__).parents[3]
PYTHON = re.compile(r"\('|\['|',\)|\{|\bNone\b|\bTrue\b|\bFalse\b|<|Path\(|\[")


class Colour(Enum):
    RED = "red"


class Logged(NamedTuple):
    """A line that the code logs."""

    where: str
    event: str
    fields: frozenset[str] | None  # None: put together elsewhere


def logged() -> Iterator[Logged]:
    """Every `log.…("event", extra=…)` of the service and its API."""
    parts = ("gcs/**/*.py", "api/*.py", "api/[!c]*/**/*.py")  # without api/console
    for path in sorted(path for part in parts for path in ROOT.glob(part)):
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)) if "extra=" in source else ():
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)):
                continue
            extra = next((each.value for each in node.keywords if each.arg == "extra"), None)
            names = [each.value for each in node.args if isinstance(each, ast.Constant)]
            if extra is None or not names or not isinstance(names[0], str):
                continue
            fields = None
            if isinstance(extra, ast.Dict) and all(isinstance(key, ast.Constant) for key in extra.keys):
                fields = frozenset(str(key.value) for key in extra.keys if isinstance(key, ast.Constant))
            yield Logged(f"{path.relative_to(ROOT)}:{node.lineno}", names[0], fields)


LINES = tuple(logged())


@pytest.mark.parametrize("line", LINES, ids=lambda line: f"{line.event} {line.where}")
def test_every_logged_event_has_a_plain_text(line: Logged) -> None:
    fields = line.fields
    if fields is None:
        fields = frozenset(re.findall(r"\{(\w+)\}", WORDS.get(line.event, ""))) | {"other"}
    for value in (
        *(("d3",), ["d3", "d4"], (), None, True, False, 2.0000000001, Path("a/file"), Colour.RED),
        *({"d3": ("a", None)}, {"d3"}, 7, "words"),
    ):
        text = words(line.event, dict.fromkeys(fields, value))
        assert text
        assert not PYTHON.search(text), text


@pytest.mark.parametrize("line", LINES, ids=lambda line: f"{line.event} {line.where}")
def test_event_with_its_own_text_shows_it(line: Logged) -> None:
    if line.fields is None or line.event not in WORDS:
        return
    needed = set(re.findall(r"\{(\w+)\}", re.sub(r"\[[^\]]*\]", "", WORDS[line.event])))
    assert needed <= line.fields


def test_the_scan_finds_what_the_service_logs() -> None:
    assert {"vehicle_phase", "failsafe", "alarm", "kill", "access_denied"} <= {line.event for line in LINES}


def test_failsafe_event_names_its_vehicles_readably() -> None:
    details = {
        "cause": "fence ahead",
        "action": "return",
        "command": "o3",
        "vehicles": ("d3",),
        "reason": "wind",
    }
    assert words("failsafe", details) == "return of d3 by the service: fence ahead (wind)"
    assert words("failsafe", {**details, "vehicles": ()}) == "return by the service: fence ahead (wind)"


def test_phases_have_their_reason() -> None:
    details = {"was": "arming", "phase": "running", "reason": "all stand"}
    assert words("show_phase", details) == "show running: all stand"
    assert words("vehicle_phase", {"phase": "hold", "reason": ""}) == "hold"


def test_event_without_its_own_text_is_readable() -> None:
    details = {"how_many": 3, "names": ("a", "b"), "also": None, "cause": "full"}
    assert words("something_new", details) == "something new: how many 3, names a, b: full"
