"""CONTRIBUTING.md names paths that exist. For tests/unit (the depth of `parents` as it lies there)."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOP = ("gcs/", "api/", "sim/", "tests/", "docs/", "configs/")


def paths() -> list[str]:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    words = re.findall(r"`([^`\s]+)`", text)
    return sorted({word for word in words if word.startswith(TOP) and "NAME" not in word})


def test_contributing_names_paths_that_exist() -> None:
    assert len(paths()) > 50
    assert [path for path in paths() if not (ROOT / path).exists()] == []
