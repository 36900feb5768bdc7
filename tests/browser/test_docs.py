"""The API's description at /docs, as a browser shows it."""

from collections.abc import Iterator
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, expect

from tests.support.console_bench import SOON_MS, Station, station

METHODS = {"get", "put", "post", "patch", "delete"}


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """One vehicle that stays where it is."""
    with station(tmp_path_factory.mktemp("docs"), 1) as started:
        yield started


class Docs:
    """The page, all that it asked for, and what the browser found wrong with it."""

    def __init__(self, page: Page, url: str) -> None:
        self.page = page
        self.asked: list[str] = []
        self.wrong: list[str] = []
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("pageerror", lambda error: self.wrong.append(str(error)))
        page.on("console", self._note)
        self.answer = page.goto(f"{url}/docs")
        self.page.locator(".opblock").first.wait_for(timeout=SOON_MS)

    def _note(self, message: ConsoleMessage) -> None:
        if message.type in {"error", "warning"}:
            self.wrong.append(message.text)


@pytest.fixture
def docs(chrome: Browser, ground: Station) -> Iterator[Docs]:
    with chrome.new_page() as page:
        yield Docs(page, ground.url)


def described(url: str) -> dict[tuple[str, str], Any]:
    """Every operation of the document, by method and path."""
    paths = httpx.get(f"{url}/openapi.json", trust_env=False).json()["paths"]
    return {(method, path): each[method] for path, each in paths.items() for method in METHODS & set(each)}


@pytest.mark.soak
def test_every_operation_is_shown_without_another_origin(docs: Docs, ground: Station) -> None:
    operations = described(ground.url)
    assert len(operations) > 50
    shown = {
        (block.locator(".opblock-summary-method").inner_text().lower(), path)
        for block in docs.page.locator(".opblock").all()
        if (path := block.locator("[data-path]").get_attribute("data-path")) is not None
    }
    assert shown == set(operations)
    opened = docs.page.locator(".opblock-summary-control").all()[::8]  # all at once take 1.4 GB and minutes
    for block in opened:
        block.click()
    expect(docs.page.locator(".opblock.is-open")).to_have_count(len(opened), timeout=SOON_MS)
    assert {urlsplit(url).netloc for url in docs.asked if not url.startswith("data:")} == {
        urlsplit(ground.url).netloc
    }
    assert docs.wrong == []  # no policy was violated, no script failed


@pytest.mark.soak
def test_operation_can_be_tried_and_no_page_frames_the_docs(docs: Docs, ground: Station) -> None:
    block = docs.page.locator("#operations-fleet-list_vehicles")
    block.locator(".opblock-summary-control").click()
    block.get_by_role("button", name="Try it out").click()
    block.get_by_role("button", name="Execute").click()
    expect(block.locator(".live-responses-table")).to_contain_text('"d1"', timeout=SOON_MS)
    upload = docs.page.locator("#operations-shows-put_show_file")
    upload.locator(".opblock-summary-control").click()
    expect(upload).to_contain_text("application/yaml", timeout=SOON_MS)
    assert docs.wrong == []
    policy = docs.answer.headers["content-security-policy"] if docs.answer else ""
    assert "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy
    docs.page.goto("data:text/html,<iframe src=" + ground.url + "/docs></iframe>")
    docs.page.wait_for_timeout(1000)
    framed = docs.page.frames[-1]
    assert framed.locator(".swagger-ui").count() == 0
