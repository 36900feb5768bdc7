"""Routes of health, the state of the fleet, alarms, preflight and map tiles. They only translate."""

import sqlite3
from collections import Counter
from dataclasses import replace
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Response
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection

from gcs.api.context import ContextDep
from gcs.api.openapi import READ, TOKEN, AlarmId, VehicleId, command, errors
from gcs.api.schemas import convert, reports
from gcs.api.schemas import fleet as schemas
from gcs.model.errors import RefusedError, UnknownError
from gcs.model.preflight_report import PreflightReport
from gcs.service import Features
from gcs.service.alarms import Alarm, AlarmCause, overall

health = APIRouter(tags=["health"])
api = APIRouter(dependencies=TOKEN)


@health.get("/healthz", summary="Whether control is alive", responses=errors(503))
async def healthz(context: ContextDep) -> reports.Health:
    """200 only while the control loop runs and its newest state is fresh, judged by the clock."""
    problem = context.health_problem()
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    return reports.Health(
        alive=True,
        view_age_s=max(0.0, context.age_s()),
        tick_rate_hz=context.view.tick.rate_hz,
        access=context.authorization.text,
        emergency_port=context.emergency_port,
    )


@health.get("/readyz", summary="Whether any vehicle can be commanded", responses=errors(503))
async def readyz(context: ContextDep) -> reports.Readiness:
    """200 only while control is alive and at least one vehicle is ready to start or airborne."""
    problem = convert.readiness_problem(context.view, context.now_s())
    if problem:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, problem)
    counts = {"vehicles": len(context.view.rows.ids), "vehicles_airborne": context.view.counts.airborne}
    return reports.Readiness(ready=True, vehicles_ready=sum(map(bool, context.view.rows.ready)), **counts)


# Fleet


@api.get("/fleet", tags=["fleet"], summary="State of the fleet at one instant", response_model=schemas.Fleet)
async def get_fleet(context: ContextDep) -> Response:
    """The show, the formation, the target, the obstacles and every vehicle, as of the newest tick."""
    return Response(context.fleet_json(), media_type="application/json")


@api.get(
    "/status", tags=["fleet"], summary="Slowly changing state, for displays", response_model=schemas.Status
)
async def get_status(context: ContextDep) -> Response:
    """The status message of the console's stream: data that changes seldom (docs/stream.md)."""
    return Response(context.feed.newest().model_dump_json(), media_type="application/json")


@api.get("/features", tags=["fleet"], summary="What each feature reports")
async def get_features(context: ContextDep) -> Features:
    """Of each feature beside the formation, as of the newest tick; null: it is not configured."""
    return context.view.features


@api.get("/access", tags=["fleet"], summary="Name and rights of the token")
async def get_access(connection: HTTPConnection, context: ContextDep) -> reports.Access:
    """The name of the request's token, and its rights."""
    principal = context.authorization.principal(connection.headers)
    return reports.Access(name=principal.name, rights=sorted(principal.rights))


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
    known = ", ".join(context.view.rows.ids)
    raise UnknownError(f"there is no vehicle {vehicle_id!r}; there are {known}")


# Alarms


@api.get("/alarms", tags=["alarms"], summary="Alarms and the overall severity")
async def list_alarms(context: ContextDep) -> schemas.AlarmList:
    """Every alarm, the most severe first, and the overall severity."""
    alarms = convert.current_alarms(context.view, context.health_problem())
    return schemas.AlarmList(severity=overall(alarms), alarms=list(alarms))


@api.post("/alarms/acknowledge", tags=["alarms"], summary="Acknowledge every alarm", **command(no_body=True))
async def acknowledge_all_alarms(context: ContextDep) -> list[Alarm]:
    """Returns the alarms that were not acknowledged before. Ended alarms are removed from the list."""
    return list(context.service.alarms.acknowledge_all())


@api.post(
    "/alarms/{alarm_id}/acknowledge",
    tags=["alarms"],
    summary="Acknowledge one alarm",
    **command(404, no_body=True),
)
async def acknowledge_alarm(alarm_id: AlarmId, context: ContextDep) -> Alarm:
    """The alarm stays listed while its cause lasts, with name and time of the first acknowledgement."""
    if alarm_id == AlarmCause.CONTROL_STOPPED.value:
        raise RefusedError("control-stopped is not acknowledged: it stays on top until control runs again")
    return context.service.alarms.acknowledge(alarm_id)


# Preflight

Named = Annotated[
    list[str] | None,
    Query(
        max_length=1000, description="Vehicles that shall fly; absent: every vehicle that is not left out."
    ),
]


@api.get("/preflight", tags=["preflight"], summary="Preflight report", responses=READ | errors(404, 409, 503))
async def get_preflight(context: ContextDep, vehicles: Named = None) -> PreflightReport:
    """Every check of every vehicle and of the fleet, at most once a second, and only on the ground.

    Of a site of several stations each checks the vehicles that it flies, and a start needs all of them.
    """
    elsewhere = context.elsewhere(vehicles)
    here = None if vehicles is None else [name for name in vehicles if name not in elsewhere]
    if elsewhere and here == []:
        names = ", ".join(f"{name} ({station or 'no station'})" for name, station in elsewhere.items())
        raise RefusedError(f"the station that flies a vehicle checks it, which is not this one: {names}")
    report = context.service.preflight.report(here)
    left = [
        f"vehicles of station {station or '?'}: {count}, which it checks"
        for station, count in Counter(elsewhere.values()).items()
    ]
    return replace(report, not_checked=(*report.not_checked, *left)) if left else report


# Map

TILE_HEADERS = {"Cache-Control": "private, max-age=3600", "X-Content-Type-Options": "nosniff"}


@api.get("/map/{z}/{x}/{y}", include_in_schema=False)
async def get_tile(z: int, x: int, y: int, context: ContextDep) -> Response:
    """One tile as an image. Rows count from the north."""
    ground = context.ground
    if ground is None or ground.file is None:
        raise UnknownError("no map is served here: map.tiles of the configuration names an .mbtiles file")
    try:
        picture = await ground.file.read(z, x, y)
    except sqlite3.Error as error:
        raise HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, f"the map cannot be read: {error}") from None
    return Response(picture, media_type=ground.file.media_type, headers=TILE_HEADERS)
