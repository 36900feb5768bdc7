"""Tiles of the service's own map file, to which `map` in the status refers."""

import sqlite3
from http import HTTPStatus

from fastapi import APIRouter, HTTPException
from starlette.responses import Response

from gcs.api.context import ContextDep
from gcs.model.errors import UnknownError

router = APIRouter(include_in_schema=False)

HEADERS = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}


@router.get("/map/{z}/{x}/{y}")
async def get_tile(z: int, x: int, y: int, context: ContextDep) -> Response:
    """One tile as an image. Rows count from the north."""
    ground = context.ground
    if ground is None or ground.file is None:
        raise UnknownError("no map is served here: map.tiles of the configuration names an .mbtiles file")
    try:
        picture = await ground.file.read(z, x, y)
    except sqlite3.Error as error:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, f"the map cannot be read: {error}") from None
    return Response(picture, media_type=ground.file.media_type, headers=HEADERS)
