"""Hypothesis' examples: the same in every run, whatever else is collected (docs/testing.md)."""

from importlib import import_module
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def examples() -> list[list[float]]:
    drawn = []

    @settings(derandomize=True)
    @given(st.lists(st.floats(0.0, 1e3), min_size=5))
    def note(numbers: list[float]) -> None:
        drawn.append(numbers)

    note()
    return drawn


def test_examples_do_not_depend_on_imported_modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = examples()
    (tmp_path / "some_numbers.py").write_text(f"NUMBERS = {[0.123 + each for each in range(500)]}\n")
    monkeypatch.syspath_prepend(tmp_path)
    import_module("some_numbers")
    assert examples() == before
