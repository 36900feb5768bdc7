"""Metrics for Prometheus at `/metrics`, computed from the newest state at each request; no state is kept."""

import asyncio
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from math import isfinite

from fastapi import APIRouter
from prometheus_client import CollectorRegistry
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_1_0_0, generate_latest
from starlette.responses import Response

from gcs.api.context import ContextDep
from gcs.api.openapi import TOKEN
from gcs.api.schemas.convert import current_alarms as current
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.vehicle_columns import COLUMNS
from gcs.service import FleetView, StationView
from gcs.service.alarms import AlarmCause, AlarmSeverity, OverallSeverity, overall

router = APIRouter()


@dataclass(frozen=True, slots=True, eq=False)
class FleetCollector:
    """Makes all metrics of one state."""

    view: FleetView
    problem: str  # why control is not alive; empty when it is
    age_s: float
    access: str
    denied: int
    shed: int

    def collect(self) -> Iterator[Metric]:
        view, tick = self.view, self.view.tick
        yield _gauge("gcs_control_alive", "1 while ticks come.", float(not self.problem))
        yield _gauge("gcs_state_age_seconds", "Since the newest state was made.", self.age_s)
        yield CounterMetricFamily("gcs_ticks", "Ticks of the control loop.", tick.count)
        yield CounterMetricFamily("gcs_ticks_missed", "Ticks that were dropped, being too late.", tick.missed)
        for histogram in view.histograms:
            yield from histogram.collect()
        yield CounterMetricFamily("gcs_setpoints_sent", "Velocity setpoints that left.", view.setpoints_sent)
        yield CounterMetricFamily(
            "gcs_filter_interventions", "Vehicle-ticks that safety changed.", view.interventions
        )
        text = "Samples that were dropped, being older than the newest of their kind."
        yield CounterMetricFamily("gcs_late_samples", text, view.late_samples)
        yield _gauge(
            "gcs_minimum_separation_meters",
            "Between the nearest two that count, as believed; absent when there are none.",
            view.minimum_separation_m,
        )
        phases = _one_of({view.show}, ShowPhase)
        yield _labelled("gcs_show_phase", "1 for the phase that the show is in.", "phase", phases)
        yield from _alarms(view, self.problem)
        yield CounterMetricFamily("gcs_calls_denied", "Calls that were denied.", self.denied)
        yield CounterMetricFamily("gcs_calls_shed", "Denied calls that exceeded the rate.", self.shed)
        yield InfoMetricFamily("gcs_access", "Whether the service demands tokens.", {"access": self.access})
        yield from _features(view)
        yield from _stations(view)
        yield from _vehicles(view)


def _features(view: FleetView) -> Iterator[Metric]:
    """Yield nothing of a feature that is not configured."""
    for feature in view.features.reporting.values():
        for about, key, value, words in feature.metrics:
            name, text = about.metric, about.text
            if words:
                yield _labelled(name, text, key, {word: float(word == value) for word in words})
            elif isinstance(value, str):
                yield InfoMetricFamily(name, text, {key: value})
            elif isinstance(value, int):
                yield CounterMetricFamily(name, text, value)
            else:
                yield _gauge(name, text, value)


def _stations(view: FleetView) -> Iterator[Metric]:
    """Yield nothing where one station flies all vehicles."""
    columns: dict[str, tuple[str, Callable[[StationView], float | None]]] = {
        "gcs_station_received": ("1 while its messages arrive.", lambda each: each.received),
        "gcs_station_leads": ("1 for the station that leads.", lambda each: each.leads),
        "gcs_station_vehicles": ("Vehicles that it flies.", lambda each: each.vehicles),
        "gcs_station_delay_seconds": ("One way, over the bus.", lambda each: each.delay_s),
        "gcs_station_silent_seconds": ("Since its newest message arrived.", lambda each: each.silent_s),
    }
    for name, (text, value) in columns.items() if view.stations else ():
        values = {each.name: value(each) for each in view.stations}
        known = {key: float(each) for key, each in values.items() if each is not None and isfinite(each)}
        yield _labelled(name, text, "station", known)
    if (bus := view.bus) is None:
        return
    yield CounterMetricFamily("gcs_bus_messages_sent", "Messages to the other stations.", bus.sent)
    yield CounterMetricFamily("gcs_bus_sent_bytes", "Bytes of these, each counted once.", bus.sent_bytes)
    yield CounterMetricFamily("gcs_bus_messages_received", "Messages of the other stations.", bus.received)
    yield CounterMetricFamily("gcs_bus_messages_refused", "Messages that are no valid ones.", bus.refused)


def _vehicles(view: FleetView) -> Iterator[Metric]:
    rows = view.rows
    for name, column in COLUMNS.items():
        if column.metric:
            values = zip(rows.ids, getattr(rows, name).tolist(), strict=True)
            known = {key: value for key, value in values if isfinite(value)}
            yield _labelled(column.metric, f"{column.meaning}.", "vehicle", known)
    ready = dict(zip(rows.ids, map(float, rows.ready), strict=True))
    yield _labelled("gcs_vehicle_ready", "1: could be started now.", "vehicle", ready)
    limited = {key: float(why != "") for key, why in zip(rows.ids, rows.limited_by, strict=True)}
    text = "1: the safety filter held it back in the newest tick."
    yield _labelled("gcs_vehicle_limited", text, "vehicle", limited)
    counts = {"airborne": view.counts.airborne, **asdict(view.counts)}
    yield _labelled(
        "gcs_vehicles_counted", "How many are airborne, on the ground and so on.", "where", counts
    )
    phases = Counter(rows.phases)
    counted = {phase.value: phases[phase] for phase in Phase}
    yield _labelled("gcs_vehicles", "How many are in each phase.", "phase", counted)


def _gauge(name: str, text: str, value: float | None) -> Metric:
    family = GaugeMetricFamily(name, text)
    if value is not None:
        family.add_metric([], value)
    return family


def _labelled(name: str, text: str, label: str, values: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], value)
    return family


def _one_of(now: Collection[StrEnum], kinds: type[StrEnum]) -> dict[str, float]:
    return {kind.value: float(kind in now) for kind in kinds}


def _alarms(view: FleetView, problem: str) -> Iterator[Metric]:
    alarms = current(view, problem)
    lasting = [alarm for alarm in alarms if alarm.lasts]
    severities, causes = Counter(alarm.severity for alarm in lasting), {alarm.cause for alarm in lasting}
    counts = {severity.value: severities[severity] for severity in AlarmSeverity}
    yield _labelled("formation_alarms", "Alarms that last, by severity.", "severity", counts)
    text = "1 while an alarm of this cause lasts."
    yield _labelled("formation_alarm", text, "cause", _one_of(causes, AlarmCause))
    text = "1 for the state of the whole: the worst severity that lasts."
    yield _labelled("formation_state", text, "severity", _one_of({overall(lasting)}, OverallSeverity))
    is_open = sum(alarm.acknowledged_by is None for alarm in alarms)
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
    registry = CollectorRegistry(auto_describe=False)
    registry.register(collector)
    # in a thread: a thousand vehicles need thousands of lines, which would delay ticks on the event loop
    text = await asyncio.to_thread(generate_latest, registry)
    return Response(text, media_type=CONTENT_TYPE_PLAIN_1_0_0)
