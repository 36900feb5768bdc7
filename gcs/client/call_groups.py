"""Groups of the client's calls: `client.preflight`, `client.playback` and `client.shows`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import urlencode

from gcs.client.http import Deferred, Exchange, given, part
from gcs.model.errors import CommandError, InvalidError

if TYPE_CHECKING:
    from gcs.api.schemas import fleet as schemas
    from gcs.api.schemas import reports
else:
    schemas = Deferred("gcs.api.schemas.fleet")
    reports = Deferred("gcs.api.schemas.reports")


class Preflight:
    """Checks before a start, and exclusion of vehicles. Raises the errors of `Client`."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange

    def report(self, vehicles: list[str] | None = None) -> reports.Preflight:
        """Get every check for a start of `vehicles`, or of all online ones."""
        named = f"?{urlencode([('vehicles', name) for name in vehicles])}" if vehicles else ""
        return self._exchange.one(lambda: reports.Preflight, "GET", f"/api/v1/preflight{named}")

    def exclude(self, vehicle_id: str, *, reason: str | None = None) -> schemas.Command:
        """Exclude a vehicle from the show, on the ground."""
        body = given(reason=reason) or None
        return self._exchange.one(
            lambda: schemas.Command, "POST", f"/api/v1/vehicles/{part(vehicle_id)}/exclude", body
        )

    def include(self, vehicle_id: str) -> schemas.Command:
        """Include a vehicle in the show again."""
        return self._exchange.one(
            lambda: schemas.Command, "POST", f"/api/v1/vehicles/{part(vehicle_id)}/include"
        )


PATH = "/api/v1/replay"


class Playback:
    """Playback of a record. Raises the errors of `Client`; RefusedError if the service controls vehicles."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange

    def now(self) -> schemas.Replay:
        """Get position and speed of the playback."""
        return self._exchange.one(lambda: schemas.Replay, "GET", PATH)

    def marks(self) -> reports.ReplayMarks:
        """Get phases, cues, events and idle times of the whole record."""
        return self._exchange.one(lambda: reports.ReplayMarks, "GET", f"{PATH}/marks")

    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> schemas.Replay:
        """Change the given fields of the playback."""
        body = given(paused=paused, speed=speed, position_s=position_s, skips_idle=skips_idle)
        return self._exchange.one(lambda: schemas.Replay, "POST", PATH, body)

    def report(self) -> reports.FlightReport:
        """Get the flight report; the first call starts its analysis, so poll until it is done."""
        return self._exchange.one(lambda: reports.FlightReport, "GET", f"{PATH}/report")


BUSY: Final = frozenset({"waiting", "running"})

ASK_AGAIN_S: Final = 0.5
"""Period of polling a check, which takes about a minute."""


class Shows:
    """Show files of the service, their checks, and the selected show. Raises the errors of `Client`."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange = exchange

    def stored(self) -> list[reports.StoredShow]:
        """List the stored show files."""
        return self._exchange.many(lambda: reports.StoredShow, "/api/v1/shows")

    def text(self, name: str) -> str:
        """Get the text of a show file."""
        return self._exchange.one(lambda: reports.ShowText, "GET", _path(name)).text

    def upload(self, name: str, file: Path | str) -> reports.StoredShow:
        """Upload a show under a name; `file` is a path, or the YAML text itself.

        Raises: InvalidError when there is no such file.
        """
        try:
            content = file.read_bytes() if isinstance(file, Path) else file.encode()
        except OSError as error:
            raise InvalidError("file", str(file), f"a file to read: {error.strerror or error}") from None
        return self._exchange.one(lambda: reports.StoredShow, "PUT", _path(name), content)

    def remove(self, name: str) -> None:
        """Delete a show file."""
        self._exchange.call("DELETE", _path(name))

    def check(self, name: str) -> reports.ShowCheck:
        """Start the check of a show."""
        return self._exchange.one(lambda: reports.ShowCheck, "POST", f"{_path(name)}/check")

    def checked(self, name: str) -> reports.ShowCheck:
        """Get the newest check of a show, or its progress."""
        return self._exchange.one(lambda: reports.ShowCheck, "GET", f"{_path(name)}/check")

    def wait_for_check(self, name: str, timeout_s: float) -> reports.ShowCheck:
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
        return self._exchange.one(
            lambda: schemas.SelectedShow, "POST", f"{_path(name)}/select", {"hash": show_hash}
        )

    def deselect(self) -> None:
        """Return to manual control: formation, target and orbit follow the operator's commands."""
        self._exchange.call("POST", "/api/v1/show/deselect")

    def seek(self, cue: str) -> schemas.SelectedShow:
        """Let the selected show begin at a cue."""
        return self._exchange.one(lambda: schemas.SelectedShow, "POST", "/api/v1/show/seek", {"cue": cue})


def _path(name: str) -> str:
    return f"/api/v1/shows/{part(name)}"
