"""The console at `/` and `/docs`: built pages and their assets, public because they contain no flight data.

`make console` builds them from `api/console/`; a wheel contains them. A file is sent compressed or as it is,
as the caller accepts it (RFC 9110, 12.5.3 and 13.1.2).
"""

import mimetypes
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from fastapi import APIRouter
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from gcs.api.errors import error_response

TWINS: Final[Mapping[str, str]] = {"br": ".br", "gzip": ".gz"}
"""Suffix of the compressed file beside the file, by content coding; the better compressed first."""

IDENTITY: Final = "identity"


class Form(NamedTuple):
    """A file in one content coding."""

    path: Path
    coding: str  # a key of TWINS, or IDENTITY

    @property
    def headers(self) -> dict[str, str]:
        """Headers of this form: its ETag and coding. Raises: OSError when the file is gone."""
        stat = self.path.stat()
        reported = {
            "Vary": "Accept-Encoding",
            "ETag": f'"{stat.st_mtime_ns:x}-{stat.st_size:x}-{self.coding}"',
        }
        return reported if self.coding == IDENTITY else {**reported, "Content-Encoding": self.coding}


def is_twin(name: str) -> bool:
    return name.endswith(tuple(TWINS.values()))


def chosen(file: Path, accept_encoding: str | None) -> Form | None:
    """Return the form of `file` that the caller prefers, the smallest of equals; None: it accepts none."""
    liked = qualities(accept_encoding)
    best: tuple[float, Form] | None = None
    for coding, ending in (*TWINS.items(), (IDENTITY, "")):
        path = file.with_name(file.name + ending)
        quality = _quality(coding, liked)
        if quality > 0.0 and (best is None or quality > best[0]) and path.is_file():
            best = quality, Form(path, coding)
    return None if best is None else best[1]


def qualities(accept_encoding: str | None) -> dict[str, float]:
    """Parse the header (None: absent) into qualities by content coding; invalid entries count as refused."""
    found: dict[str, float] = {}
    for part in (accept_encoding or "").split(","):
        coding, _, parameter = part.partition(";")
        if coding.strip():
            found[coding.strip().lower()] = _number(parameter)
    return found


def _number(parameter: str) -> float:
    name, given, value = parameter.strip().partition("=")
    if not given:
        return 1.0
    try:
        quality = float(value)
    except ValueError:
        return 0.0
    return quality if name.strip().lower() == "q" and 0.0 <= quality <= 1.0 else 0.0


def _quality(coding: str, liked: Mapping[str, float]) -> float:
    """Uncompressed files are sent unless refused, compressed ones only on request."""
    if coding in liked:
        return liked[coding]
    if coding == IDENTITY:
        return 1e-4 if liked.get("*", 1.0) > 0.0 else 0.0  # any coding that is named is preferred
    return liked.get("*", 0.0)


def is_known(etag: str, if_none_match: str | None) -> bool:
    known = {part.strip().removeprefix("W/") for part in (if_none_match or "").split(",")}
    return etag in known or "*" in known


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
        return _page(folder / "index.html", request, {**sent, "Cache-Control": "no-cache"})

    @router.api_route("/assets/{name}", methods=["GET", "HEAD"])
    async def asset(name: str, request: Request) -> Response:
        """One asset. Its content never changes under its name, so browsers may keep it for ever."""
        found = folder / "assets" / name
        if ASSET.fullmatch(f"/assets/{name}") is None or is_twin(name) or not found.is_file():
            raise HTTPException(404)
        return answer(found, request, {**sent, "Cache-Control": FOR_EVER})

    @router.get("/docs")
    async def docs(request: Request) -> Response:
        """Swagger UI over `/openapi.json`, built with the console (decision 0026)."""
        return _page(folder / "docs.html", request, DOCS_HEADERS)

    return router


def _page(file: Path, request: Request, headers: Mapping[str, str]) -> Response:
    return answer(file, request, headers) if file.is_file() else error_response(503, NOT_BUILT)


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
