"""Routes of a replay. They only translate."""

from fastapi import APIRouter

from gcs.api.context import Context, ContextDep
from gcs.api.openapi import READ, TOKEN, command, errors
from gcs.api.schemas import requests
from gcs.model.errors import RefusedError
from gcs.service import Playback, Replaying, ReplayMarks, ReportState

router = APIRouter(dependencies=TOKEN, tags=["replay"])


def _replaying(context: Context) -> Replaying:
    """Return the replay of the service. Raises: RefusedError when the service controls real vehicles."""
    replaying = context.service.replaying
    if replaying is None:
        raise RefusedError("this service flies vehicles, and replays nothing: gcs replay FILE shows a record")
    return replaying


@router.get("/replay", summary="How the record is played", responses=READ | errors(409))
async def get_replay(context: ContextDep) -> Playback:
    """Position and speed of the replay; `409` when the service controls vehicles."""
    return _replaying(context).playback


@router.post("/replay", summary="Pause, continue, change speed or position", **command())
async def change_replay(body: requests.ReplayChange, context: ContextDep) -> Playback:
    """Changes the given fields at once; `409` when the service controls vehicles, or to play past the end."""
    return _replaying(context).change(**body.given())


@router.get("/replay/marks", summary="Phases, cues, events, idle time", responses=READ | errors(409))
async def get_replay_marks(context: ContextDep) -> ReplayMarks:
    """Phases, cues, events and idle times of the whole record, for a timeline; they never change."""
    return _replaying(context).marks


@router.get("/replay/report", summary="Flight report: limits kept and broken", responses=READ | errors(409))
async def get_flight_report(context: ContextDep) -> ReportState:
    """Answers at once. The first call starts the analysis beside the replay; poll until it is done."""
    return _replaying(context).make_flight_report()
