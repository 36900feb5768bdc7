"""Routes of written shows and of a replay. They only translate."""

from http import HTTPStatus
from typing import Annotated, Any, Final

from fastapi import APIRouter, Path
from starlette.requests import Request

from gcs import service
from gcs.api.context import Context, ContextDep
from gcs.api.openapi import READ, TOKEN, command, errors
from gcs.api.schemas import convert, reports, requests
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import RefusedError

Name = Annotated[str, Path(pattern=requests.NAME_PATTERN, examples=["lighthouse"])]

YAML_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": "A show file, in UTF-8, at most 64 KiB. Kept as it is; its check finds what is wrong.",
        "content": {
            "application/yaml": {
                "schema": {},  # any YAML: the show's check reports its errors
                "example": "about: A ring that stands.\norigin: {latitude_deg: 47.397742, ...}\n",
            }
        },
    }
}

files = APIRouter(prefix="/shows", tags=["shows"], dependencies=TOKEN)
selected = APIRouter(prefix="/show", tags=["show"], dependencies=TOKEN)
replay = APIRouter(prefix="/replay", tags=["replay"], dependencies=TOKEN)


@selected.get("", summary="Phase of the show")
async def get_show(context: ContextDep) -> schemas.Show:
    """The show's phase, and the commands that it accepts now."""
    return convert.show(context.view)


@files.get("", summary="Every show file", responses=errors(409))
async def list_shows(context: ContextDep) -> list[service.StoredShow]:
    """All uploaded show files, by name."""
    return await context.service.shows.list_shows()


@files.get("/{name}", summary="One show file", responses=READ | errors(404, 409))
async def get_show_file(name: Name, context: ContextDep) -> reports.ShowText:
    """The show file as it was uploaded."""
    return reports.ShowText(name=name, text=await context.service.shows.text(name))


@files.put("/{name}", summary="Upload a show file", openapi_extra=YAML_BODY, **command())
async def put_show_file(name: Name, request: Request, context: ContextDep) -> service.StoredShow:
    """Stores the file, and replaces one of the same name. A selected or flying show does not change."""
    return await context.service.shows.store(name, await request.body())


@files.delete(
    "/{name}", summary="Remove a show file", **command(404, status=HTTPStatus.NO_CONTENT, no_body=True)
)
async def remove_show_file(name: Name, context: ContextDep) -> None:
    """Deletes the file. A selected or flying show does not change."""
    await context.service.shows.remove(name)


@files.post("/{name}/check", summary="Check a show", **command(404, status=HTTPStatus.ACCEPTED, no_body=True))
async def check_show(name: Name, context: ContextDep) -> service.ShowCheck:
    """Flies the show in virtual time, in a process of the lowest priority; GET returns its progress."""
    return context.service.shows.check(name)


@files.get("/{name}/check", summary="Result of a show check", responses=READ | errors(404))
async def get_show_check(name: Name, context: ContextDep) -> service.ShowCheck:
    """The newest check of this show since the service started."""
    return context.service.shows.checked(name)


@files.post("/{name}/select", summary="Select a show to fly next", **command(404))
async def select_show(name: Name, body: requests.SelectBody, context: ContextDep) -> service.SelectedShow:
    """Only on the ground. Refused without a passed check of this version, or if it does not fit the fleet."""
    return context.service.player.select(name, body.hash)


@selected.post(
    "/deselect",
    summary="Deselect the show: manual control",
    **command(status=HTTPStatus.NO_CONTENT, no_body=True),
)
async def deselect_show(context: ContextDep) -> None:
    """Only on the ground. Manual control: formation, target and orbit follow the operator's commands."""
    context.service.player.deselect()


@selected.post("/seek", summary="Start at a cue", **command(404))
async def seek_show(body: requests.SeekBody, context: ContextDep) -> service.SelectedShow:
    """Only on the ground. The show begins at the first occurrence of that cue."""
    return context.service.player.seek(body.cue)


def _replaying(context: Context) -> service.Replaying:
    """Return the replay of the service. Raises: RefusedError when the service controls real vehicles."""
    replaying = context.service.replaying
    if replaying is None:
        raise RefusedError("this service flies vehicles, and replays nothing: gcs replay FILE shows a record")
    return replaying


@replay.get("", summary="How the record is played", responses=READ | errors(409))
async def get_replay(context: ContextDep) -> service.Playback:
    """Position and speed of the replay; `409` when the service controls vehicles."""
    return _replaying(context).playback


@replay.post("", summary="Pause, continue, change speed or position", **command())
async def change_replay(body: requests.ReplayChange, context: ContextDep) -> service.Playback:
    """Changes the given fields at once; `409` when the service controls vehicles, or to play past the end."""
    return _replaying(context).change(**body.given())


@replay.get("/marks", summary="Phases, cues, events, idle time", responses=READ | errors(409))
async def get_replay_marks(context: ContextDep) -> service.ReplayMarks:
    """Phases, cues, events and idle times of the whole record, for a timeline; they never change."""
    return _replaying(context).marks


@replay.get("/report", summary="Flight report: limits kept and broken", responses=READ | errors(409))
async def get_flight_report(context: ContextDep) -> service.ReportState:
    """Answers at once. The first call starts the analysis beside the replay; poll until it is done."""
    return _replaying(context).make_flight_report()
