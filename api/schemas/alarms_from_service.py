"""Converts alarms from the service's types to the API's schemas."""

from gcs.api.schemas.alarms import Alarm as AlarmSchema
from gcs.api.schemas.alarms import AlarmList
from gcs.service import FleetView
from gcs.service.alarms import CAUSES, Alarm, AlarmCause, OverallSeverity, overall


def current(view: FleetView, problem: str) -> tuple[Alarm, ...]:
    """Return the alarms of a state, first the alarm that control has stopped, which a state cannot contain.

    `problem` is the result of `convert.health_problem`. A replay has no control that could stop.
    """
    if not problem or view.playback is not None:
        return view.alarms
    return (_control_stopped(view, problem), *view.alarms)


def _control_stopped(view: FleetView, problem: str) -> Alarm:
    row = CAUSES[AlarmCause.CONTROL_STOPPED]
    return Alarm(
        id=AlarmCause.CONTROL_STOPPED.value,
        severity=row.severity,
        cause=AlarmCause.CONTROL_STOPPED,
        text=f"{row.headline}: {problem}.",
        advice=row.advice,
        vehicles=(),
        since_unix_s=view.unix_time_s,
        raised_unix_s=view.unix_time_s,
    )


def alarm(known: Alarm) -> AlarmSchema:
    return AlarmSchema(
        id=known.id,
        severity=known.severity,
        cause=known.cause.value,
        text=known.text,
        advice=known.advice,
        vehicles=list(known.vehicles),
        since_unix_time_s=known.since_unix_s,
        raised_unix_time_s=known.raised_unix_s,
        acknowledged_by=known.acknowledged_by,
        acknowledged_unix_time_s=known.acknowledged_unix_s,
        ended_unix_time_s=known.ended_unix_s,
        command_id=known.command_id,
    )


def alarms(view: FleetView, problem: str) -> list[AlarmSchema]:
    """All alarms of a state, the most severe first."""
    return [alarm(each) for each in current(view, problem)]


def severity(view: FleetView, problem: str) -> OverallSeverity:
    """The overall severity: that of the worst alarm that lasts."""
    return overall(current(view, problem))


def alarm_list(view: FleetView, problem: str) -> AlarmList:
    """All alarms, and the overall severity."""
    return AlarmList(severity=severity(view, problem), alarms=alarms(view, problem))
