"""Every route: it translates, and decides nothing."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from http import HTTPStatus
from typing import Final

from fastapi import APIRouter, Response
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from gcs.api.context import Desk, DeskDep
from gcs.api.error_docs import COMMAND, NO_BODY, READ, TOKEN, errors
from gcs.api.schemas import from_service as convert
from gcs.api.schemas import rest as schemas
from gcs.api.schemas.path_names import CommandId, ObstacleId, VehicleId
from gcs.api.schemas.stream import Access, Status
from gcs.model.errors import InvalidError, UnknownError
from gcs.model.interrupted_flight import Offer
from gcs.model.plan import Obstacle
from gcs.service import ShowAction, VehicleAction

health = APIRouter(tags=["health"])
api = APIRouter(dependencies=TOKEN)


@health.get("/healthz", summary="Is control alive?", responses=errors(503))
async def healthz(desk: DeskDep) -> schemas.Health:
    """200 only while the control loop runs and its newest state is fresh, judged by the clock."""
    problem = desk.health_problem()
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return schemas.Health(
        alive=True,
        view_age_s=max(0.0, desk.age_s()),
        tick_rate_hz=desk.view.tick.rate_hz,
        access=desk.door.text,
        emergency_port=desk.emergency_port,
    )


@health.get("/readyz", summary="Can anybody be ordered anything?", responses=errors(503))
async def readyz(desk: DeskDep) -> schemas.Readiness:
    """200 only while control is alive and a vehicle is ready to start, or flies."""
    problem = convert.readiness_problem(desk.view, desk.now_s())
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return convert.readiness(desk.view)


# Fleet


@api.get("/fleet", tags=["fleet"], summary="Everything at one instant", response_model=schemas.Fleet)
async def get_fleet(desk: DeskDep) -> Response:
    """The show, the formation, the target, the obstacles and every vehicle, as the newest tick left them."""
    return Response(desk.fleet_json(), media_type="application/json")


@api.get("/status", tags=["fleet"], summary="What changes seldom, for who draws", response_model=Status)
async def get_status(desk: DeskDep) -> Response:
    """What the console's stream tells beside its frames; see docs/stream.md."""
    return Response(desk.feed.newest().model_dump_json(), media_type="application/json")


@api.get("/access", tags=["fleet"], summary="Who am I, and what may I do?")
async def get_access(connection: HTTPConnection, desk: DeskDep) -> Access:
    """The name of the token that came along, and its rights."""
    visitor = desk.door.visitor(connection.headers)
    return Access(who=visitor.name, rights=sorted(visitor.rights))


@api.get("/vehicles", tags=["fleet"], summary="Every vehicle")
async def list_vehicles(desk: DeskDep) -> list[schemas.Vehicle]:
    """All configured vehicles, heard or not."""
    return convert.vehicles(desk.view, desk.frame)


@api.get("/vehicles/{vehicle_id}", tags=["fleet"], summary="One vehicle", responses=READ | errors(404))
async def get_vehicle(vehicle_id: VehicleId, desk: DeskDep) -> schemas.Vehicle:
    """One vehicle, as the service believes it to be."""
    for each in convert.vehicles(desk.view, desk.frame):
        if each.id == vehicle_id:
            return each
    known = ", ".join(each.id for each in desk.view.vehicles)
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
    async def command(vehicle_id: VehicleId, desk: DeskDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(desk.service.command_vehicle(vehicle_id, action)))

    return command


def _show_command(action: ShowAction) -> Callable[..., Awaitable[schemas.Command]]:
    async def command(desk: DeskDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(desk.service.command_show(action)))

    return command


for _vehicle_action, _summary in VEHICLE_SUMMARY.items():
    api.add_api_route(
        f"/vehicles/{{vehicle_id}}/{_vehicle_action}",
        _vehicle_command(_vehicle_action),
        methods=["POST"],
        name=f"{_vehicle_action.value.replace('-', '_')}_vehicle",
        summary=_summary,
        description="Accepted as an order; `409` when its phase forbids it.",
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
        desk: DeskDep, response: Response, body: schemas.GroupBody | None = None
    ) -> schemas.Command:
        given = None if body is None else body.vehicles
        return _accepted(response, convert.command(desk.service.command_vehicles(action, given)))

    return command


