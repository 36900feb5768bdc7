"""docs/architecture.md has the modules that a position passes to become a setpoint, as a flight has them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SECTION = "### Modules that a position passes to become a setpoint"
UNSEEN = ("endpoint", "send over MAVSDK")
"""Steps that do not run in virtual time."""

MODULE = re.compile(r"`(\w+/[\w/]+)`")


def rows(head: str) -> list[list[str]]:
    """The cells of a table of that section, by the begin of its head."""
    section = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition(SECTION)[2]
    lines = section.partition(f"\n{head}")[2].partition("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.soak
@pytest.mark.long
def test_the_page_has_the_modules_that_a_tick_enters() -> None:
    words = [sys.executable, "-W", "ignore", "-m", "tests.bench.tick_modules"]
    entered = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    counted = [name for row in rows("| Step |") if row[0] not in UNSEEN for name in MODULE.findall(row[1])]
    others = [name for row in rows("| Modules | Why |") for name in MODULE.findall(row[0])]
    assert sorted(counted + others) == sorted(entered)


def test_the_page_counts_its_modules() -> None:
    *steps, total = rows("| Step |")
    for step, modules, native, mavsdk in steps:
        count = len(MODULE.findall(modules))
        assert count == max(int(native or 0), int(mavsdk or 0)), step
    assert [f"**{sum(int(row[at] or 0) for row in steps)}**" for at in (2, 3)] == total[2:]
