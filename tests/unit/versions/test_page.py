"""docs/reference/tested-with.md is what the tables say."""

from pathlib import Path

from gcs.links.autopilots import AUTOPILOTS
from gcs.links.autopilots.versions.page import TABLES, page

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "tested-with.md"


def test_committed_page_is_the_generated_one() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run: make tested-with"


def test_page_has_every_autopilot() -> None:
    assert [AUTOPILOTS[name].versions.title for name in TABLES] == [
        profile.versions.title for profile in AUTOPILOTS.values()
    ]
