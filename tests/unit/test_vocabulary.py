"""The check of retired identifiers finds them wherever a name can stand."""

import pytest

from tests import vocabulary


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("a.py", "class OrderBook: ..."),
        ("a.py", "def f(errand): ..."),
        ("a.py", "x.sick_sensors"),
        ("a.py", "f(deadman_s=0.2)"),
        ("a.py", 'log.info("vehicle_heard")'),
        ("a.ts", "const told = ghostBox;"),
        ("a.md", "as `restrained_by` shows"),
        ("a.py", "# nobody is below"),
        ("a.py", "def test_news_of_vehicles(): ..."),
        ("a.ts", "// Everybody\n"),
        ("a.md", "the deadman stops setpoints"),
    ],
)
def test_a_retired_name_is_found(path: str, source: str) -> None:
    (line, *_) = vocabulary.findings(path, source)
    assert line.startswith(f"{path}:1: ")


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("a.py", '"""Told by whom it was heard."""\n# the errand'),
        ("a.py", "order = sorted(watch)"),
        ("a.py", "def test_what_was_told(): ..."),
        ("a.ts", '// told\nconst text = "what was said here";'),
        ("a.md", "what was said"),
    ],
)
def test_prose_and_common_terms_are_not_judged(path: str, source: str) -> None:
    assert vocabulary.findings(path, source) == []


@pytest.mark.parametrize(
    ("source", "is_judged"),
    [
        ("def f(found): ...", True),
        ("async def f():\n    return [one for one in rows]", True),
        ("def f():\n    one, other = pair", False),
        ("class Stand:\n    found: int", False),
        ("def f():\n    return self.found", False),
    ],
)
def test_variables_of_gcs_are_no_pronouns(source: str, is_judged: bool) -> None:
    assert bool(vocabulary.findings("gcs/a.py", source)) is is_judged
    assert vocabulary.findings("tests/a.py", source) == []


def test_a_test_name_has_at_most_60_characters() -> None:
    name = "test_" + 55 * "a"
    assert vocabulary.findings("a.py", f"def {name}(): ...") == []
    assert vocabulary.findings("a.py", f"class Trial:\n    async def {name}b(): ...") == [
        f"a.py:2: {name}b has 61 characters, at most 60 are allowed: put the sentence into the docstring"
    ]
