"""The test that docs/how-to/test-in-virtual-time.md shows passes as it is printed."""

from pathlib import Path
from typing import Any

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "test-in-virtual-time.md"


@pytest.mark.soak
def test_printed_test_passes() -> None:
    _, _, rest = PAGE.read_text(encoding="utf-8").partition("```python\n")
    code, closed, _ = rest.partition("```\n")
    assert closed
    names: dict[str, Any] = {}
    exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102
    tests = [each for name, each in names.items() if name.startswith("test_")]
    assert len(tests) == 1
    tests[0]()
