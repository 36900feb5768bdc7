"""Routes of the stations of a site, which fly one formation together. They only translate."""

from fastapi import APIRouter

from gcs.api.context import ContextDep
from gcs.api.openapi import TOKEN, command
from gcs.model.errors import RefusedError
from gcs.service import StationView

router = APIRouter(prefix="/stations", tags=["stations"], dependencies=TOKEN)


@router.get("", summary="Every station of the site")
async def list_stations(context: ContextDep) -> list[StationView]:
    """The stations as the one that answers receives them; empty where one station flies all vehicles."""
    return list(context.view.stations)


@router.post("/lead", summary="Have the station that answers take the lead", **command(no_body=True))
async def take_lead(context: ContextDep) -> list[StationView]:
    """It holds the plan and computes the formation from now on; the stations that receive it follow.

    Answers with every station. `409` where one station flies all vehicles.
    """
    if context.service.stations is None:
        raise RefusedError("one station flies all vehicles here: there is no lead to take")
    return list(context.service.stations.take_lead())
