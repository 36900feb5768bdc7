"""Routes of commands: to the show, to vehicles, and a kill in two steps. They only translate."""

from collections.abc import Awaitable, Callable, Mapping
from enum import StrEnum
from http import HTTPStatus
from typing import Final, TypeVar

from fastapi import APIRouter, Response

from gcs.api.auth.authorization import VALID_S
from gcs.api.context import ContextDep
from gcs.api.openapi import READ, TOKEN, CommandId, VehicleId, command, errors
from gcs.api.schemas import fleet as schemas
from gcs.api.schemas import requests
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.lifecycle import Phase
from gcs.service import CALLER, CommandRecord, Service, ShowAction, VehicleAction

router = APIRouter(dependencies=TOKEN)

Action = TypeVar("Action", bound=StrEnum)
Route = Callable[..., Awaitable[CommandRecord]]

ON_VEHICLE: Final = {
    VehicleAction.HOLD: "Leave the formation and hold position",
    VehicleAction.JOIN: "Back from hold into the formation",
    VehicleAction.RETURN: "Return home and land",
    VehicleAction.LAND: "Land where it is",
    VehicleAction.TAKE_CONTROL: "Take control of a vehicle in the air, into hold",
    VehicleAction.CONFIRM_DOWN: "Say that a lost vehicle was seen on the ground",
    VehicleAction.FIND: "Let a vehicle on the ground blink",
}

ON_FLEET: Final = {
    VehicleAction.HOLD: "Several leave the formation and hold position",
    VehicleAction.JOIN: "Several come back from hold into the formation",
    VehicleAction.RETURN: "Several return home and land",
    VehicleAction.LAND: "Several land where they are",
    VehicleAction.TAKE_CONTROL: "Take control of several in the air, into hold",
}

ON_SHOW: Final = {
    ShowAction.STOP: "Return home and land",
    ShowAction.PAUSE: "Stand still where they are",
    ShowAction.RESUME: "Go on after a pause",
    ShowAction.ABORT: "Filtered descent to distinct places, now",
}

ON_OFFER: Final = {
    Offer.TAKE_OVER: "Go on with a flight that was cut off: into the formation, which stands until resume",
    Offer.BRING_HOME: "Vehicles of a flight that was cut off return home and land",
}


def _accepted(response: Response, record: CommandRecord) -> CommandRecord:
    response.headers["Location"] = f"/api/v1/commands/{record.id}"
    return record


def _add_routes(
    path: str,
    name: str,
    summaries: Mapping[Action, str],
    route: Callable[[Action], Route],
    description: str,
    *,
    tag: str,
    no_body: bool = True,
    statuses: tuple[int, ...] = (),
) -> None:
    """Add one route for each action: `path`/ACTION, named ACTION_`name`."""
    for action, summary in summaries.items():
        router.add_api_route(
            f"{path}/{action}",
            route(action),
            methods=["POST"],
            name=f"{action.value.replace('-', '_')}_{name}",
            summary=summary,
            description=description,
            tags=[tag],
            **command(*statuses, status=HTTPStatus.ACCEPTED, no_body=no_body),
        )


def _command(execute: Callable[[Service], CommandRecord]) -> Route:
    async def command(context: ContextDep, response: Response) -> CommandRecord:
        return _accepted(response, execute(context.service))

    return command


def _vehicle_command(action: VehicleAction) -> Route:
    async def command(vehicle_id: VehicleId, context: ContextDep, response: Response) -> CommandRecord:
        return _accepted(response, context.service.commands.command_vehicle(vehicle_id, action))

    return command


def _fleet_command(action: VehicleAction) -> Route:
    async def command(
        context: ContextDep, response: Response, body: requests.GroupBody | None = None
    ) -> CommandRecord:
        given = None if body is None else body.vehicles
        return _accepted(response, context.service.commands.command_vehicles(action, given))

    return command


_add_routes(
    "/vehicles/{vehicle_id}",
    "vehicle",
    ON_VEHICLE,
    _vehicle_command,
    "Accepted as a command; `409` when the vehicle's phase forbids it.",
    tag="fleet",
    statuses=(404,),
)
_add_routes(
    "/fleet",
    "fleet",
    ON_FLEET,
    _fleet_command,
    "One command for the vehicles named, or for all that it can apply to. Those that it does not"
    " reach are named in the answer as `not-included`, with the reason; `409` when it reaches none.",
    tag="fleet",
    no_body=False,
    statuses=(404,),
)


