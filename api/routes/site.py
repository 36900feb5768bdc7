"""Routes of the site. They only translate."""

from http import HTTPStatus
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from gcs import service
from gcs.api.context import ContextDep
from gcs.api.openapi import READ, TOKEN, command, errors

router = APIRouter(prefix="/site", tags=["site"], dependencies=TOKEN)

GEOJSON_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": "The whole site as GeoJSON: a FeatureCollection with a polygon for each area.",
        "content": {
            "application/geo+json": {
                "schema": {},  # any JSON: the site's own reader reports what is wrong
                "example": '{"type": "FeatureCollection", "features": [...]}',
            }
        },
    }
}

MEDIA_TYPES: Final[dict[service.SiteFormat, str]] = {
    "geojson": "application/geo+json",
    "kml": "application/vnd.google-earth.kml+xml",
    "plan": "application/json",
}


@router.get("", summary="The areas of the site", responses=READ | errors(404, 409))
async def get_site(context: ContextDep) -> service.SiteView:
    """Areas as the file has them now, on the globe and in the show frame. 404: there is no site."""
    return await context.service.site.read()


@router.get(
    "/{form}",
    summary="The site as a file",
    responses=READ | errors(404, 409) | {200: {"content": {each: {} for each in MEDIA_TYPES.values()}}},
    response_class=Response,
)
async def get_site_file(form: service.SiteFormat, context: ContextDep) -> Response:
    """GeoJSON, KML, or a plan of QGroundControl."""
    text = await context.service.site.text(form)
    return Response(text, media_type=MEDIA_TYPES[form])


@router.put("", summary="Change the site", openapi_extra=GEOJSON_BODY, **command(HTTPStatus.NOT_FOUND))
async def put_site(
    request: Request,
    context: ContextDep,
    version: Annotated[str, Query(pattern="^[0-9a-f]{64}$", description="Of the site that was edited.")],
) -> service.SiteView:
    """Replaces the file on the ground, and keeps the old one beside it as .bak.

    The new site counts from the next start of the service on; until then no start is possible. Refused with
    each area and corner that is wrong; and when the file is not the one that was edited any more.
    """
    return await context.service.site.change(await request.body(), version)
