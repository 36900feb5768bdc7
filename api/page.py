"""The console at `/`: a built page and its assets, public, for it holds nothing of the flight.

It is built from `api/console/` (`make console`); an installed wheel brings it along.
"""

import re
from pathlib import Path
from typing import Final

from fastapi import APIRouter
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, PlainTextResponse, Response

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

NOT_BUILT: Final = "The console is not built here: run make console, or install the wheel, which brings it.\n"


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
    async def page() -> Response:
        """The console; asked for anew each time, since it names the assets of its own version."""
        index = folder / "index.html"
        if not index.is_file():
            return PlainTextResponse(NOT_BUILT, 503, headers={"Cache-Control": "no-store"})
        return FileResponse(index, headers={**sent, "Cache-Control": "no-cache"})

    @router.api_route("/assets/{name}", methods=["GET", "HEAD"])
    async def asset(name: str) -> Response:
        """Never another one under the same name: it may be kept for ever."""
        found = folder / "assets" / name
        if ASSET.fullmatch(f"/assets/{name}") is None or not found.is_file():
            raise HTTPException(404)
        return FileResponse(found, headers={**sent, "Cache-Control": FOR_EVER})

    return router
