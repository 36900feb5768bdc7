"""Routes of written shows and of a replay. They only translate."""

from http import HTTPStatus
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Path, Query
from starlette.requests import Request
from starlette.responses import Response

from gcs import service
from gcs.api.context import Context, ContextDep
from gcs.api.drawings import Place, Upload
from gcs.api.openapi import READ, TOKEN, command, errors
from gcs.api.schemas import convert, reports, requests
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import RefusedError

Name = Annotated[str, Path(pattern=requests.NAME_PATTERN, examples=["lighthouse"])]

YAML_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": f"A show file, in UTF-8, at most {requests.BODY_MAX_BYTES // 1024} KiB. "
        "Kept as it is; its check finds what is wrong.",
        "content": {
            "application/yaml": {
                "schema": {},  # any YAML: the show's check reports its errors
                "example": "about: A ring that stands.\norigin: {latitude_deg: 47.397742, ...}\n",
            }
        },
    }
}

DRAWING_BODY: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "description": f"The file of the drawing, at most {service.DRAWING_MAX_BYTES >> 20} MiB.",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}

Seconds = Annotated[float, Query(ge=0.0, le=86_400.0)]
Rate = Annotated[float, Query(ge=0.01, le=10.0, description="Lowered where there would be too many samples.")]

files = APIRouter(prefix="/shows", tags=["shows"], dependencies=TOKEN)
selected = APIRouter(prefix="/show", tags=["show"], dependencies=TOKEN)
replay = APIRouter(prefix="/replay", tags=["replay"], dependencies=TOKEN)


@selected.get("", summary="Phase of the show")
async def get_show(context: ContextDep) -> schemas.Show:
    """The show's phase, and the commands that it accepts now."""
    return convert.show(context.view, context.health_problem())


@files.get("", summary="Every show file", responses=errors(409))
async def list_shows(context: ContextDep) -> list[service.StoredShow]:
    """All uploaded show files, by name."""
    return await context.service.shows.list_shows()


@files.post(
    "",
    summary="Upload a drawing",
    openapi_extra=DRAWING_BODY,
    **command(status=HTTPStatus.CREATED),
)
async def import_drawing(
    request: Request,
    context: ContextDep,
    name: Annotated[str, Query(pattern=requests.NAME_PATTERN, examples=["night"])],
    format: Annotated[  # noqa: A002 (the caller's word)
        Literal["skyc", "zip", "csv"],
        Query(description="skyc: Skybrush; zip: a CSV file of each vehicle; csv: Crazyswarm's polynomials."),
    ],
    origin: Annotated[
        Literal["drawing", "service"],
        Query(description="service: the service's place on Earth replaces the one in the drawing."),
    ] = "drawing",
) -> reports.ImportedShow:
    """Makes a show of a file that another program wrote, and replaces one of the same name.

    A drawing that names no place on Earth gets the service's. A selected or flying show does not change.
    """
    upload = Upload(name, format, at_service=origin == "service")
    found = await context.drawings.imported(upload, request, context.service.shows)
    return reports.ImportedShow.model_validate(found)


@files.get(
    "/{name}/drawing",
    summary="A drawn show, for a preview",
    responses=READ | errors(404, 409) | {200: {"model": reports.DrawnSamples}},
    response_class=Response,
)
async def get_drawing(
    name: Name,
    context: ContextDep,
    from_s: Seconds = 0.0,
    to_s: Seconds | None = None,
    rate_hz: Rate = 4.0,
) -> Response:
    """Positions and colours at regular times of the show's clock, at most 200,000 positions in all."""
    show = await context.service.shows.drawn_file(name)
    samples = await context.drawings.sampled(show, from_s, to_s, rate_hz)
    return Response(samples, media_type="application/json")


@files.get("/{name}/placement", summary="Where a drawn show lies", responses=READ | errors(404, 409))
async def get_placement(
    name: Name,
    context: ContextDep,
    x_m: Annotated[requests.PlacedAlong | None, Query()] = None,
    y_m: Annotated[requests.PlacedAlong | None, Query()] = None,
    turn_deg: Annotated[requests.PlacedTurn | None, Query()] = None,
    fit: Annotated[
        bool, Query(description="Fit the pads to where the vehicles stand, from the given placement on.")
    ] = False,
) -> reports.PlacedShow:
    """The pads of a drawn show beside the vehicles on the ground. Nothing changes.

    What of the placement is not given is as stored. The fit is of least squares, with the best assignment of
    vehicles to pads; of fits that are as good (a square has four) the one with the least turn counts.
    """
    show = await context.service.shows.drawn_file(name)
    place = Place(show, x_m, y_m, turn_deg, fits=fit)
    return reports.PlacedShow.model_validate(await context.drawings.placement(place, context.view.rows))


@files.put("/{name}/placement", summary="Move and turn a drawn show", **command(404))
async def put_placement(name: Name, body: requests.PlacementPut, context: ContextDep) -> reports.PlacedShow:
    """Stores a new version of the show file, which must be checked again.

    The drawing, its pads and the room to the fence move together; the show's origin becomes the service's. A
    selected or flying show does not change.
    """
    shows = context.service.shows
    place = Place(await shows.drawn_file(name), body.x_m, body.y_m, body.turn_deg)
    found, text = await context.drawings.placed(place, context.view.rows)
    await shows.store(name, text)
    return reports.PlacedShow.model_validate(found)


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


@selected.post("/begin", summary="Begin at a clock time", **command())
async def begin_show(body: requests.BeginBody, context: ContextDep) -> service.SelectedShow:
    """The show's first motion begins then, once all vehicles are there; `selected.begin` says how it waits.

    On the ground or in the air, until the show has begun. Take-off is not scheduled by this.
    """
    return context.service.player.begin_at(body.at_unix_time_s)


@selected.delete("/begin", summary="Cancel the time to begin", **command(no_body=True))
async def cancel_begin(context: ContextDep) -> service.SelectedShow:
    """A show that waits in the air then waits until another time is given."""
    return context.service.player.cancel_begin()


@selected.post("/external-clock", summary="Follow an external clock", **command(status=HTTPStatus.NO_CONTENT))
async def follow_external_clock(body: requests.ClockBody, context: ContextDep) -> None:
    """`follow: false` has shows run by this station's clock."""
    context.service.player.follow_external_clock(body.follow)


@selected.get("/marks", summary="Phases, commands, alarms so far", responses=READ)
async def get_marks(context: ContextDep) -> service.FlightMarks:
    """For a timeline of the flight that lasts, else of the last one; in a replay of the whole record."""
    return context.service.events.marks


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


@replay.get("/report", summary="Flight report: limits kept and broken", responses=READ | errors(409))
async def get_flight_report(context: ContextDep) -> service.ReportState:
    """Answers at once. The first call starts the analysis beside the replay; poll until it is done."""
    return _replaying(context).make_flight_report()
