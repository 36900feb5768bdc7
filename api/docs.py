"""The page at /docs: every operation, to read and to try, from one file and without the internet."""

from importlib.resources import files

from fastapi import APIRouter
from starlette.responses import HTMLResponse

router = APIRouter()


@router.get("/docs", include_in_schema=False)
async def docs() -> HTMLResponse:
    """A page that shows /openapi.json."""
    return HTMLResponse(files("api").joinpath("docs.html").read_text(encoding="utf-8"))
