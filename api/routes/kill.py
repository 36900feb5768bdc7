"""Routes of a kill, in two steps. They only translate."""

from http import HTTPStatus

from fastapi import APIRouter, Response

from gcs.api.auth.kill_confirmation import VALID_S
from gcs.api.context import ContextDep
from gcs.api.error_docs import COMMAND, TOKEN, errors
from gcs.api.schemas import convert, requests
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.lifecycle import Phase
from gcs.service import CALLER

kill = APIRouter(prefix="/kill", tags=["fleet"], dependencies=TOKEN)


@kill.post("", summary="Arm a kill: the first of two steps", responses=COMMAND | errors(404))
async def arm_kill(context: ContextDep, body: requests.KillBody | None = None) -> schemas.KillArmed:
    """Returns a code and its vehicles: the named ones, else all that are not offline. Nothing is sent yet."""
    phases = {each.id: each.phase for each in context.view.vehicles}
    named = (body or requests.KillBody()).vehicles
    for name in named or ():
        if name not in phases:
            raise UnknownError(f"there is no vehicle {name!r}; there are {', '.join(phases)}")
        if phases[name] is Phase.OFFLINE:
            raise RefusedError(f"{name} is offline: this service does not know where; gcs kill --direct may")
    chosen = list(
        dict.fromkeys(named or (name for name, phase in phases.items() if phase is not Phase.OFFLINE))
    )
    if not chosen:
        raise RefusedError("all vehicles are offline, at unknown addresses: gcs kill --direct may know them")
    armed = context.kill_switch.arm(chosen, CALLER.get(), context.now_s())
    return schemas.KillArmed(code=armed.code, vehicles=list(armed.vehicles), valid_s=VALID_S)


@kill.post(
    "/confirm",
    summary="Stop the motors now, even in the air: the second step",
    status_code=HTTPStatus.ACCEPTED,
    responses=COMMAND,
)
async def confirm_kill(
    body: requests.KillConfirmation, context: ContextDep, response: Response
) -> schemas.Command:
    """Kills the code's vehicles. A code works once, and for a short time."""
    vehicles = context.kill_switch.confirm(body.code, CALLER.get(), context.now_s())
    command = convert.command(context.service.kill(vehicles))
    response.headers["Location"] = f"/api/v1/commands/{command.id}"
    return command
