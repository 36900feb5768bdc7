"""Routes of preflight. They only translate."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Response

from gcs.api.context import ContextDep
from gcs.api.error_docs import COMMAND, NO_BODY, READ, TOKEN, VehicleId, errors
from gcs.api.schemas import convert, reports, requests
from gcs.api.schemas import fleet as schemas
from gcs.model import preflight_report as checks

router = APIRouter(dependencies=TOKEN)

Named = Annotated[
    list[str] | None,
    Query(max_length=1000, description="Vehicles that shall fly; absent: every vehicle that is online."),
]


def _check(one: checks.Check) -> reports.Check:
    return reports.Check(
        name=one.name,
        state=one.state,
        value=one.value,
        unit=one.unit,
        limit=one.limit,
        problem=one.problem,
        to_do=one.to_do,
    )


def _vehicle(one: checks.VehicleChecks) -> reports.VehicleChecks:
    return reports.VehicleChecks(
        id=one.id,
        passes=not one.failed,
        flies=one.flies,
        reason=one.reason,
        checks=[_check(check) for check in one.checks],
    )


@router.get(
    "/preflight",
    tags=["preflight"],
    summary="Preflight report",
    responses=READ | errors(404, 409, 503),
)
async def get_preflight(context: ContextDep, vehicles: Named = None) -> reports.Preflight:
    """Every check of every vehicle and of the fleet, at most once a second, and only on the ground."""
    report = context.service.preflight(vehicles)
    return reports.Preflight(
        passes=report.passes,
        unix_time_s=report.unix_time_s,
        show=report.show,
        show_hash=report.show_hash,
        fleet=[_check(check) for check in report.fleet],
        vehicles=[_vehicle(vehicle) for vehicle in report.vehicles],
        not_flying={vehicle.id: vehicle.reason for vehicle in report.vehicles if not vehicle.flies},
        not_checked=list(report.not_checked),
    )


@router.post(
    "/vehicles/{vehicle_id}/exclude",
    tags=["preflight"],
    summary="Exclude a vehicle from the show",
    status_code=HTTPStatus.ACCEPTED,
    responses=COMMAND | errors(404),
)
async def exclude_vehicle(
    vehicle_id: VehicleId,
    context: ContextDep,
    response: Response,
    body: requests.ExcludeBody | None = None,
) -> schemas.Command:
    """Only on the ground. The vehicle takes part in no start until it is included again."""
    reason = "" if body is None else body.reason
    record = context.service.exclude(vehicle_id, reason)
    response.headers["Location"] = f"/api/v1/commands/{record.id}"
    return convert.command(record)


@router.post(
    "/vehicles/{vehicle_id}/include",
    tags=["preflight"],
    summary="Include an excluded vehicle",
    status_code=HTTPStatus.ACCEPTED,
    dependencies=NO_BODY,
    responses=COMMAND | errors(404),
)
async def include_vehicle(vehicle_id: VehicleId, context: ContextDep, response: Response) -> schemas.Command:
    """Only on the ground. The vehicle must then pass every check, as all others."""
    record = context.service.include(vehicle_id)
    response.headers["Location"] = f"/api/v1/commands/{record.id}"
    return convert.command(record)
