"""Routes of health, fleet, show, commands, formation, target and obstacles. They only translate."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from http import HTTPStatus
from typing import Final

from fastapi import APIRouter, Response
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from gcs.api.context import Context, ContextDep
from gcs.api.error_docs import COMMAND, NO_BODY, READ, TOKEN, CommandId, ObstacleId, VehicleId, errors
from gcs.api.schemas import convert, requests
from gcs.api.schemas import fleet as schemas
from gcs.api.schemas.fleet import Access, Status
from gcs.model.errors import InvalidError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Obstacle
from gcs.service import ShowAction, VehicleAction

health = APIRouter(tags=["health"])
api = APIRouter(dependencies=TOKEN)


@health.get("/healthz", summary="Whether control is alive", responses=errors(503))
async def healthz(context: ContextDep) -> schemas.Health:
    """200 only while the control loop runs and its newest state is fresh, judged by the clock."""
    problem = context.health_problem()
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return schemas.Health(
        alive=True,
        view_age_s=max(0.0, context.age_s()),
        tick_rate_hz=context.view.tick.rate_hz,
        access=context.authorization.text,
        emergency_port=context.emergency_port,
    )


@health.get("/readyz", summary="Whether any vehicle can be commanded", responses=errors(503))
async def readyz(context: ContextDep) -> schemas.Readiness:
    """200 only while control is alive and at least one vehicle is ready to start or airborne."""
    problem = convert.readiness_problem(context.view, context.now_s())
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return convert.readiness(context.view)


# Fleet


@api.get("/fleet", tags=["fleet"], summary="State of the fleet at one instant", response_model=schemas.Fleet)
async def get_fleet(context: ContextDep) -> Response:
    """The show, the formation, the target, the obstacles and every vehicle, as of the newest tick."""
    return Response(context.fleet_json(), media_type="application/json")


@api.get("/status", tags=["fleet"], summary="Slowly changing state, for displays", response_model=Status)
async def get_status(context: ContextDep) -> Response:
    """The status message of the console's stream: data that changes seldom (docs/stream.md)."""
    return Response(context.feed.newest().model_dump_json(), media_type="application/json")


@api.get("/access", tags=["fleet"], summary="Name and rights of the token")
async def get_access(connection: HTTPConnection, context: ContextDep) -> Access:
    """The name of the request's token, and its rights."""
    principal = context.authorization.principal(connection.headers)
    return Access(name=principal.name, rights=sorted(principal.rights))


@api.get("/vehicles", tags=["fleet"], summary="Every vehicle")
async def list_vehicles(context: ContextDep) -> list[schemas.Vehicle]:
    """All configured vehicles, including those without telemetry."""
    return convert.vehicles(context.view, context.frame)


@api.get("/vehicles/{vehicle_id}", tags=["fleet"], summary="One vehicle", responses=READ | errors(404))
async def get_vehicle(vehicle_id: VehicleId, context: ContextDep) -> schemas.Vehicle:
    """One vehicle, as the service estimates it."""
    for each in convert.vehicles(context.view, context.frame):
        if each.id == vehicle_id:
            return each
    known = ", ".join(each.id for each in context.view.vehicles)
    raise UnknownError(f"there is no vehicle {vehicle_id!r}; there are {known}")


VEHICLE_SUMMARY: Final = {
    VehicleAction.HOLD: "Leave the formation and hold position",
    VehicleAction.JOIN: "Back from hold into the formation",
    VehicleAction.RETURN: "Come home and land",
    VehicleAction.LAND: "Land where it is",
    VehicleAction.TAKE_CONTROL: "Take control of a vehicle in the air, into hold",
    VehicleAction.CONFIRM_DOWN: "Say that a lost vehicle was seen on the ground",
}

SHOW_SUMMARY: Final = {
    ShowAction.STOP: "Come home and land",
    ShowAction.PAUSE: "Stand still where they are",
    ShowAction.RESUME: "Go on after a pause",
    ShowAction.ABORT: "Filtered descent to distinct places, now",
}


def _accepted(response: Response, command: schemas.Command) -> schemas.Command:
    response.headers["Location"] = f"/api/v1/commands/{command.id}"
    return command


def _vehicle_command(action: VehicleAction) -> Callable[..., Awaitable[schemas.Command]]:
    async def command(vehicle_id: VehicleId, context: ContextDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(context.service.command_vehicle(vehicle_id, action)))

    return command


def _show_command(action: ShowAction) -> Callable[..., Awaitable[schemas.Command]]:
    async def command(context: ContextDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(context.service.command_show(action)))

    return command


for _vehicle_action, _summary in VEHICLE_SUMMARY.items():
    api.add_api_route(
        f"/vehicles/{{vehicle_id}}/{_vehicle_action}",
        _vehicle_command(_vehicle_action),
        methods=["POST"],
        name=f"{_vehicle_action.value.replace('-', '_')}_vehicle",
        summary=_summary,
        description="Accepted as a command; `409` when the vehicle's phase forbids it.",
        status_code=HTTPStatus.ACCEPTED,
        tags=["fleet"],
        dependencies=NO_BODY,
        responses=COMMAND | errors(404),
    )


