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
"""Period of polling a check, which takes about a minute."""


class Caller(Protocol):
    """The part of a client that makes calls."""

    def one(
        self, model: Callable[[], type[M]], method: str, path: str, body: dict[str, Any] | bytes | None = None
    ) -> M:
        """Call a path and parse the answer."""
        ...

    def many(self, model: Callable[[], type[M]], path: str) -> list[M]:
        """Call a path and parse the answer as a list."""
        ...

    def call(self, method: str, path: str, body: dict[str, Any] | bytes | None = None) -> bytes:
        """Call a path and return the answer's body."""
        ...


class Shows:
    """Show files of the service, their checks, and the selected show. Raises the errors of `Client`."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def stored(self) -> list[show_schemas.StoredShow]:
        """List the stored show files."""
        return self._caller.many(lambda: show_schemas.StoredShow, "/api/v1/shows")

    def text(self, name: str) -> str:
        """Get the text of a show file."""
        return self._caller.one(lambda: show_schemas.ShowText, "GET", _path(name)).text

    def upload(self, name: str, file: Path | str) -> show_schemas.StoredShow:
        """Upload a show under a name; `file` is a path, or the YAML text itself.

        Raises: InvalidError when there is no such file.
        """
        try:
            content = file.read_bytes() if isinstance(file, Path) else file.encode()
        except OSError as error:
            raise InvalidError("file", str(file), f"a file to read: {error.strerror or error}") from None
        return self._caller.one(lambda: show_schemas.StoredShow, "PUT", _path(name), content)

    def remove(self, name: str) -> None:
        """Delete a show file."""
        self._caller.call("DELETE", _path(name))

    def check(self, name: str) -> show_schemas.ShowCheck:
        """Start the check of a show."""
        return self._caller.one(lambda: show_schemas.ShowCheck, "POST", f"{_path(name)}/check")

    def checked(self, name: str) -> show_schemas.ShowCheck:
        """Get the newest check of a show, or its progress."""
        return self._caller.one(lambda: show_schemas.ShowCheck, "GET", f"{_path(name)}/check")

    def wait_for_check(self, name: str, timeout_s: float) -> show_schemas.ShowCheck:
        """Wait until a check is done or has failed. Raises: CommandError after `timeout_s`."""
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
        """Select a checked show for the next start."""
        return self._caller.one(
            lambda: schemas.SelectedShow, "POST", f"{_path(name)}/select", {"hash": show_hash}
        )

    def deselect(self) -> None:
        """Return to manual control: formation, target and orbit follow the operator's commands."""
        self._caller.call("POST", "/api/v1/show/deselect")

    def seek(self, cue: str) -> schemas.SelectedShow:
        """Let the selected show begin at a cue."""
        return self._caller.one(lambda: schemas.SelectedShow, "POST", "/api/v1/show/seek", {"cue": cue})


def _path(name: str) -> str:
    """Path of one show file in the API."""
    return f"/api/v1/shows/{quote(name, safe='')}"
