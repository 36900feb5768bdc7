"""Whether there is a browser for tests/browser, and how to get one."""

import os
import shutil
import sys
from typing import Final

NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")

GET_ONE: Final = "sudo apt-get install -y chromium"

NOT_RUN: Final = f"tests/browser was not run: there is no Chromium here. To get one: {GET_ONE}"

REQUIRED: Final = "REQUIRE_BROWSER"
"""In the environment, 1: to have none is an error."""


def chromium() -> str | None:
    """Find Chromium on the PATH."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


def is_required() -> bool:
    """Whether the environment demands a browser."""
    return os.environ.get(REQUIRED, "") not in {"", "0"}


if __name__ == "__main__" and chromium() is None:
    sys.stdout.write(f"{NOT_RUN}\n")
