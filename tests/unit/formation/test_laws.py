"""Laws are plug-ins: nothing that flies asks for their names."""

import ast
from collections.abc import Iterator
from math import inf, nan
from pathlib import Path

import pytest
from pydantic import ValidationError

from gcs.control import ControlSettings
from gcs.formation.laws import registry
from gcs.formation.laws.registry import SHIPPED, law_of, names, place_of
from gcs.model.errors import InvalidError

ROOT = Path(__file__).parents[3]


def branches(source: str) -> Iterator[str]:
    """Names of laws that code compares with, matches, or has in a table."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Compare() | ast.MatchValue() | ast.Dict() | ast.Set() | ast.Attribute(attr="article"):
                constants = (part for part in ast.walk(node) if isinstance(part, ast.Constant))
                yield from (f"{each.lineno}: {each.value}" for each in constants if each.value in SHIPPED)
            case _:
                pass


def test_nothing_that_flies_branches_on_a_laws_name() -> None:
    parts = (ROOT / "gcs" / name for name in ("control", "flight", "planning"))
    files = [file for part in parts for file in part.rglob("*.py")]
    assert len(files) > 60
    assert [f"{file.name}:{found}" for file in files for found in branches(file.read_text())] == []


@pytest.mark.parametrize(
    "source", ["law == 'slots'", "match law:\n case 'article': pass", "rates = {'neighbours': 1}"]
)
def test_a_branch_on_a_laws_name_is_found(source: str) -> None:
    assert list(branches(source))


def test_a_law_that_there_is_not_names_those_that_there_are() -> None:
    with pytest.raises(InvalidError, match=r"law = rnig: one of slots, article, neighbours"):
        place_of("rnig")
    assert set(SHIPPED) <= set(names())


def test_settings_of_a_law_are_checked_by_its_own_model() -> None:
    control = ControlSettings.model_validate({"law": {"laws": {"flocking": {"range_share": 2.0}}}})
    law = law_of("flocking")
    assert control.law.own("flocking", law.settings).model_dump()["range_share"] == 2.0
    assert ControlSettings.model_validate(control.model_dump()) == control
    for wrong, text in (({"flocking": {"range": 1}}, "flocking.range"), ({"rnig": {}}, "one of slots")):
        with pytest.raises(ValidationError, match=text):
            ControlSettings.model_validate({"law": {"laws": wrong}})


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"turn_m_s": nan}, "hostile_laws:Hostile.turn_m_s = nan: a finite number is needed"),
        ({"at": [1.0, {"x": inf}]}, "hostile_laws:Hostile.at.1.x = inf: a finite number is needed"),
        ({"at": {1, 2}}, "a word, a number, a list or a group is needed"),
        ({"text": "x" * 40_000}, "at most 32768 are possible"),
        ({"in": [[[[[[[[[]]]]]]]]]}, "at most 8 are possible"),
        ([1.0], "valid dictionary"),
    ],
)
def test_settings_of_a_foreign_law_are_what_a_file_can_say(
    settings: object, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "_beside", [])
    registry.allow_code(ROOT / "tests" / "support")
    with pytest.raises(ValidationError, match=why):
        ControlSettings.model_validate({"law": {"laws": {"hostile_laws:Hostile": settings}}})
    kept = {"turn_m_s": 2.0, "names": ["a"], "off": False, "none": None}
    control = ControlSettings.model_validate({"law": {"laws": {"hostile_laws:Hostile": kept}}})
    assert control.law.given("hostile_laws:Hostile") == kept