GROUP_SUMMARY: Final = {
    VehicleAction.HOLD: "Several leave the formation and hold position",
    VehicleAction.JOIN: "Several come back from hold into the formation",
    VehicleAction.RETURN: "Several come home and land",
    VehicleAction.LAND: "Several land where they are",
    VehicleAction.TAKE_CONTROL: "Take control of several in the air, into hold",
}


def _group_command(action: VehicleAction) -> Callable[..., Awaitable[schemas.Command]]:
    async def command(
        context: ContextDep, response: Response, body: requests.GroupBody | None = None
    ) -> schemas.Command:
        given = None if body is None else body.vehicles
        return _accepted(response, convert.command(context.service.command_vehicles(action, given)))

    return command


for _group_action, _summary in GROUP_SUMMARY.items():
    api.add_api_route(
        f"/fleet/{_group_action}",
        _group_command(_group_action),
        methods=["POST"],
        name=f"{_group_action.value.replace('-', '_')}_fleet",
        summary=_summary,
        description=(
            "One command for the vehicles named, or for all that it can apply to. Those that it does not"
            " reach are named in the answer as `not-included`, with the reason; `409` when it reaches none."
        ),
        status_code=HTTPStatus.ACCEPTED,
        tags=["fleet"],
        responses=COMMAND | errors(404),
    )


# Show


@api.get("/show", tags=["show"], summary="Phase of the show")
async def get_show(context: ContextDep) -> schemas.Show:
    """The show's phase, and the commands that it accepts now."""
    return convert.show(context.view)


@api.post(
    "/show/start",
    tags=["show"],
    summary="Check, take off, assemble and fly",
    status_code=HTTPStatus.ACCEPTED,
    responses=COMMAND | errors(404),
)
async def start_show(
    context: ContextDep, response: Response, body: requests.StartBody | None = None
) -> schemas.Command:
    """Starts the named vehicles or all online ones, now or later; a selected show needs its hash."""
    given = body or requests.StartBody()
    record = context.service.command_show(
        ShowAction.START,
        given.vehicles,
        show_hash=given.show_hash,
        at_unix_time_s=given.at_unix_time_s,
    )
    return _accepted(response, convert.command(record))


for _show_action, _summary in SHOW_SUMMARY.items():
    api.add_api_route(
        f"/show/{_show_action}",
        _show_command(_show_action),
        methods=["POST"],
        name=f"{_show_action.value}_show",
        summary=_summary,
        description="Accepted as a command; `409` when the show's phase forbids it.",
        status_code=HTTPStatus.ACCEPTED,
        tags=["show"],
        dependencies=NO_BODY,
        responses=COMMAND,
    )


OFFER_SUMMARY: Final = {
    Offer.TAKE_OVER: "Go on with a flight that was cut off: into the formation, which stands until resume",
    Offer.BRING_HOME: "Bring a flight that was cut off home to where it took off",
}


def _offer_command(offer: Offer) -> Callable[..., Awaitable[schemas.Command]]:
    async def command(context: ContextDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(context.service.settle(offer)))

    return command


for _offer, _summary in OFFER_SUMMARY.items():
    api.add_api_route(
        f"/show/{_offer}",
        _offer_command(_offer),
        methods=["POST"],
        name=f"{_offer.value.replace('-', '_')}_show",
        summary=_summary,
        description="Accepted as a command; `409` when `interrupted` of `/fleet` does not offer it.",
        status_code=HTTPStatus.ACCEPTED,
        tags=["show"],
        dependencies=NO_BODY,
        responses=COMMAND,
    )


@api.get("/commands", tags=["show"], summary="The last commands")
async def list_commands(context: ContextDep) -> list[schemas.Command]:
    """The commands that the service remembers, the newest first."""
    return [convert.command(record) for record in context.service.commands()]


@api.get(
    "/commands/{command_id}", tags=["show"], summary="Outcome of a command", responses=READ | errors(404)
)
async def get_command(command_id: CommandId, context: ContextDep) -> schemas.Command:
    """An accepted command and its outcome for each vehicle."""
    return convert.command(context.service.command_record(command_id))


# Formation, target, orbit, yaw


@api.get("/formation", tags=["formation"], summary="Radius and height, desired and now")
async def get_formation(context: ContextDep) -> schemas.Formation:
    """The desired formation, and the radius and height that are commanded now."""
    return convert.formation(context.plan.formation, context.view)


@api.patch("/formation", tags=["formation"], summary="Change radius or height", responses=COMMAND)
async def change_formation(body: requests.FormationChange, context: ContextDep) -> schemas.Formation:
    """Changes continuously. A radius too small for the fleet is refused, with the smallest allowed one."""
    desired = replace(context.plan.formation, **body.given())
    context.service.set_formation(desired)
    context.accepted(replace(context.plan, formation=desired))
    return convert.formation(desired, context.view)


@api.get("/target", tags=["target"], summary="Position and velocity of the target now")
async def get_target(context: ContextDep) -> schemas.Target:
    """The target's position and velocity, in both frames; it keeps moving with that velocity."""
    target = context.plan.target
    return convert.target(target, target.position_m(context.now_s()), context.frame)


