"""Converts the status (data that changes seldom) from the service's types to the API's schemas."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gcs.api.map_tiles import GroundMap
from gcs.api.schemas import alarms_from_service as convert_alarms
from gcs.api.schemas import from_service as convert
from gcs.api.schemas import replay as replay_schemas
from gcs.api.schemas import stream as stream_schemas
from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.service import FleetView, FlightEnvelope, Playback, ReplayMarks, ReportState
from gcs.service.event_log import LogEvent
from gcs.service.vehicle_table import VehicleTable


def status(
    view: FleetView,
    frame: ShowFrame,
    events: Sequence[LogEvent],
    began_unix_s: float,
    revision: int,
    problem: str,
    access: str,
    ground: GroundMap | None,
    shows_refused: str,
) -> stream_schemas.Status:
    """Make the status message.

    `problem` is the result of `health_problem`, `access` is `Authorization.text`, and `shows_refused` is
    `why_not_kept` of the shows.
    """
    plan, selected = view.plan, view.selected
    return stream_schemas.Status(
        revision=revision,
        time_s=view.time_s,
        unix_time_s=view.unix_time_s,
        began_unix_time_s=began_unix_s,
        control_reason=problem,
        show=convert.show(view),
        counts=convert.counts(view.counts),
        timeline=[
            stream_schemas.CueTime(cue=cue, at_s=at_s)
            for cue, at_s in (() if selected is None else selected.timeline)
        ],
        shows_refused=shows_refused,
        origin=convert.origin(frame),
        map=None if ground is None else _map(ground),
        formation=convert.formation(plan.formation, view),
        target=convert.target(plan.target, view.target_m, frame),
        orbit=convert.orbit(plan.orbit),
        yaw=convert.yaw(plan.yaw, frame),
        obstacles=[convert.obstacle(box, view.time_s) for box in plan.obstacles],
        fence=_fence(view.flight_envelope),
        separation=_separation(view.flight_envelope),
        interrupted=None if view.interrupted is None else convert.interrupted(view.interrupted),
        severity=convert_alarms.severity(view, problem),
        alarms=convert_alarms.alarms(view, problem),
        estimates=convert.estimates(view),
        access=access,
        limits=sorted(set(view.rows.limited_by) - {""}),
        replay=None if view.playback is None else replay(view.playback),
        events=[_event(each) for each in events],
        vehicles=_vehicles(view.rows),
    )


def replay(playback: Playback) -> replay_schemas.Replay:
    return replay_schemas.Replay(
        file=playback.file,
        began_unix_time_s=playback.began_unix_s,
        duration_s=playback.duration_s,
        position_s=playback.position_s,
        speed=playback.speed,
        paused=playback.paused,
        ended=playback.ended,
        skips_idle=playback.skips_idle,
    )


def replay_marks(marks: ReplayMarks) -> replay_schemas.ReplayMarks:
    return replay_schemas.ReplayMarks(
        phases=[replay_schemas.PhaseSpan(**asdict(span)) for span in marks.phases],
        cues=[replay_schemas.CueMark(**asdict(mark)) for mark in marks.cues],
        events=[replay_schemas.EventMark(**asdict(mark)) for mark in marks.events],
        idle=[replay_schemas.IdleSpan(**asdict(span)) for span in marks.idle],
    )


def flight_report(found: ReportState) -> replay_schemas.FlightReport:
    return replay_schemas.FlightReport(state=found.state, reason=found.reason, report=_report(found.report))


def _report(reported: dict[str, Any] | None) -> replay_schemas.ReportBody | None:
    return None if reported is None else replay_schemas.ReportBody.model_validate(reported)


def fixes(rows: VehicleTable) -> list[int | None]:
    """GPS_FIX_TYPE of each vehicle; None: not known."""
    known = np.isfinite(rows.fix_type).tolist()
    numbers = np.nan_to_num(rows.fix_type).astype(np.int64).tolist()
    return [fix if is_known else None for fix, is_known in zip(numbers, known, strict=True)]


def _vehicles(rows: VehicleTable) -> list[stream_schemas.StatusVehicle]:
    return [
        stream_schemas.StatusVehicle(
            id=name,
            system_id=rows.system_ids[row],
            link=rows.links[row],
            reason=rows.reasons[row],
            limited_by=rows.limited_by[row],
            home=_home(rows.homes_m[row]),
            fix_type=fix,
        )
        for row, (name, fix) in enumerate(zip(rows.ids, fixes(rows), strict=True))
    ]


def _home(place_m: Array | None) -> stream_schemas.Home | None:
    if place_m is None:
        return None
    x_m, y_m, z_m = place_m.tolist()
    return stream_schemas.Home(x_m=x_m, y_m=y_m, height_m=0.0 - z_m)


def _map(ground: GroundMap) -> stream_schemas.Map:
    return stream_schemas.Map(
        tiles=ground.tiles,
        attribution=ground.attribution,
        zoom_min=ground.zoom_min,
        zoom_max=ground.zoom_max,
    )


def _fence(flight_envelope: FlightEnvelope) -> stream_schemas.Fence:
    return stream_schemas.Fence(
        height_min_m=flight_envelope.height_min_m,
        height_max_m=flight_envelope.height_max_m,
        distance_max_m=flight_envelope.distance_max_m,
    )


def _separation(flight_envelope: FlightEnvelope) -> stream_schemas.Separation:
    return stream_schemas.Separation(
        horizontal_m=flight_envelope.floor_horizontal_m,
        vertical_m=flight_envelope.floor_vertical_m,
        margin_m=flight_envelope.margin_m,
    )


def _event(each: LogEvent) -> stream_schemas.LogEvent:
    return stream_schemas.LogEvent(
        number=each.number,
        unix_time_s=each.unix_time_s,
        severity=each.severity,
        text=each.text,
        vehicle=each.vehicle,
    )
