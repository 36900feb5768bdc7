"""What needs Chromium is collected where there is one, as tests/conftest.py does."""

from tests.support.browsers import chromium

collect_ignore = [] if chromium() else ["test_in_chromium.py"]
