"""One Chromium for each file."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.support.console_bench import browser


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    """A browser for each file: while it runs, this thread's event loop is its own."""
    with browser() as started:
        yield started
