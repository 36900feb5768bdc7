"""Metrics for Prometheus at `/metrics`, computed from the newest state at each request; no state is kept."""

import asyncio
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Final

from fastapi import APIRouter
from prometheus_client import CollectorRegistry
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_1_0_0, generate_latest
from starlette.responses import Response

from gcs.api.context import ContextDep
from gcs.api.openapi import TOKEN
from gcs.api.schemas.convert import current_alarms as current
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.service import FleetView
from gcs.service.alarms import AlarmCause, AlarmSeverity, OverallSeverity, overall
from gcs.service.vehicle_table import VehicleView

router = APIRouter()

Row = Mapping[str, float | None]

VEHICLE_GAUGES: Final = {
    "gcs_vehicle_link_quality": "Share of the requested positions that arrive, 0 to 1.",
    "gcs_vehicle_position_age_seconds": "Since the newest position arrived.",
    "gcs_vehicle_heartbeat_age_seconds": "Since the newest heartbeat arrived.",
    "gcs_vehicle_battery_ratio": "Battery remaining, 0 to 1.",
    "gcs_vehicle_position_uncertainty_meters": "How far off its position may be, sideways.",
    "gcs_vehicle_ready": "1: could be started now.",
    "gcs_vehicle_limited": "1: the safety filter held it back in the newest tick.",
}


def _of_vehicle(each: VehicleView) -> Row:
    values = (
        each.link_quality,
        each.position_age_s,
        each.heartbeat_age_s,
        each.battery_remaining,
        each.position_uncertainty_m,
        float(each.ready),
        float(each.limited_by != ""),
    )
    return dict(zip(VEHICLE_GAUGES, values, strict=True))


@dataclass(frozen=True, slots=True)
class FleetCollector:
    """Makes all metrics of one state."""

    view: FleetView
    problem: str  # why control is not alive; empty when it is
    age_s: float
    access: str
    denied: int
    shed: int

    def collect(self) -> Iterator[Metric]:
        yield from self._service()
        yield from _vehicles(self.view)

    def _service(self) -> Iterator[Metric]:
        view, tick = self.view, self.view.tick
        yield _gauge("gcs_control_alive", "1 while ticks come.", float(not self.problem))
        yield _gauge("gcs_state_age_seconds", "Since the newest state was made.", self.age_s)
        yield _counter("gcs_ticks", "Ticks of the control loop.", tick.count)
        yield _counter("gcs_ticks_missed", "Ticks that were dropped, being too late.", tick.missed)
        for histogram in tick.histograms:
            yield from histogram.collect()
        yield _counter("gcs_setpoints_sent", "Velocity setpoints that left.", view.setpoints_sent)
        yield _counter("gcs_filter_interventions", "Vehicle-ticks that safety changed.", view.interventions)
        yield _gauge(
            "gcs_minimum_separation_meters",
            "Between the nearest two that count, as believed; absent when there are none.",
            view.minimum_separation_m,
        )
        yield _one_of("gcs_show_phase", "1 for the phase that the show is in.", ShowPhase, view.show)
        yield from _alarms(view, self.problem)
        yield _counter("gcs_calls_denied", "Calls that were denied.", self.denied)
        yield _counter("gcs_calls_shed", "Denied calls that exceeded the rate.", self.shed)
        yield InfoMetricFamily("gcs_access", "Whether the service demands tokens.", {"access": self.access})


def _vehicles(view: FleetView) -> Iterator[Metric]:
    families = {
        name: GaugeMetricFamily(name, text, labels=["vehicle"]) for name, text in VEHICLE_GAUGES.items()
    }
    for each in view.vehicles:
        for name, value in _of_vehicle(each).items():
            if value is not None:
                families[name].add_metric([each.id], value)
    yield from families.values()
    where = GaugeMetricFamily(
        "gcs_vehicles_counted", "How many are airborne, on the ground and so on.", labels=["where"]
    )
    for name, count in (("airborne", view.counts.airborne), *asdict(view.counts).items()):
        where.add_metric([name], count)
    yield where
    phases = GaugeMetricFamily("gcs_vehicles", "How many are in each phase.", labels=["phase"])
    for phase in Phase:
        phases.add_metric([phase.value], sum(each.phase is phase for each in view.vehicles))
    yield phases


def _gauge(name: str, text: str, value: float | None) -> Metric:
    family = GaugeMetricFamily(name, text)
    if value is not None:
        family.add_metric([], value)
    return family


def _counter(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(name, text, value)


def _one_of(name: str, text: str, kinds: type[ShowPhase], now: ShowPhase) -> Metric:
    family = GaugeMetricFamily(name, text, labels=["phase"])
    for kind in kinds:
        family.add_metric([kind.value], float(kind is now))
    return family


def _alarms(view: FleetView, problem: str) -> Iterator[Metric]:
    lasting = [alarm for alarm in current(view, problem) if alarm.lasts]
    of_severity = GaugeMetricFamily("formation_alarms", "Alarms that last, by severity.", labels=["severity"])
    for severity in AlarmSeverity:
        of_severity.add_metric([severity.value], sum(alarm.severity is severity for alarm in lasting))
    yield of_severity
    of_cause = GaugeMetricFamily("formation_alarm", "1 while an alarm of this cause lasts.", labels=["cause"])
    causes = {alarm.cause for alarm in lasting}
    for cause in AlarmCause:
        of_cause.add_metric([cause.value], float(cause in causes))
    yield of_cause
    state = GaugeMetricFamily(
        "formation_state", "1 for the state of the whole: the worst severity that lasts.", labels=["severity"]
    )
    worst = overall(lasting)
    for kind in OverallSeverity:
        state.add_metric([kind.value], float(kind is worst))
    yield state
    is_open = sum(alarm.acknowledged_by is None for alarm in current(view, problem))
    yield _gauge("formation_alarms_unacknowledged", "Alarms not acknowledged yet.", float(is_open))


@router.get(
    "/metrics",
    tags=["health"],
    summary="Metrics in the text format of Prometheus",
    dependencies=TOKEN,
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(context: ContextDep) -> Response:
    """Every metric in the text format of Prometheus."""
    authorization = context.authorization
    problem, age_s = context.health_problem(), max(0.0, context.age_s())
    collector = FleetCollector(
        context.view, problem, age_s, authorization.text, authorization.denied, authorization.shed
    )
    # in a thread: a thousand vehicles need thousands of lines, which would delay ticks on the event loop
    text = await asyncio.to_thread(_text, collector)
    return Response(text, media_type=CONTENT_TYPE_PLAIN_1_0_0)


def _text(collector: FleetCollector) -> bytes:
    registry = CollectorRegistry(auto_describe=False)
    registry.register(collector)
    return generate_latest(registry)
