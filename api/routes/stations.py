"""Routes of the stations of a site, which fly one formation together. They only translate."""

from http import HTTPStatus
from typing import Any, Final

from fastapi import APIRouter, Response

from gcs.api.context import ContextDep
from gcs.api.openapi import TOKEN, StationName, command
from gcs.model.errors import RefusedError
from gcs.service import CommandRecord, StationView

ALONE: Final = "one station flies all vehicles here: there is no other station"

EXAMPLE: Final[list[dict[str, Any]]] = [
    {
        "name": name,
        "own": name == "north",
        "leads": name == "north",
        "received": name != "west",
        "silent_s": {"north": 0.0, "west": 2.5}.get(name, 0.03),
        "show": "running",
        "vehicles": 250,
        "delay_s": 0.0 if name == "north" else 0.002,
        "term": 1,
        "offers": [],
    }
    for name in ("north", "south", "west")
]
LISTED: Final[dict[int | str, dict[str, Any]]] = {
    200: {"content": {"application/json": {"example": EXAMPLE}}}
}

COMMAND: Final = command(no_body=True)

router = APIRouter(prefix="/stations", tags=["stations"], dependencies=TOKEN)


@router.get("", summary="Every station of the site", responses=LISTED)
async def list_stations(context: ContextDep) -> list[StationView]:
    """The stations as the one that answers receives them; empty where one station flies all vehicles."""
    return list(context.view.stations)


@router.post(
    "/lead",
    summary="Have the station that answers take the lead",
    **COMMAND | {"responses": COMMAND["responses"] | LISTED},
)
async def take_lead(context: ContextDep) -> list[StationView]:
    """It holds the plan and computes the formation from now on; the stations that receive it follow.

    Answers with every station. `409` where one station flies all vehicles.
    """
    if context.service.stations is None:
        raise RefusedError(ALONE)
    return list(context.service.stations.take_lead())


@router.post(
    "/{name}/take-over",
    summary="Fly on with the vehicles of a lost station",
    **command(404, status=HTTPStatus.ACCEPTED, no_body=True),
)
async def take_over_station(context: ContextDep, name: StationName, response: Response) -> CommandRecord:
    """At the standby of that station, whichever answers. Its vehicles go from hold back into formation.

    Refused where the station is not lost, may still send setpoints, or none of its vehicles holds: by the
    standby itself with `409`, of another station the outcomes have the reason.
    """
    if context.service.stations is None:
        raise RefusedError(ALONE)
    record = context.service.stations.take_over(name)
    response.headers["Location"] = f"/api/v1/commands/{record.id}"
    return record