for _group_action, _summary in GROUP_SUMMARY.items():
    api.add_api_route(
        f"/fleet/{_group_action}",
        _group_command(_group_action),
        methods=["POST"],
        name=f"{_group_action.value.replace('-', '_')}_fleet",
        summary=_summary,
        description=(
            "One order for the vehicles named, or for all that it can apply to. Those that it does not"
            " reach are named in the answer as `not-included`, with the reason; `409` when it reaches none."
        ),
        status_code=HTTPStatus.ACCEPTED,
        tags=["fleet"],
        responses=COMMAND | errors(404),
    )


# Show


@api.get("/show", tags=["show"], summary="Where the show stands")
async def get_show(desk: DeskDep) -> schemas.Show:
    """The show's phase, and what may be asked of it now."""
    return convert.show(desk.view)


@api.post(
    "/show/start",
    tags=["show"],
    summary="Check, take off, assemble and fly",
    status_code=HTTPStatus.ACCEPTED,
    responses=COMMAND | errors(404),
)
async def start_show(
    desk: DeskDep, response: Response, body: schemas.StartBody | None = None
) -> schemas.Command:
    """With the vehicles named, or all online; now, or at a clock time. A selected show by its hash."""
    given = body or schemas.StartBody()
    record = desk.service.command_show(
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
        description="Accepted as an order; `409` when the show's phase forbids it.",
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
    async def command(desk: DeskDep, response: Response) -> schemas.Command:
        return _accepted(response, convert.command(desk.service.settle(offer)))

    return command


for _offer, _summary in OFFER_SUMMARY.items():
    api.add_api_route(
        f"/show/{_offer}",
        _offer_command(_offer),
        methods=["POST"],
        name=f"{_offer.value.replace('-', '_')}_show",
        summary=_summary,
        description="Accepted as an order; `409` when `interrupted` of `/fleet` does not offer it.",
        status_code=HTTPStatus.ACCEPTED,
        tags=["show"],
        dependencies=NO_BODY,
        responses=COMMAND,
    )


@api.get("/commands", tags=["show"], summary="The last orders")
async def list_commands(desk: DeskDep) -> list[schemas.Command]:
    """The newest first, as many as are remembered."""
    return [convert.command(record) for record in desk.service.commands()]


@api.get("/commands/{command_id}", tags=["show"], summary="An order's outcome", responses=READ | errors(404))
async def get_command(command_id: CommandId, desk: DeskDep) -> schemas.Command:
    """How far an accepted order has got, vehicle by vehicle."""
    return convert.command(desk.service.command_record(command_id))


# Formation, target, orbit, yaw


@api.get("/formation", tags=["formation"], summary="Radius and height, wanted and now")
async def get_formation(desk: DeskDep) -> schemas.Formation:
    """What was asked for, and what is commanded now on the way there."""
    return convert.formation(desk.plan.formation, desk.view)


@api.patch("/formation", tags=["formation"], summary="Change radius or height", responses=COMMAND)
async def change_formation(body: schemas.FormationChange, desk: DeskDep) -> schemas.Formation:
    """It follows without a jump. A radius too small for the fleet is refused with the smallest that works."""
    desired = replace(desk.plan.formation, **body.given())
    desk.service.set_formation(desired)
    desk.accepted(replace(desk.plan, formation=desired))
    return convert.formation(desired, desk.view)


@api.get("/target", tags=["target"], summary="Where the target is now")
async def get_target(desk: DeskDep) -> schemas.Target:
    """The target's place and velocity, in both frames; it goes on with its velocity."""
    target = desk.plan.target
    return convert.target(target, target.position_m(desk.now_s()), desk.frame)


@api.put("/target", tags=["target"], summary="Say where the target is", responses=COMMAND)
async def put_target(body: schemas.TargetPut, desk: DeskDep) -> schemas.Target:
    """In the show frame or as latitude and longitude. A velocity left out is 0."""
    now_s = desk.now_s()
    desired = convert.target_desired(body, desk.frame, now_s)
    desk.service.set_target(desired)
    desk.accepted(replace(desk.plan, target=desired))
    return convert.target(desired, desired.position_m(now_s), desk.frame)


@api.get("/orbit", tags=["target"], summary="How the formation circles the target")
async def get_orbit(desk: DeskDep) -> schemas.Orbit:
    """Radius, speed and direction."""
    return convert.orbit(desk.plan.orbit)


@api.patch("/orbit", tags=["target"], summary="Change the orbit", responses=COMMAND)
async def change_orbit(body: schemas.OrbitChange, desk: DeskDep) -> schemas.Orbit:
    """The formation follows without a jump."""
    desired = replace(desk.plan.orbit, **body.given())
    desk.service.set_orbit(desired)
    desk.accepted(replace(desk.plan, orbit=desired))
    return convert.orbit(desired)


@api.get("/yaw", tags=["formation"], summary="Where the vehicles look")
async def get_yaw(desk: DeskDep) -> schemas.Yaw:
    """The policy, and the heading for the policy `fixed`."""
    return convert.yaw(desk.plan.yaw, desk.frame)


@api.patch("/yaw", tags=["formation"], summary="Change where the vehicles look", responses=COMMAND)
async def change_yaw(body: schemas.YawChange, desk: DeskDep) -> schemas.Yaw:
    """The policy, the heading for the policy `fixed`, or both."""
    desired = convert.yaw_desired(body, desk.plan.yaw, desk.frame)
    desk.service.set_yaw(desired)
    desk.accepted(replace(desk.plan, yaw=desired))
    return convert.yaw(desired, desk.frame)


# Obstacles


def _box(desk: Desk, obstacle_id: str) -> Obstacle:
    for box in desk.plan.obstacles:
        if box.id == obstacle_id:
            return box
    raise UnknownError(f"there is no obstacle {obstacle_id!r}")


@api.get("/obstacles", tags=["obstacles"], summary="Every obstacle")
async def list_obstacles(desk: DeskDep) -> list[schemas.Obstacle]:
    """All boxes that the fleet keeps clear of."""
    return [convert.obstacle(box, desk.now_s()) for box in desk.plan.obstacles]


@api.get("/obstacles/{obstacle_id}", tags=["obstacles"], summary="One obstacle", responses=READ | errors(404))
async def get_obstacle(obstacle_id: ObstacleId, desk: DeskDep) -> schemas.Obstacle:
    """One box."""
    return convert.obstacle(_box(desk, obstacle_id), desk.now_s())


@api.post(
    "/obstacles",
    tags=["obstacles"],
    summary="Add an obstacle",
    status_code=HTTPStatus.CREATED,
    responses=COMMAND,
)
async def add_obstacle(body: schemas.ObstaclePost, desk: DeskDep, response: Response) -> schemas.Obstacle:
    """Refused when its id is taken, or it would stand on a vehicle in the air or too close ahead of one."""
    box = convert.obstacle_desired(body, body.id or desk.new_obstacle_id(), desk.now_s())
    desk.service.add_obstacle(box)
    desk.accepted(replace(desk.plan, obstacles=(*desk.plan.obstacles, box)))
    response.headers["Location"] = f"/api/v1/obstacles/{box.id}"
    return convert.obstacle(box, box.time_s)


@api.put(
    "/obstacles/{obstacle_id}",
    tags=["obstacles"],
    summary="Move or resize an obstacle",
    responses=COMMAND | errors(404),
)
async def change_obstacle(
    obstacle_id: ObstacleId, body: schemas.ObstaclePut, desk: DeskDep
) -> schemas.Obstacle:
    """Replace the box of this id. Refused when it would stand on a vehicle or too close ahead of one."""
    if body.id and body.id != obstacle_id:
        raise InvalidError("id", body.id, f"{obstacle_id!r}, as in the path, or absent")
    box = convert.obstacle_desired(body, obstacle_id, desk.now_s())
    desk.service.change_obstacle(box)
    others = desk.plan.obstacles
    desk.accepted(
        replace(desk.plan, obstacles=tuple(box if each.id == obstacle_id else each for each in others))
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
async def remove_obstacle(obstacle_id: ObstacleId, desk: DeskDep) -> None:
    """Forget a box."""
    desk.service.remove_obstacle(obstacle_id)
    left = tuple(box for box in desk.plan.obstacles if box.id != obstacle_id)
    desk.accepted(replace(desk.plan, obstacles=left))
