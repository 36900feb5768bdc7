"""The built site, opened from the disk in Chromium. `make docs` runs this where there is one."""

import re
from pathlib import Path
from typing import Final

from playwright.sync_api import PdfMargins, expect

from tests.support.console_bench import SOON_MS, browser

START: Final = Path(__file__).parents[2] / "build" / "site" / "index.html"
MARGIN: Final[PdfMargins] = {"top": "10mm", "right": "10mm", "bottom": "10mm", "left": "10mm"}


def test_search_finds_a_key_and_asks_no_host() -> None:
    requested: list[str] = []
    wrong: list[str] = []
    with browser() as started, started.new_page() as page:
        page.on("request", lambda request: requested.append(request.url))
        page.on("requestfailed", lambda request: wrong.append(request.url))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto(START.as_uri())
        page.keyboard.press("/")
        page.locator(".md-search__input").press_sequentially("setpoint_loss_s")
        first = page.locator(".md-search-result__link").first
        expect(first).to_have_attribute("href", re.compile(r"reference/configuration\.html"), timeout=SOON_MS)
        first.click()
        expect(page.locator("#operation")).to_be_visible(timeout=SOON_MS)
    assert [each for each in requested if not each.startswith(("file:", "data:"))] == []
    assert wrong == []


def test_operator_card_is_one_printed_page() -> None:
    with browser() as started, started.new_page() as page:
        page.goto((START.parent / "operator-card.html").as_uri())
        for paper in ("A4", "Letter"):
            printed = page.pdf(format=paper, margin=MARGIN)
            assert len(re.findall(rb"/Type\s*/Page\b", printed)) == 1, paper
