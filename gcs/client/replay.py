"""The client's calls for a replay: `client.playback`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from gcs.client.deferred import Deferred

if TYPE_CHECKING:
    from pydantic import BaseModel

    from gcs.api.schemas import replay as replay_schemas
else:
    replay_schemas = Deferred("gcs.api.schemas.replay")

M = TypeVar("M", bound="BaseModel")

PATH = "/api/v1/replay"


class Caller(Protocol):
    """The part of a client that makes calls."""

    def one(
        self, model: Callable[[], type[M]], method: str, path: str, body: dict[str, Any] | bytes | None = None
    ) -> M:
        """Call a path and parse the answer."""
        ...


class Playback:
    """Playback of a record. Raises the errors of `Client`; RefusedError if the service controls vehicles."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def now(self) -> replay_schemas.Replay:
        """Get position and speed of the playback."""
        return self._caller.one(lambda: replay_schemas.Replay, "GET", PATH)

    def marks(self) -> replay_schemas.ReplayMarks:
        """Get phases, cues, events and idle times of the whole record."""
        return self._caller.one(lambda: replay_schemas.ReplayMarks, "GET", f"{PATH}/marks")

    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> replay_schemas.Replay:
        """Change the given fields of the playback."""
        given = {"paused": paused, "speed": speed, "position_s": position_s, "skips_idle": skips_idle}
        body = {name: value for name, value in given.items() if value is not None}
        return self._caller.one(lambda: replay_schemas.Replay, "POST", PATH, body)

    def report(self) -> replay_schemas.FlightReport:
        """Get the flight report; the first call starts its analysis, so poll until it is done."""
        return self._caller.one(lambda: replay_schemas.FlightReport, "GET", f"{PATH}/report")
