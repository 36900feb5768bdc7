"""Living decisions name paths that exist, and every number of a decision leads to its page."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DECISIONS = ROOT / "docs" / "decisions"
HISTORY = DECISIONS / "history"
NAMED = re.compile(r"`((?:gcs|api|sim|tests|docs|configs)/[^`\s]*)`")
NUMBERS = re.compile(r"[Dd]ecisions?\s+((?:\d{4}(?:, | and )?)+)")
IN_CHANGELOG = re.compile(r"\(((?:\d{4}(?:, )?)+)\)")


def sources() -> list[Path]:
    """Documents and code that may name a decision."""
    folders = [ROOT / folder for folder in ("api", "docs", "gcs", "sim", "tests")]
    inside = [path for folder in folders for kind in ("*.py", "*.md") for path in folder.rglob(kind)]
    found = [path for path in inside if "node_modules" not in path.parts]
    return [*found, *ROOT.glob("*.md"), ROOT / "Makefile", ROOT / "mkdocs.yml", ROOT / "pyproject.toml"]


def numbers(text: str) -> set[str]:
    return {number for named in NUMBERS.findall(text) for number in re.findall(r"\d{4}", named)}


@pytest.mark.parametrize("page", sorted(path.name for path in DECISIONS.glob("*.md")))
def test_a_living_decision_names_paths_that_exist(page: str) -> None:
    named = NAMED.findall((DECISIONS / page).read_text(encoding="utf-8"))
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_history_lists_each_of_its_pages_once() -> None:
    index = (HISTORY / "index.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| \[\d{4}\]\((\d{4}-.+?\.md)\) ", index, re.MULTILINE)
    assert listed == sorted(path.name for path in HISTORY.glob("0*.md"))


def test_every_number_of_a_decision_has_its_page() -> None:
    known = {path.name[:4] for path in HISTORY.glob("0*.md")}
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    mentioned = {number for named in IN_CHANGELOG.findall(changelog) for number in named.split(", ")}
    for path in sources():
        mentioned |= numbers(path.read_text(encoding="utf-8"))
    assert len(mentioned) > 30
    assert mentioned - known == set()
