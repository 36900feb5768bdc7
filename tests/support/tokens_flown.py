"""Commands of named tokens to a service in virtual time, and the configuration of a start by two."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from gcs.service.commands import CALLER

BY_TWO: Final[dict[str, Any]] = {"confirmed_by_another": True}
TOKENS: Final = {"tokens_file": "tokens.json"}
"""Section `access`: virtual flights have no API, which would read the file."""


def by_two(**go: Any) -> dict[str, Any]:
    """Sections of a configuration with a start by two tokens."""
    return {"go": BY_TWO | go, "access": TOKENS}


@contextmanager
def token(name: str) -> Iterator[None]:
    """As the token of this name."""
    before = CALLER.set(name)
    try:
        yield
    finally:
        CALLER.reset(before)


def lists_file(folder: Path) -> Path:
    """A file of checklists of two roles."""
    file = folder / "checklists.yaml"
    file.write_text(
        "pads: [each vehicle stands on its pad, {text: no person is near, kept_over: [show]}]\n"
        "observer: [the air is clear]\n"
    )
    return file
