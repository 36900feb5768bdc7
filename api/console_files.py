"""The console at `/`: a built page and its assets, public, for it holds nothing of the flight.

It is built from `api/console/` (`make console`); an installed wheel brings it along.
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
"""One file, directly in the folder; its name holds a hash of what is in it."""

HEADERS: Final = {
    "Content-Security-Policy": (
        "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}
"""What the page runs comes from here alone, and nobody else may show it within a page of theirs."""

FOR_EVER: Final = "public, max-age=31536000, immutable"

NOT_BUILT: Final = "The console is not built here: run make console, or install the wheel, which brings it"


def is_public(path: str) -> bool:
    """Whether this is a path of the page or of one of its assets."""
    return path == "/" or ASSET.fullmatch(path) is not None


def headers(asked: str | None) -> dict[str, str]:
    """What goes with the page, which may ask that origin for tiles of a map; None: nobody but us."""
    if asked is None:
        return HEADERS
    policy = f"{HEADERS['Content-Security-Policy']}; connect-src 'self' {asked}"
    return {**HEADERS, "Content-Security-Policy": policy}


def routes(folder: Path = DIST, asked: str | None = None) -> APIRouter:
    """The page that was built into `folder`; looked for with every call, so that it may be built later.

    `asked`: the origin that it may ask for tiles of a map, besides us.
    """
    router = APIRouter(include_in_schema=False)
    sent = headers(asked)

    @router.api_route("/", methods=["GET", "HEAD"])
    async def page(request: Request) -> Response:
        """The console; asked for anew each time, since it names the assets of its own version."""
        index = folder / "index.html"
        if not index.is_file():
            return error_response(503, NOT_BUILT)
        return answer(index, request, {**sent, "Cache-Control": "no-cache"})

    @router.api_route("/assets/{name}", methods=["GET", "HEAD"])
    async def asset(name: str, request: Request) -> Response:
        """Never another one under the same name: it may be kept for ever."""
        found = folder / "assets" / name
        if ASSET.fullmatch(f"/assets/{name}") is None or is_twin(name) or not found.is_file():
            raise HTTPException(404)
        return answer(found, request, {**sent, "Cache-Control": FOR_EVER})

    return router


def answer(file: Path, request: Request, headers: Mapping[str, str]) -> Response:
    """A file, in the form that this caller accepts; nothing of it where the caller has it already."""
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