@api.put("/target", tags=["target"], summary="Set the target", responses=COMMAND)
async def put_target(body: requests.TargetPut, context: ContextDep) -> schemas.Target:
    """Position in the show frame or as latitude and longitude. An absent velocity is 0."""
    now_s = context.now_s()
    desired = convert.target_desired(body, context.frame, now_s)
    context.service.set_target(desired)
    context.accepted(replace(context.plan, target=desired))
    return convert.target(desired, desired.position_m(now_s), context.frame)


@api.get("/orbit", tags=["target"], summary="Orbit of the formation around the target")
async def get_orbit(context: ContextDep) -> schemas.Orbit:
    """Radius, speed and direction of the orbit around the target."""
    return convert.orbit(context.plan.orbit)


@api.patch("/orbit", tags=["target"], summary="Change the orbit", responses=COMMAND)
async def change_orbit(body: requests.OrbitChange, context: ContextDep) -> schemas.Orbit:
    """Changes the given fields. The formation follows continuously."""
    desired = replace(context.plan.orbit, **body.given())
    context.service.set_orbit(desired)
    context.accepted(replace(context.plan, orbit=desired))
    return convert.orbit(desired)


@api.get("/yaw", tags=["formation"], summary="Heading of the vehicles")
async def get_yaw(context: ContextDep) -> schemas.Yaw:
    """The policy, and the heading for the policy `fixed`."""
    return convert.yaw(context.plan.yaw, context.frame)


@api.patch("/yaw", tags=["formation"], summary="Change the heading of the vehicles", responses=COMMAND)
async def change_yaw(body: requests.YawChange, context: ContextDep) -> schemas.Yaw:
    """Changes the policy, the heading for the policy `fixed`, or both."""
    desired = convert.yaw_desired(body, context.plan.yaw, context.frame)
    context.service.set_yaw(desired)
    context.accepted(replace(context.plan, yaw=desired))
    return convert.yaw(desired, context.frame)


# Obstacles


def _box(context: Context, obstacle_id: str) -> Obstacle:
    for box in context.plan.obstacles:
        if box.id == obstacle_id:
            return box
    raise UnknownError(f"there is no obstacle {obstacle_id!r}")


@api.get("/obstacles", tags=["obstacles"], summary="Every obstacle")
async def list_obstacles(context: ContextDep) -> list[schemas.Obstacle]:
    """All boxes that the vehicles avoid."""
    return [convert.obstacle(box, context.now_s()) for box in context.plan.obstacles]


@api.get("/obstacles/{obstacle_id}", tags=["obstacles"], summary="One obstacle", responses=READ | errors(404))
async def get_obstacle(obstacle_id: ObstacleId, context: ContextDep) -> schemas.Obstacle:
    """One box that the vehicles avoid."""
    return convert.obstacle(_box(context, obstacle_id), context.now_s())


@api.post(
    "/obstacles",
    tags=["obstacles"],
    summary="Add an obstacle",
    status_code=HTTPStatus.CREATED,
    responses=COMMAND,
)
async def add_obstacle(
    body: requests.ObstaclePost, context: ContextDep, response: Response
) -> schemas.Obstacle:
    """Refused if its id is taken, or if it would contain an airborne vehicle or be too close ahead of one."""
    box = convert.obstacle_desired(body, body.id or context.new_obstacle_id(), context.now_s())
    context.service.add_obstacle(box)
    context.accepted(replace(context.plan, obstacles=(*context.plan.obstacles, box)))
    response.headers["Location"] = f"/api/v1/obstacles/{box.id}"
    return convert.obstacle(box, box.time_s)


@api.put(
    "/obstacles/{obstacle_id}",
    tags=["obstacles"],
    summary="Move or resize an obstacle",
    responses=COMMAND | errors(404),
)
async def change_obstacle(
    obstacle_id: ObstacleId, body: requests.ObstaclePut, context: ContextDep
) -> schemas.Obstacle:
    """Replaces the box of this id. Refused when it would contain a vehicle or be too close ahead of one."""
    if body.id and body.id != obstacle_id:
        raise InvalidError("id", body.id, f"{obstacle_id!r}, as in the path, or absent")
    box = convert.obstacle_desired(body, obstacle_id, context.now_s())
    context.service.change_obstacle(box)
    others = context.plan.obstacles
    context.accepted(
        replace(context.plan, obstacles=tuple(box if each.id == obstacle_id else each for each in others))
    )
    return convert.obstacle(box, box.time_s)


@api.delete(
    "/obstacles/{obstacle_id}",
    tags=["obstacles"],
    summary="Remove an obstacle",
    status_code=HTTPStatus.NO_CONTENT,
    dependencies=NO_BODY,
    responses=COMMAND | errors(404),
)
async def remove_obstacle(obstacle_id: ObstacleId, context: ContextDep) -> None:
    """Removes a box."""
    context.service.remove_obstacle(obstacle_id)
    left = tuple(box for box in context.plan.obstacles if box.id != obstacle_id)
    context.accepted(replace(context.plan, obstacles=left))
