"""The console at `/`: the built page and its assets, public because they contain no data of the flight.

`make console` builds it from `api/console/`; a wheel contains it.
"""

import mimetypes
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from fastapi import APIRouter
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from gcs.api.encodings import chosen, is_known, is_twin
from gcs.api.errors import error_response

DIST: Final = Path(__file__).parent / "console" / "dist"

ASSET: Final = re.compile(r"/assets/[A-Za-z0-9_-]{1,100}(\.[A-Za-z0-9_-]{1,20}){1,3}")
"""Path of one asset, directly in the folder; its name contains a hash of its content."""

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
"""Headers of the page: its scripts come from this service only, and no other site may frame it."""

FOR_EVER: Final = "public, max-age=31536000, immutable"

NOT_BUILT: Final = "The console is not built here: run make console, or install the wheel, which brings it"


def is_public(path: str) -> bool:
    """Whether this is the path of the page or of an asset."""
    return path == "/" or ASSET.fullmatch(path) is not None


def headers(asked: str | None) -> dict[str, str]:
    """Headers of the page. `asked` is a foreign origin of map tiles; None: requests to this service only."""
    if asked is None:
        return HEADERS
    policy = f"{HEADERS['Content-Security-Policy']}; connect-src 'self' {asked}"
    return {**HEADERS, "Content-Security-Policy": policy}


def routes(folder: Path = DIST, asked: str | None = None) -> APIRouter:
    """Routes of the console that was built into `folder`; each call looks there, so it may be built later.

    `asked` is a foreign origin from which the page may request map tiles.
    """
    router = APIRouter(include_in_schema=False)
    sent = headers(asked)

    @router.api_route("/", methods=["GET", "HEAD"])
    async def page(request: Request) -> Response:
        """The console. Browsers revalidate it each time: it names the assets of its own version."""
        index = folder / "index.html"
        if not index.is_file():
            return error_response(503, NOT_BUILT)
        return answer(index, request, {**sent, "Cache-Control": "no-cache"})

    @router.api_route("/assets/{name}", methods=["GET", "HEAD"])
    async def asset(name: str, request: Request) -> Response:
        """One asset. Its content never changes under its name, so browsers may keep it for ever."""
        found = folder / "assets" / name
        if ASSET.fullmatch(f"/assets/{name}") is None or is_twin(name) or not found.is_file():
            raise HTTPException(404)
        return answer(found, request, {**sent, "Cache-Control": FOR_EVER})

    return router


def answer(file: Path, request: Request, headers: Mapping[str, str]) -> Response:
    """A file in the content coding that the caller accepts; 304 when the caller has it already."""
    form = chosen(file, request.headers.get("accept-encoding"))
    if form is None:
        detail = (
            f"{request.url.path} is sent as br, gzip or identity, and Accept-Encoding refuses all of them"
        )
        response = error_response(406, detail)
        response.headers["Vary"] = "Accept-Encoding"
        return response
    reported = {**headers, **form.headers}
    if is_known(reported["ETag"], request.headers.get("if-none-match")):
        reported.pop("Content-Encoding", None)
        return Response(status_code=304, headers=reported)
    media_type = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    return FileResponse(form.path, headers=reported, media_type=media_type)
