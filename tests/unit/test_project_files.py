"""Versions, workflow and hooks agree with each other and with what the Makefile offers."""

import json
import re
import tomllib
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def workflow() -> dict[str, Any]:
    text = (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")
    found: dict[str, Any] = yaml.safe_load(text)
    return found


def steps() -> list[dict[str, Any]]:
    return list(chain.from_iterable(job["steps"] for job in workflow()["jobs"].values()))


def test_the_version_is_one_and_has_a_dated_changelog() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## (\d+\.\d+\.\d+) \(\d{4}-\d{2}-\d{2}\)$", changelog, re.MULTILINE)
    assert newest is not None
    console = json.loads((ROOT / "api" / "console" / "package.json").read_text(encoding="utf-8"))
    assert newest[1] == PROJECT["version"] == console["version"]


def test_the_changelog_has_one_line_per_change() -> None:
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line and not line.startswith(("#", "- "))] == []
    assert max(map(len, lines)) <= 140


def test_ci_runs_on_every_python_that_is_promised() -> None:
    promised = set(re.findall(r":: (3\.\d+)$", "\n".join(PROJECT["classifiers"]), re.MULTILINE))
    assert promised
    jobs = workflow()["jobs"]
    assert {"quick", "full", "docs", "wheel"} <= set(jobs)
    for name in ("quick", "full", "wheel"):
        assert set(jobs[name]["strategy"]["matrix"]["python"]) == promised


def test_ci_pins_actions_by_major_version() -> None:
    used = [step["uses"] for step in steps() if "uses" in step]
    assert used
    assert [each for each in used if re.fullmatch(r"actions/[a-z-]+@v\d+", each) is None] == []


def test_ci_calls_what_the_makefile_offers() -> None:
    commands = " ".join(step.get("run", "") for step in steps())
    called = re.findall(r"\bmake ([a-z-]+)", commands)
    assert {"check", "docs"} <= set(called)
    assert [each for each in called if re.search(rf"^{each}:", MAKEFILE, re.MULTILINE) is None] == []


def test_hooks_run_the_tools_of_the_environment() -> None:
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    (local,) = yaml.safe_load(text)["repos"]
    assert local["repo"] == "local"
    tools = [each["entry"].split()[0] for each in local["hooks"] if each["language"] == "system"]
    assert {Path(each).name for each in tools} == {"ruff", "mypy", "lint-imports"}
    assert all(each.startswith(".venv/bin/") for each in tools)


def test_a_page_includes_every_example() -> None:
    pages = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md"))
    included = re.findall(r'^--8<-- "examples/(.+)"$', pages, re.MULTILINE)
    assert sorted(included) == sorted(path.name for path in (ROOT / "docs" / "examples").glob("*.py"))


def test_the_page_of_the_article_names_what_is_there() -> None:
    """Every function on it can be imported, and every test exists."""
    page = (ROOT / "docs" / "the-article.md").read_text(encoding="utf-8")
    functions = re.findall(r"`((?:gcs|tests)\.[\w.]+)`", page)
    tests = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page)
    assert len(functions) > 15
    assert len(tests) > 15
    for module, _, name in (each.rpartition(".") for each in functions):
        assert hasattr(import_module(module), name), f"{module}.{name}"
    for path, name in tests:
        assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), f"{path}::{name}"
