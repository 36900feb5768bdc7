"""The client's calls for written shows: `client.shows`."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeVar
from urllib.parse import quote

from gcs.client.deferred import Deferred
from gcs.model.errors import CommandError, InvalidError

if TYPE_CHECKING:
    from pydantic import BaseModel

    from gcs.api.schemas import rest as schemas
    from gcs.api.schemas import shows as show_schemas
else:
    schemas = Deferred("gcs.api.schemas.rest")
    show_schemas = Deferred("gcs.api.schemas.shows")

M = TypeVar("M", bound="BaseModel")

BUSY: Final = frozenset({"waiting", "running"})

ASK_AGAIN_S: Final = 0.5
"""Between two looks at a check, which takes about a minute."""


class Caller(Protocol):
    """How a client calls its service."""

    def one(
        self, model: Callable[[], type[M]], method: str, path: str, body: dict[str, Any] | bytes | None = None
    ) -> M:
        """One thing that is answered."""
        ...

    def many(self, model: Callable[[], type[M]], path: str) -> list[M]:
        """A list of things."""
        ...

    def call(self, method: str, path: str, body: dict[str, Any] | bytes | None = None) -> bytes:
        """Whatever is answered."""
        ...


class Shows:
    """Show files of the service, their checks, and the one that is selected. Raises as `Client` does."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def stored(self) -> list[show_schemas.StoredShow]:
        """Every show file."""
        return self._caller.many(lambda: show_schemas.StoredShow, "/api/v1/shows")

    def text(self, name: str) -> str:
        """A show file, as it was uploaded."""
        return self._caller.one(lambda: show_schemas.ShowText, "GET", _path(name)).text

    def upload(self, name: str, file: Path | str) -> show_schemas.StoredShow:
        """Keep a show under a name: the file that has it, or its YAML.

        Raises: InvalidError where there is no such file.
        """
        try:
            content = file.read_bytes() if isinstance(file, Path) else file.encode()
        except OSError as error:
            raise InvalidError("file", str(file), f"a file to read: {error.strerror or error}") from None
        return self._caller.one(lambda: show_schemas.StoredShow, "PUT", _path(name), content)

    def remove(self, name: str) -> None:
        """Forget a show file."""
        self._caller.call("DELETE", _path(name))

    def check(self, name: str) -> show_schemas.ShowCheck:
        """Begin the check of a show."""
        return self._caller.one(lambda: show_schemas.ShowCheck, "POST", f"{_path(name)}/check")

    def checked(self, name: str) -> show_schemas.ShowCheck:
        """How far the newest check has got."""
        return self._caller.one(lambda: show_schemas.ShowCheck, "GET", f"{_path(name)}/check")

    def wait_for_check(self, name: str, timeout_s: float) -> show_schemas.ShowCheck:
        """The check once it is done or has failed. Raises: CommandError after `timeout_s`."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            check = self.checked(name)
            if check.state not in BUSY:
                return check
            left_s = deadline_s - time.monotonic()
            if left_s <= 0:
                raise CommandError(f"the check of {name} is not done after {timeout_s:g} s")
            time.sleep(min(ASK_AGAIN_S, left_s))

    def select(self, name: str, show_hash: str) -> schemas.SelectedShow:
        """Have a checked show fly next."""
        return self._caller.one(
            lambda: schemas.SelectedShow, "POST", f"{_path(name)}/select", {"hash": show_hash}
        )

    def deselect(self) -> None:
        """Fly what is told instead."""
        self._caller.call("POST", "/api/v1/show/deselect")

    def seek(self, cue: str) -> schemas.SelectedShow:
        """Have the selected show begin at a cue."""
        return self._caller.one(lambda: schemas.SelectedShow, "POST", "/api/v1/show/seek", {"cue": cue})


def _path(name: str) -> str:
    """Of one show file."""
    return f"/api/v1/shows/{quote(name, safe='')}"
