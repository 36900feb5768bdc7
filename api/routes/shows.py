"""Routes of written shows. They translate, and decide nothing."""

from http import HTTPStatus
from typing import Annotated, Any, Final

from fastapi import APIRouter, Path
from starlette.requests import Request

from gcs.api.context import ContextDep
from gcs.api.error_docs import COMMAND, NO_BODY, READ, TOKEN, errors
from gcs.api.schemas import from_service as convert
from gcs.api.schemas import rest as schemas
from gcs.api.schemas import shows as show_schemas

Name = Annotated[str, Path(pattern=show_schemas.NAME_PATTERN, examples=["lighthouse"])]

YAML_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": "A show file, in UTF-8, at most 64 KiB. Kept as it is; its check finds what is wrong.",
        "content": {
            "application/yaml": {
                "schema": {},  # any YAML: what is wrong with it, its check tells
                "example": "about: A ring that stands.\norigin: {latitude_deg: 47.397742, ...}\n",
            }
        },
    }
}

files = APIRouter(prefix="/shows", tags=["shows"], dependencies=TOKEN)
selected = APIRouter(prefix="/show", tags=["show"], dependencies=TOKEN)


@files.get("", summary="Every show file", responses=errors(409))
async def list_shows(context: ContextDep) -> list[show_schemas.StoredShow]:
    """All files that were uploaded, by name."""
    return [convert.stored_show(each) for each in await context.service.shows.list_shows()]


@files.get("/{name}", summary="One show file", responses=READ | errors(404, 409))
async def get_show_file(name: Name, context: ContextDep) -> show_schemas.ShowText:
    """As it was uploaded."""
    return show_schemas.ShowText(name=name, text=await context.service.shows.text(name))


@files.put("/{name}", summary="Upload a show file", responses=COMMAND, openapi_extra=YAML_BODY)
async def put_show_file(name: Name, request: Request, context: ContextDep) -> show_schemas.StoredShow:
    """Kept under that name, in place of what had it. What is selected or flies does not change by that."""
    return convert.stored_show(await context.service.shows.store(name, await request.body()))


@files.delete(
    "/{name}",
    summary="Remove a show file",
    status_code=HTTPStatus.NO_CONTENT,
    dependencies=NO_BODY,
    responses=COMMAND | errors(404),
)
async def remove_show_file(name: Name, context: ContextDep) -> None:
    """Forget a file. What is selected or flies does not change by that."""
    await context.service.shows.remove(name)


@files.post(
    "/{name}/check",
    summary="Check a show",
    status_code=HTTPStatus.ACCEPTED,
    dependencies=NO_BODY,
    responses=COMMAND | errors(404),
)
async def check_show(name: Name, context: ContextDep) -> show_schemas.ShowCheck:
    """Fly it in virtual time, in a process of its own at the lowest priority; GET tells how far that is."""
    return convert.show_check(context.service.shows.check(name))


@files.get("/{name}/check", summary="What a check found", responses=READ | errors(404))
async def get_show_check(name: Name, context: ContextDep) -> show_schemas.ShowCheck:
    """Of the newest check since this service began."""
    return convert.show_check(context.service.shows.checked(name))


@files.post("/{name}/select", summary="Have a show fly next", responses=COMMAND | errors(404))
async def select_show(name: Name, body: show_schemas.SelectBody, context: ContextDep) -> schemas.SelectedShow:
    """On the ground. Refused when it was never checked, is not good, has changed since, or does not fit."""
    return convert.selected_show(context.service.select_show(name, body.hash))


@selected.post(
    "/deselect",
    summary="Fly what is told instead",
    status_code=HTTPStatus.NO_CONTENT,
    dependencies=NO_BODY,
    responses=COMMAND,
)
async def deselect_show(context: ContextDep) -> None:
    """On the ground."""
    context.service.deselect_show()


@selected.post("/seek", summary="Begin at a cue", responses=COMMAND | errors(404))
async def seek_show(body: show_schemas.SeekBody, context: ContextDep) -> schemas.SelectedShow:
    """On the ground: the show begins with that cue, the first time that it is played."""
    return convert.selected_show(context.service.seek_show(body.cue))
