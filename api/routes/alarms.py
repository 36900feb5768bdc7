"""Routes of the alarms. They only translate."""

from fastapi import APIRouter

from gcs.api.context import ContextDep
from gcs.api.error_docs import COMMAND, NO_BODY, TOKEN, AlarmId, errors
from gcs.api.schemas import convert
from gcs.api.schemas.fleet import Alarm, AlarmList
from gcs.model.errors import RefusedError
from gcs.service.alarms import AlarmCause

router = APIRouter(prefix="/alarms", tags=["alarms"], dependencies=TOKEN)


@router.get("", summary="Alarms and the overall severity")
async def list_alarms(context: ContextDep) -> AlarmList:
    """Every alarm, the most severe first, and the overall severity."""
    view, problem = context.view, context.health_problem()
    alarms, severity = convert.alarms(view, problem), convert.severity(view, problem)
    return AlarmList(severity=severity, alarms=alarms)


@router.post(
    "/acknowledge",
    summary="Acknowledge every alarm",
    dependencies=NO_BODY,
    responses=COMMAND,
)
async def acknowledge_all_alarms(context: ContextDep) -> list[Alarm]:
    """Returns the alarms that were not acknowledged before. Ended alarms are removed from the list."""
    return [convert.alarm(each) for each in context.service.acknowledge_alarms()]


@router.post(
    "/{alarm_id}/acknowledge",
    summary="Acknowledge one alarm",
    dependencies=NO_BODY,
    responses=COMMAND | errors(404),
)
async def acknowledge_alarm(alarm_id: AlarmId, context: ContextDep) -> Alarm:
    """The alarm stays listed while its cause lasts, with name and time of the first acknowledgement."""
    if alarm_id == AlarmCause.CONTROL_STOPPED.value:
        raise RefusedError("control-stopped is not acknowledged: it stays on top until control runs again")
    return convert.alarm(context.service.acknowledge_alarm(alarm_id))
