"""Tiles of the map that the service serves itself: pictures for the page, told by `map` in the status."""

from fastapi import APIRouter
from starlette.responses import Response

from api.desk import DeskDep
from gcs.errors import UnknownError

router = APIRouter(include_in_schema=False)

HEADERS = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}


@router.get("/map/{z}/{x}/{y}")
def get_tile(z: int, x: int, y: int, desk: DeskDep) -> Response:
    """One tile, rows counted from the north. Not async: a slow disk holds a thread, and not the loop."""
    ground = desk.ground
    if ground is None or ground.file is None:
        raise UnknownError("no map is served here: map.tiles of the configuration names an .mbtiles file")
    return Response(ground.file.tile(z, x, y), media_type=ground.file.media_type, headers=HEADERS)
