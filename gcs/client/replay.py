"""The client's calls for a record that is replayed: `client.playback`."""

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
    """How a client calls its service."""

    def one(
        self, model: Callable[[], type[M]], method: str, path: str, body: dict[str, Any] | bytes | None = None
    ) -> M:
        """One thing that is answered."""
        ...


class Playback:
    """How a record is played. Raises as `Client` does; RefusedError where vehicles fly."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def now(self) -> replay_schemas.Replay:
        """How the record is played, and where it is."""
        return self._caller.one(lambda: replay_schemas.Replay, "GET", PATH)

    def marks(self) -> replay_schemas.ReplayMarks:
        """Phases, cues, events and idle time of the whole record."""
        return self._caller.one(lambda: replay_schemas.ReplayMarks, "GET", f"{PATH}/marks")

    def change(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        position_s: float | None = None,
        skips_idle: bool | None = None,
    ) -> replay_schemas.Replay:
        """Play the record otherwise: what is given changes."""
        given = {"paused": paused, "speed": speed, "position_s": position_s, "skips_idle": skips_idle}
        body = {name: value for name, value in given.items() if value is not None}
        return self._caller.one(lambda: replay_schemas.Replay, "POST", PATH, body)

    def report(self) -> replay_schemas.FlightReport:
        """What the flight kept and broke; the first call begins the judgement: ask again until it is done."""
        return self._caller.one(lambda: replay_schemas.FlightReport, "GET", f"{PATH}/report")
