"""The API at `/docs`: Swagger UI over `/openapi.json`, built with the console (decision 0026)."""

from pathlib import Path
from typing import Final

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from gcs.api import console_files as page
from gcs.api.errors import error_response

HEADERS: Final = {
    **page.HEADERS,
    "Content-Security-Policy": f"{page.HEADERS['Content-Security-Policy']}; img-src 'self' data:",
    "Cache-Control": "no-cache",
}
"""Headers of the console, plus permission for the images that Swagger UI's style sheet embeds as data."""


def routes(folder: Path = page.DIST) -> APIRouter:
    """Route of the page in `folder`; the page requests only its assets and `/openapi.json`."""
    router = APIRouter(include_in_schema=False)

    @router.get("/docs")
    async def docs(request: Request) -> Response:
        """Documentation of every operation, with a form to call it."""
        index = folder / "docs.html"
        if not index.is_file():
            return error_response(503, page.NOT_BUILT)
        return page.answer(index, request, HEADERS)

    return router