@router.post(
    "/show/start",
    tags=["show"],
    summary="Check, take off, assemble and fly",
    **command(404, status=HTTPStatus.ACCEPTED),
)
async def start_show(
    context: ContextDep, response: Response, body: requests.StartBody | None = None
) -> CommandRecord:
    """Starts the named vehicles or all but those left out, now or later; a selected show needs its hash.

    With `go.confirmed_by_another` the start is proposed: it is pending until another token confirms it.
    """
    given = body or requests.StartBody()
    record = context.service.commands.command_show(
        ShowAction.START, given.vehicles, show_hash=given.show_hash, at_unix_time_s=given.at_unix_time_s
    )
    return _accepted(response, record)


@router.post(
    "/show/confirm",
    tags=["show"],
    summary="Confirm a start that another token proposed",
    **command(status=HTTPStatus.ACCEPTED),
)
async def confirm_start(
    body: requests.GoConfirmation, context: ContextDep, response: Response
) -> CommandRecord:
    """Returns the start's command.

    `409` for the token that proposed it, for another hash, too late, and after anything has changed.
    """
    return _accepted(response, context.service.commands.confirm_start(body.hash))


_add_routes(
    "/show",
    "show",
    ON_SHOW,
    lambda action: _command(lambda service: service.commands.command_show(action)),
    "Accepted as a command; `409` when the show's phase forbids it.",
    tag="show",
)
_add_routes(
    "/show",
    "show",
    ON_OFFER,
    lambda offer: _command(lambda service: service.recovery.settle(offer)),
    "Accepted as a command; `409` when `interrupted` of `/fleet` does not offer it.",
    tag="show",
)


@router.get("/commands", tags=["show"], summary="The last commands")
async def list_commands(context: ContextDep) -> list[CommandRecord]:
    """The commands that the service remembers, the newest first."""
    return list(context.service.command_log.newest())


@router.get(
    "/commands/{command_id}", tags=["show"], summary="Outcome of a command", responses=READ | errors(404)
)
async def get_command(command_id: CommandId, context: ContextDep) -> CommandRecord:
    """An accepted command and its outcome for each vehicle."""
    return context.command_record(command_id)


# Before a start


@router.post(
    "/vehicles/{vehicle_id}/exclude",
    tags=["preflight"],
    summary="Exclude a vehicle from the show",
    **command(404, status=HTTPStatus.ACCEPTED),
)
async def exclude_vehicle(
    vehicle_id: VehicleId, context: ContextDep, response: Response, body: requests.ExcludeBody | None = None
) -> CommandRecord:
    """Only on the ground. The vehicle takes part in no start until it is included again.

    Of a site of several stations the one that flies the vehicle excludes it, and reports the outcome.
    """
    reason = "" if body is None else body.reason
    return _accepted(response, context.service.preflight.exclude(vehicle_id, reason))


@router.post(
    "/vehicles/{vehicle_id}/include",
    tags=["preflight"],
    summary="Include an excluded vehicle",
    **command(404, status=HTTPStatus.ACCEPTED, no_body=True),
)
async def include_vehicle(vehicle_id: VehicleId, context: ContextDep, response: Response) -> CommandRecord:
    """Only on the ground. The vehicle must then pass every check, as all others."""
    return _accepted(response, context.service.preflight.include(vehicle_id))


# Kill


@router.post("/kill", tags=["fleet"], summary="Arm a kill: the first of two steps", **command(404))
async def arm_kill(context: ContextDep, body: requests.GroupBody | None = None) -> schemas.KillArmed:
    """Returns a code and its vehicles: the named ones, else all that are not offline. Nothing is sent yet."""
    phases = dict(zip(context.view.rows.ids, context.view.rows.phases, strict=True))
    named = None if body is None else body.vehicles
    for name in named or ():
        if name not in phases:
            raise UnknownError(f"there is no vehicle {name!r}; there are {', '.join(phases)}")
        if phases[name] is Phase.OFFLINE:
            raise RefusedError(f"{name} is offline: this service does not know where; gcs kill --direct may")
    known = (name for name, phase in phases.items() if phase is not Phase.OFFLINE)
    chosen = list(dict.fromkeys(named or known))
    if not chosen:
        raise RefusedError("all vehicles are offline, at unknown addresses: gcs kill --direct may know them")
    armed = context.kill_switch.arm(chosen, CALLER.get(), context.now_s())
    return schemas.KillArmed(code=armed.code, vehicles=list(armed.vehicles), valid_s=VALID_S)


@router.post(
    "/kill/confirm",
    tags=["fleet"],
    summary="Stop the motors now, even in the air: the second step",
    **command(status=HTTPStatus.ACCEPTED),
)
async def confirm_kill(
    body: requests.KillConfirmation, context: ContextDep, response: Response
) -> CommandRecord:
    """Kills the code's vehicles. A code works once, and for a short time."""
    vehicles = context.kill_switch.confirm(body.code, CALLER.get(), context.now_s())
    return _accepted(response, await context.kill(vehicles))
