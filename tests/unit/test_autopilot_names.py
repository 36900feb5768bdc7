"""Outside the profiles no code asks which autopilot a vehicle has (decision 0049)."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROFILES = "autopilots"
NAMED = re.compile(r"px4|ardu(pilot(?!mega)|copter)", re.IGNORECASE)
DECIDES = frozenset({"autopilot", "autopilots"})
"""Attributes and names that hold a profile, its name or its number: to be called, never compared."""


FAKE_FLEET = "gcs.sim."
"""The simulated vehicles imitate autopilots."""


def is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def names(node: ast.AST) -> Iterator[str]:
    """Identifiers, and strings that are nothing but the name of an autopilot."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name) | ast.alias(name=name):
            yield name
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            yield name
        case ast.ImportFrom(module=str(name)) if not name.startswith(FAKE_FLEET):
            yield name
        case ast.keyword(arg=str(name)):
            yield name
        case ast.Constant(value=str(text)) if NAMED.fullmatch(text):
            yield text
        case _:
            return


def compared(node: ast.AST) -> Iterator[str]:
    """What is compared with, or matched against, an autopilot."""
    operands: list[ast.expr] = []
    match node:
        case ast.Compare(left=left, comparators=others) if not is_none(others[-1]):
            operands = [left, *others]
        case ast.Match(subject=subject):
            operands = [subject]
        case _:
            return
    for operand in operands:
        name = getattr(operand, "attr", getattr(operand, "id", ""))
        if name in DECIDES:
            yield name


def places(source: str) -> list[str]:
    """Lines of a module that name an autopilot, or compare one."""
    if not NAMED.search(source) and not any(word in source for word in DECIDES):  # not worth parsing
        return []
    return [
        f"{getattr(node, 'lineno', 0)}: {name}"
        for node in ast.walk(ast.parse(source))
        for name in [*(name for name in names(node) if NAMED.search(name)), *compared(node)]
    ]


@pytest.mark.long
def test_only_profiles_know_which_autopilot_a_vehicle_has() -> None:
    files = [
        path
        for package in ("gcs", "api")
        for path in sorted((ROOT / package).rglob("*.py"))
        if PROFILES not in path.parts and "sim" not in path.relative_to(ROOT).parts
    ]
    assert len(files) > 100
    found = [f"{path.relative_to(ROOT)}:{place}" for path in files for place in places(path.read_text())]
    assert found == []


@pytest.mark.parametrize(
    "source",
    [
        "if vehicle.autopilot == other: pass",
        "if name == 'ardupilot': pass",
        "limits = {'px4': 1}",
        "from gcs.links.autopilots.px4 import Px4",
        "isinstance(profile, ArduPilot)",
        "match vehicle.autopilot:\n    case _: pass",
        "def px4_mode(): pass",
    ],
)
def test_a_question_about_the_autopilot_is_found(source: str) -> None:
    assert places(source)


@pytest.mark.parametrize(
    "source",
    [
        "vehicle.autopilot.mode(4)",
        "text = 'PX4 lands it'",
        "from pymavlink.dialects.v20 import ardupilotmega",
    ],
)
def test_calls_of_a_profile_and_texts_are_none(source: str) -> None:
    assert places(source) == []
