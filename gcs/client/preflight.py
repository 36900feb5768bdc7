"""The client's calls of preflight: `client.preflight`."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar
from urllib.parse import quote, urlencode

from gcs.client.deferred import Deferred

if TYPE_CHECKING:
    from pydantic import BaseModel

    from gcs.api.schemas import preflight as preflight_schemas
    from gcs.api.schemas import rest as schemas
else:
    schemas = Deferred("gcs.api.schemas.rest")
    preflight_schemas = Deferred("gcs.api.schemas.preflight")

M = TypeVar("M", bound="BaseModel")


class Caller(Protocol):
    """The part of a client that makes calls."""

    def one(
        self, model: Callable[[], type[M]], method: str, path: str, body: dict[str, Any] | bytes | None = None
    ) -> M:
        """Call a path and parse the answer."""
        ...


class Preflight:
    """Checks before a start, and exclusion of vehicles. Raises the errors of `Client`."""

    def __init__(self, caller: Caller) -> None:
        self._caller = caller

    def report(self, vehicles: list[str] | None = None) -> preflight_schemas.Preflight:
        """Get every check for a start of `vehicles`, or of all online ones."""
        named = f"?{urlencode([('vehicles', name) for name in vehicles])}" if vehicles else ""
        return self._caller.one(lambda: preflight_schemas.Preflight, "GET", f"/api/v1/preflight{named}")

    def exclude(self, vehicle_id: str, *, reason: str | None = None) -> schemas.Command:
        """Exclude a vehicle from the show, on the ground."""
        body = None if reason is None else {"reason": reason}
        return self._caller.one(lambda: schemas.Command, "POST", f"{_path(vehicle_id)}/exclude", body)

    def include(self, vehicle_id: str) -> schemas.Command:
        """Include a vehicle in the show again."""
        return self._caller.one(lambda: schemas.Command, "POST", f"{_path(vehicle_id)}/include")


def _path(vehicle_id: str) -> str:
    return f"/api/v1/vehicles/{quote(vehicle_id, safe='')}"
