"""The console at `/` and `/docs`: built pages and their assets, public because they contain no flight data.

`make console` builds them from `api/console/`; a wheel contains them. A file is sent compressed or as it is,
as the caller accepts it (RFC 9110, 12.5.3 and 13.1.2).
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

from gcs.api.errors import error_response

IDENTITY: Final = "identity"
CODINGS: Final[Mapping[str, str]] = {"br": ".br", "gzip": ".gz", IDENTITY: ""}
"""Suffix of the file in each content coding; the better compressed first."""


def qualities(accept_encoding: str | None) -> dict[str, float]:
    """Parse the header (None: absent) into qualities by content coding; invalid entries count as refused."""
    found: dict[str, float] = {}
    for part in (accept_encoding or "").split(","):
        coding, _, parameter = part.partition(";")
        name, given, value = parameter.strip().partition("=")
        try:
            quality = float(value) if given else 1.0
        except ValueError:
            quality = 0.0
        is_valid = not given or (name.strip().lower() == "q" and 0.0 <= quality <= 1.0)
        if coding.strip():
            found[coding.strip().lower()] = quality if is_valid else 0.0
    return found


def chosen(file: Path, accept_encoding: str | None) -> tuple[str, Path] | None:
    """Coding and path of the form of `file` that the caller prefers, the smallest of equals; None: none.

    The uncompressed file is sent unless it is refused, a compressed one only on request.
    """
    liked = qualities(accept_encoding)
    others = dict.fromkeys(CODINGS, liked.get("*", 0.0))
    others[IDENTITY] = 1e-4 if liked.get("*", 1.0) > 0.0 else 0.0  # any coding that is named is preferred
    weights = {coding: weight for coding, weight in (others | liked).items() if weight > 0.0}
    forms = {coding: file.with_name(file.name + ending) for coding, ending in CODINGS.items()}
    accepted = [(coding, path) for coding, path in forms.items() if coding in weights and path.is_file()]
    return max(accepted, key=lambda form: weights[form[0]], default=None)


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

DOCS_HEADERS: Final = {
    **HEADERS,
    "Content-Security-Policy": f"{HEADERS['Content-Security-Policy']}; img-src 'self' data:",
    "Cache-Control": "no-cache",
}
"""Headers of `/docs`: images as well that Swagger UI's style sheet embeds as data."""

FOR_EVER: Final = "public, max-age=31536000, immutable"

NOT_BUILT: Final = "The console is not built here: run make console, or install the wheel, which brings it"


def is_public(path: str) -> bool:
    return path == "/" or ASSET.fullmatch(path) is not None


def routes(folder: Path = DIST, asked: str | None = None) -> APIRouter:
    """Routes of the console that was built into `folder`; each call looks there, so it may be built later.

    `asked` is a foreign origin from which the page may request map tiles.
    """
    router = APIRouter(include_in_schema=False)
    policy = HEADERS["Content-Security-Policy"] + (f"; connect-src 'self' {asked}" if asked else "")
    sent = {**HEADERS, "Content-Security-Policy": policy}

    @router.api_route("/", methods=["GET", "HEAD"])
    async def page(request: Request) -> Response:
        """The console. Browsers revalidate it each time: it names the assets of its own version."""
        return _answer(folder / "index.html", request, {**sent, "Cache-Control": "no-cache"})

    @router.api_route("/assets/{name}", methods=["GET", "HEAD"])
    async def asset(name: str, request: Request) -> Response:
        """One asset. Its content never changes under its name, so browsers may keep it for ever."""
        found = folder / "assets" / name
        if not ASSET.fullmatch(f"/assets/{name}") or name.endswith((".br", ".gz")) or not found.is_file():
            raise HTTPException(404)
        return _answer(found, request, {**sent, "Cache-Control": FOR_EVER})

    @router.get("/docs")
    async def docs(request: Request) -> Response:
        """Swagger UI over `/openapi.json`, built with the console (decision 0026)."""
        return _answer(folder / "docs.html", request, DOCS_HEADERS)

    return router


def _answer(file: Path, request: Request, headers: Mapping[str, str]) -> Response:
    """A file in the content coding that the caller accepts; 304 when the caller has it already."""
    if not file.is_file():
        return error_response(503, NOT_BUILT)
    form = chosen(file, request.headers.get("accept-encoding"))
    if form is None:
        refused = "is sent as br, gzip or identity, and Accept-Encoding refuses all of them"
        response = error_response(406, f"{request.url.path} {refused}")
        response.headers["Vary"] = "Accept-Encoding"
        return response
    coding, path = form
    stat = path.stat()
    etag = f'"{stat.st_mtime_ns:x}-{stat.st_size:x}-{coding}"'
    reported = {**headers, "Vary": "Accept-Encoding", "ETag": etag}
    known = request.headers.get("if-none-match", "").split(",")
    if {etag, "*"} & {part.strip().removeprefix("W/") for part in known}:
        return Response(status_code=304, headers=reported)
    if coding != IDENTITY:
        reported["Content-Encoding"] = coding
    media_type = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
    return FileResponse(path, headers=reported, media_type=media_type)
