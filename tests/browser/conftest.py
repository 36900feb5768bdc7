from collections.abc import Iterator

import pytest
from console_bench import browser
from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def chrome() -> Iterator[Browser]:
    """One for each file: while it runs, this thread's event loop is its own."""
    with browser() as started:
        yield started
