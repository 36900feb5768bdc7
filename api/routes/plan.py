"""Routes of the plan: formation, target, orbit, heading and obstacles. They only translate."""

from dataclasses import replace
from http import HTTPStatus
from typing import Annotated, Final

from fastapi import APIRouter, Path, Response

from gcs.api.context import Context, ContextDep
from gcs.api.openapi import READ, TOKEN, ObstacleId, command, errors
from gcs.api.schemas import convert, requests
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import InvalidError, UnknownError
from gcs.model.plan import Obstacle, Orbit
from gcs.model.target_fix import TargetFix
from gcs.service import TargetsView, TrafficView

router = APIRouter(dependencies=TOKEN)

YAW_FIELDS: Final = {"policy": "policy", "heading_deg": "fixed_rad"}
"""Fields of `gcs.model.plan.Yaw`, by those of a request."""


@router.get("/formation", tags=["formation"], summary="Radius, height and law")
async def get_formation(context: ContextDep) -> schemas.Formation:
    """The desired formation and its law, and the radius and height that are commanded now."""
    return convert.formation(context.plan.formation, context.view)


@router.patch("/formation", tags=["formation"], summary="Change radius, height or law", **command())
async def change_formation(body: requests.FormationChange, context: ContextDep) -> schemas.Formation:
    """Radius and height change continuously; the law is refused in flight.

    A radius too small for the fleet is refused, with the smallest allowed one.
    """
    given = body.given()
    context.service.plan.set_formation(replace(context.plan.formation, **given), list(given))
    return await get_formation(context)


@router.get("/target", tags=["target"], summary="Position and velocity of the target now")
async def get_target(context: ContextDep) -> schemas.Target:
    """The target's position and velocity, in both frames; it keeps moving with that velocity."""
    target = context.plan.target
    return convert.target(target, target.position_m(context.now_s()), context.frame)


@router.put("/target", tags=["target"], summary="Set the target", **command())
async def put_target(body: requests.TargetPut, context: ContextDep) -> schemas.Target:
    """Position in the show frame or as latitude and longitude. An absent velocity is 0."""
    context.service.plan.set_target(convert.target_desired(body, context.frame, context.now_s()))
    target = context.plan.target
    return convert.target(target, target.position_m(target.time_s), context.frame)


@router.get("/targets", tags=["target"], summary="Targets that the formation can follow")
async def get_targets(context: ContextDep) -> TargetsView:
    """Those of the configuration, where each is estimated, and which one is followed."""
    return context.view.features.targets or TargetsView("", ())


@router.post("/targets/select", tags=["target"], summary="Follow a target", **command(HTTPStatus.NOT_FOUND))
async def select_target(body: requests.TargetName, context: ContextDep) -> TargetsView:
    """On the ground and in flight. One that was lost is believed anew, wherever its source says it is."""
    context.service.plan.select_target(body.name)
    return await get_targets(context)


@router.post("/targets/hold", tags=["target"], summary="Follow none of them", **command(no_body=True))
async def hold_target(context: ContextDep) -> schemas.Target:
    """The target stands where it is now, until another one is selected or `PUT target` moves it."""
    context.service.plan.hold_target()
    return await get_target(context)


@router.post(
    "/targets/{name}/report",
    tags=["target"],
    summary="Report where a target is",
    **command(HTTPStatus.NOT_FOUND, status=HTTPStatus.NO_CONTENT),
)
async def report_target(
    name: Annotated[str, Path(max_length=32)], body: requests.TargetReport, context: ContextDep
) -> None:
    """For a target with a source of kind `rest`: 1 to 20 reports a second, best with velocity and time."""
    fix = TargetFix(context.now_s(), **body.model_dump(exclude_none=True))
    context.service.plan.report_target(name, fix)


@router.get("/traffic", tags=["target"], summary="Other traffic")
async def get_traffic(context: ContextDep) -> TrafficView:
    """Aircraft, vessels and vehicles that are not of this show, as their sources report them."""
    return context.view.features.traffic or TrafficView.none()


