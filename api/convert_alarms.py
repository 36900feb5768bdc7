"""Alarms, between the service's types and the wire's."""

from gcs.alarms import CAUSES, Alarm, AlarmCause, OverallSeverity, overall
from gcs.api.wire_alarms import Alarm as WireAlarm
from gcs.api.wire_alarms import AlarmList
from gcs.service import FleetView


def current(view: FleetView, problem: str) -> tuple[Alarm, ...]:
    """The alarms of a state; first of all, that control has stopped, which a state cannot say of itself.

    `problem` is `convert.health_problem`'s answer.
    """
    return (_control_stopped(view, problem), *view.alarms) if problem else view.alarms


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


def alarm(told: Alarm) -> WireAlarm:
    """One of them."""
    return WireAlarm(
        id=told.id,
        severity=told.severity,
        cause=told.cause.value,
        text=told.text,
        advice=told.advice,
        vehicles=list(told.vehicles),
        since_unix_time_s=told.since_unix_s,
        raised_unix_time_s=told.raised_unix_s,
        acknowledged_by=told.acknowledged_by,
        acknowledged_unix_time_s=told.acknowledged_unix_s,
        ended_unix_time_s=told.ended_unix_s,
        order_id=told.order_id,
    )


def alarms(view: FleetView, problem: str) -> list[WireAlarm]:
    """All of a state, the most severe first."""
    return [alarm(each) for each in current(view, problem)]


def severity(view: FleetView, problem: str) -> OverallSeverity:
    """The state of the whole."""
    return overall(current(view, problem))


def alarm_list(view: FleetView, problem: str) -> AlarmList:
    """All of them, and the state of the whole."""
    return AlarmList(severity=severity(view, problem), alarms=alarms(view, problem))