@router.get("/orbit", tags=["target"], summary="Orbit of the formation around the target")
async def get_orbit(context: ContextDep) -> Orbit:
    """Radius, speed and direction of the orbit around the target."""
    return context.plan.orbit


@router.patch("/orbit", tags=["target"], summary="Change the orbit", **command())
async def change_orbit(body: requests.OrbitChange, context: ContextDep) -> Orbit:
    """Changes the given fields. The formation follows continuously."""
    given = body.given()
    context.service.plan.set_orbit(replace(context.plan.orbit, **given), list(given))
    return await get_orbit(context)


@router.get("/yaw", tags=["formation"], summary="Heading of the vehicles")
async def get_yaw(context: ContextDep) -> schemas.Yaw:
    """The policy, and the heading for the policy `fixed`."""
    return convert.yaw(context.plan.yaw, context.frame)


@router.patch("/yaw", tags=["formation"], summary="Change the heading of the vehicles", **command())
async def change_yaw(body: requests.YawChange, context: ContextDep) -> schemas.Yaw:
    """Changes the policy, the heading for the policy `fixed`, or both."""
    fields = [YAW_FIELDS[name] for name in body.given()]
    context.service.plan.set_yaw(convert.yaw_desired(body, context.plan.yaw, context.frame), fields)
    return await get_yaw(context)


# Obstacles


def _box(context: Context, obstacle_id: str) -> Obstacle:
    for box in context.plan.obstacles:
        if box.id == obstacle_id:
            return box
    raise UnknownError(f"there is no obstacle {obstacle_id!r}")


@router.get("/obstacles", tags=["obstacles"], summary="Every obstacle")
async def list_obstacles(context: ContextDep) -> list[Obstacle]:
    """All boxes that the vehicles avoid."""
    return [convert.obstacle(box, context.now_s()) for box in context.plan.obstacles]


@router.get(
    "/obstacles/{obstacle_id}", tags=["obstacles"], summary="One obstacle", responses=READ | errors(404)
)
async def get_obstacle(obstacle_id: ObstacleId, context: ContextDep) -> Obstacle:
    """One box that the vehicles avoid."""
    return convert.obstacle(_box(context, obstacle_id), context.now_s())


@router.post(
    "/obstacles", tags=["obstacles"], summary="Add an obstacle", **command(status=HTTPStatus.CREATED)
)
async def add_obstacle(body: requests.ObstaclePost, context: ContextDep, response: Response) -> Obstacle:
    """Refused if its id is taken; never because vehicles are near: they are led out of it."""
    box = convert.obstacle_desired(body, body.id or context.new_obstacle_id(), context.now_s())
    context.service.plan.add_obstacle(box)
    response.headers["Location"] = f"/api/v1/obstacles/{box.id}"
    return convert.obstacle(box, box.time_s)


@router.put(
    "/obstacles/{obstacle_id}", tags=["obstacles"], summary="Move or resize an obstacle", **command(404)
)
async def change_obstacle(
    obstacle_id: ObstacleId, body: requests.ObstaclePut, context: ContextDep
) -> Obstacle:
    """Replaces the box of this id; never refused because vehicles are near: they are led out of it."""
    if body.id and body.id != obstacle_id:
        raise InvalidError("id", body.id, f"{obstacle_id!r}, as in the path, or absent")
    box = convert.obstacle_desired(body, obstacle_id, context.now_s())
    context.service.plan.change_obstacle(box)
    return convert.obstacle(box, box.time_s)


@router.delete(
    "/obstacles/{obstacle_id}",
    tags=["obstacles"],
    summary="Remove an obstacle",
    **command(404, status=HTTPStatus.NO_CONTENT, no_body=True),
)
async def remove_obstacle(obstacle_id: ObstacleId, context: ContextDep) -> None:
    """Removes a box."""
    context.service.plan.remove_obstacle(obstacle_id)
