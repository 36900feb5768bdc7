"""Converts between the service's types and the API's schemas, in both directions."""

from dataclasses import asdict, replace
from math import degrees, hypot, isfinite, pi, radians
from typing import Final

import numpy as np

from gcs.api.schemas import alarms_from_service as convert_alarms
from gcs.api.schemas import recovery as recovery_schemas
from gcs.api.schemas import rest as schemas
from gcs.api.schemas import shows as show_schemas
from gcs.model import plan
from gcs.model.errors import InvalidError, RefusedError
from gcs.model.frames import ShowFrame
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import AIRBORNE, Counts, ShowEvent, ShowPhase, advance_show
from gcs.service import (
    CommandRecord,
    FleetView,
    SelectedShow,
    ShowAction,
    ShowCheck,
    StoredShow,
)
from gcs.service.vehicle_table import VehicleView

Triple = tuple[float, float, float]

ALWAYS_IN_THE_AIR: Final = frozenset({ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT})
"""Commands that are accepted whenever a vehicle is airborne."""

VIEW_AGE_MAX_S: Final = 1.0
"""Oldest valid state: PX4 leaves OFFBOARD after 1.0 s without setpoints (COM_OF_LOSS_T)."""


def health_problem(view: FleetView, now_s: float) -> str:
    """Why control is not alive at `now_s` (loop clock); empty when it is.

    A replay has no control loop that could stop; its only problem is an old state.
    """
    age_s = now_s - view.time_s
    replays = view.playback is not None
    if not abs(age_s) <= VIEW_AGE_MAX_S:  # NaN is unhealthy as well
        stands = "the replay does not go on" if replays else "the control loop does not run"
        return f"the newest state is {age_s:.1f} s old: {stands}"
    if not (view.control_alive or replays):
        return "the control loop has completed no tick within the deadman's time: no setpoints are sent"
    return ""


def readiness_problem(view: FleetView, now_s: float) -> str:
    """Why no vehicle can be commanded at `now_s`; empty when at least one can."""
    problem = health_problem(view, now_s)
    if problem:
        return problem
    if not any(each.ready or each.phase in AIRBORNE for each in view.vehicles):
        count, first = len(view.vehicles), view.vehicles[0]
        return f"no vehicle of {count} is ready or flies; {first.id} is {first.phase}: {first.reason}"
    return ""


def readiness(view: FleetView) -> schemas.Readiness:
    """Numbers of vehicles that are ready and airborne."""
    return schemas.Readiness(
        ready=True,
        vehicles_ready=sum(each.ready for each in view.vehicles),
        vehicles_airborne=view.counts.airborne,
        vehicles=len(view.vehicles),
    )


def _above(down_m: float) -> float:
    return 0.0 - down_m  # not -down_m: that makes -0.0


def _velocity(vector_m_s: Triple | None) -> schemas.VelocityOut | None:
    if vector_m_s is None:
        return None
    return schemas.VelocityOut(x_m_s=vector_m_s[0], y_m_s=vector_m_s[1], up_m_s=_above(vector_m_s[2]))


def heading_deg(yaw_rad: float, frame: ShowFrame) -> float:
    """Convert a yaw in the show frame to degrees clockwise from north, in [0, 360)."""
    heading = (degrees(yaw_rad) + frame.heading_deg) % 360.0
    return 0.0 if heading == 360.0 else heading  # a tiny negative angle rounds up to 360


def yaw_rad(heading: float, frame: ShowFrame) -> float:
    """Convert degrees clockwise from north to a yaw in the show frame, in [-pi, pi)."""
    return (radians(heading - frame.heading_deg) + pi) % (2 * pi) - pi


def vehicle(
    view: VehicleView, frame: ShowFrame, low_s: float | None = None, empty_s: float | None = None
) -> schemas.Vehicle:
    """Convert one vehicle; `low_s` and `empty_s`: how long its battery lasts, None when not known."""
    x_m, y_m, down_m = view.position_m if view.position_m is not None else (None, None, None)
    return schemas.Vehicle(
        id=view.id,
        system_id=view.system_id,
        link=view.link,
        phase=view.phase,
        reason=view.reason,
        mode=view.mode,
        armed=view.armed,
        landed=view.landed.name.lower(),
        ready=view.ready,
        position=schemas.Position(
            x_m=x_m,
            y_m=y_m,
            height_m=None if down_m is None else _above(down_m),
            latitude_deg=view.latitude_deg,
            longitude_deg=view.longitude_deg,
            altitude_amsl_m=view.altitude_amsl_m,
        ),
        velocity=_velocity(view.velocity_m_s),
        heading_deg=None if view.yaw_rad is None else heading_deg(view.yaw_rad, frame),
        battery_remaining=view.battery_remaining,
        position_age_s=view.position_age_s,
        position_uncertainty_m=view.position_uncertainty_m,
        heartbeat_age_s=view.heartbeat_age_s,
        setpoint=_velocity(view.setpoint_m_s),
        link_quality=view.link_quality,
        limited_by=view.limited_by,
        low_s=low_s,
        empty_s=empty_s,
        light=view.light,
    )


def estimates(view: FleetView) -> schemas.Estimates | None:
    found, ids = view.estimates, view.rows.ids
    if found is None:
        return None
    return schemas.Estimates(
        battery_least=found.battery_least,
        battery_least_vehicle=None if found.battery_least_row is None else ids[found.battery_least_row],
        battery_median=found.battery_median,
        low_s=None if found.low_row is None else float(found.low_s[found.low_row]),
        low_vehicle=None if found.low_row is None else ids[found.low_row],
        empty_s=min(filter(isfinite, found.empty_s.tolist()), default=None),
        assembled_s=found.assembled_s,
        home_s=found.home_s,
    )


def vehicles(view: FleetView, frame: ShowFrame) -> list[schemas.Vehicle]:
    found = view.estimates
    if found is None:
        return [vehicle(each, frame) for each in view.vehicles]
    columns = [
        [left_s if isfinite(left_s) else None for left_s in column.tolist()]
        for column in (found.low_s, found.empty_s)
    ]
    return [vehicle(each, frame, *left_s) for each, *left_s in zip(view.vehicles, *columns, strict=True)]


def _possible(phase: ShowPhase, action: ShowAction) -> bool:
    try:
        advance_show(phase, ShowEvent(action.value))
    except RefusedError:
        return False
    return True


def show(view: FleetView) -> schemas.Show:
    flies = view.counts.airborne > 0
    possible = [
        action
        for action in ShowAction
        if _possible(view.show, action) or (flies and action in ALWAYS_IN_THE_AIR)
    ]
    return schemas.Show(
        phase=view.show,
        reason=view.reason,
        possible=possible,
        selected=None if view.selected is None else selected_show(view.selected),
        start_unix_time_s=view.start_unix_time_s,
        countdown_s=view.countdown_s,
    )


def counts(reported: Counts) -> schemas.Counts:
    return schemas.Counts(airborne=reported.airborne, **asdict(reported))


def selected_show(selected: SelectedShow) -> schemas.SelectedShow:
    return schemas.SelectedShow(**asdict(selected))


def stored_show(stored: StoredShow) -> show_schemas.StoredShow:
    return show_schemas.StoredShow(**asdict(stored))


def show_check(check: ShowCheck) -> show_schemas.ShowCheck:
    return show_schemas.ShowCheck(**asdict(check))


def command(record: CommandRecord) -> schemas.Command:
    return schemas.Command(
        id=record.id,
        action=record.action,
        by=record.by,
        accepted_unix_time_s=record.accepted_time_s,
        outcome=record.outcome,
        vehicles={
            vehicle_id: schemas.CommandPart(outcome=part.outcome, reason=part.reason)
            for vehicle_id, part in record.outcomes.items()
        },
    )


def formation(desired: plan.Formation, view: FleetView) -> schemas.Formation:
    """Convert the desired formation, with the radius and height commanded now."""
    return schemas.Formation(
        radius_m=desired.radius_m,
        height_m=desired.height_m,
        radius_now_m=view.radius_m,
        height_now_m=None if view.center_m is None else _above(view.center_m[2]),
    )


def center(view: FleetView, frame: ShowFrame) -> schemas.Center | None:
    """Convert the formation's centre; None while no formation flies."""
    if view.center_m is None:
        return None
    latitude_deg, longitude_deg, altitude_amsl_m = frame.geodetic(np.array([view.center_m]))
    return schemas.Center(
        position=schemas.Position(
            x_m=view.center_m[0],
            y_m=view.center_m[1],
            height_m=_above(view.center_m[2]),
            latitude_deg=float(latitude_deg[0]),
            longitude_deg=float(longitude_deg[0]),
            altitude_amsl_m=float(altitude_amsl_m[0]),
        ),
        velocity=_velocity(view.center_velocity_m_s),
    )


def target(desired: plan.Target, position_m: tuple[float, float], frame: ShowFrame) -> schemas.Target:
    """Convert the target into both frames; `position_m` is its position now, show frame."""
    latitude_deg, longitude_deg, _ = frame.geodetic(np.array([[*position_m, 0.0]]))
    ned_m_s = frame.into_ned(np.array([[desired.velocity_x_m_s, desired.velocity_y_m_s, 0.0]]))
    return schemas.Target(
        x_m=position_m[0],
        y_m=position_m[1],
        velocity_x_m_s=desired.velocity_x_m_s,
        velocity_y_m_s=desired.velocity_y_m_s,
        latitude_deg=float(latitude_deg[0]),
        longitude_deg=float(longitude_deg[0]),
        velocity_north_m_s=float(ned_m_s[0, 0]),
        velocity_east_m_s=float(ned_m_s[0, 1]),
    )


def orbit(desired: plan.Orbit) -> schemas.Orbit:
    return schemas.Orbit(radius_m=desired.radius_m, speed_m_s=desired.speed_m_s, direction=desired.direction)


def yaw(desired: plan.Yaw, frame: ShowFrame) -> schemas.Yaw:
    return schemas.Yaw(policy=desired.policy, heading_deg=heading_deg(desired.fixed_rad, frame))


def obstacle(box: plan.Obstacle, now_s: float) -> schemas.Obstacle:
    """Convert an obstacle, at its position at `now_s`."""
    x_m, y_m = box.position_m(now_s)
    return schemas.Obstacle(
        id=box.id,
        x_m=x_m,
        y_m=y_m,
        half_length_x_m=box.half_length_x_m,
        half_length_y_m=box.half_length_y_m,
        height_m=box.height_m,
        velocity_x_m_s=box.velocity_x_m_s,
        velocity_y_m_s=box.velocity_y_m_s,
    )


def origin(frame: ShowFrame) -> schemas.Origin:
    """Convert origin and heading of the show frame."""
    return schemas.Origin(
        latitude_deg=frame.latitude_deg,
        longitude_deg=frame.longitude_deg,
        altitude_amsl_m=frame.altitude_amsl_m,
        heading_deg=frame.heading_deg,
    )


def fleet(view: FleetView, frame: ShowFrame, problem: str, access: str) -> schemas.Fleet:
    """Convert the whole state; `problem` is the result of `health_problem`, `access` `Authorization.text`."""
    return schemas.Fleet(
        time_s=view.time_s,
        unix_time_s=view.unix_time_s,
        control_alive=not problem,
        control_reason=problem,
        show=show(view),
        counts=counts(view.counts),
        origin=origin(frame),
        formation=formation(view.plan.formation, view),
        center=center(view, frame),
        target=target(view.plan.target, view.target_m, frame),
        orbit=orbit(view.plan.orbit),
        yaw=yaw(view.plan.yaw, frame),
        obstacles=[obstacle(box, view.time_s) for box in view.plan.obstacles],
        minimum_separation_m=view.minimum_separation_m,
        setpoints_sent=view.setpoints_sent,
        filter_interventions=view.interventions,
        interrupted=None if view.interrupted is None else interrupted(view.interrupted),
        severity=convert_alarms.severity(view, problem),
        alarms=convert_alarms.alarms(view, problem),
        estimates=estimates(view),
        access=access,
        tick=schemas.Tick(
            rate_hz=view.tick.rate_hz,
            count=view.tick.count,
            missed=view.tick.missed,
            duration_p50_ms=view.tick.duration_p50_ms,
            duration_p99_ms=view.tick.duration_p99_ms,
            lateness_p99_ms=view.tick.lateness_p99_ms,
        ),
        vehicles=vehicles(view, frame),
    )


def interrupted(found: InterruptedFlight) -> recovery_schemas.InterruptedFlight:
    """Convert an interrupted flight."""
    selected = None
    if found.written is not None:
        selected = recovery_schemas.WrittenShow(**asdict(found.written))
    return recovery_schemas.InterruptedFlight(
        session=found.session,
        unix_time_s=found.unix_time_s,
        cause=found.cause,
        show=found.show,
        selected=selected,
        vehicles={one.id: recovery_schemas.Remaining(**asdict(one)) for one in found.vehicles},
        offers=list(found.offers),
        problems=list(found.problems),
    )


def target_desired(
    body: schemas.ShowTarget | schemas.GeodeticTarget, frame: ShowFrame, now_s: float
) -> plan.Target:
    """Convert a requested target into the show frame, at `now_s`.

    Raises: InvalidError when a geodetic position is too far away for a flat frame.
    """
    if isinstance(body, schemas.ShowTarget):
        return plan.Target(**body.model_dump(), time_s=now_s)
    place_m = frame.position_m(
        np.array([body.latitude_deg]),
        np.array([body.longitude_deg]),
        np.array([frame.altitude_amsl_m]),
    )
    velocity_m_s = frame.from_ned(np.array([[body.velocity_north_m_s, body.velocity_east_m_s, 0.0]]))
    x_m, y_m = float(place_m[0, 0]), float(place_m[0, 1])
    # z is included: the opposite side of the globe is straight below the origin.
    if not hypot(x_m, y_m, float(place_m[0, 2])) <= schemas.LENGTH_MAX_M:
        allowed = f"within {schemas.LENGTH_MAX_M / 1000:.0f} km of the show's origin"
        raise InvalidError(
            "latitude_deg, longitude_deg", f"{body.latitude_deg}, {body.longitude_deg}", allowed
        )
    return plan.Target(x_m, y_m, float(velocity_m_s[0, 0]), float(velocity_m_s[0, 1]), now_s)


def yaw_desired(body: schemas.YawChange, current: plan.Yaw, frame: ShowFrame) -> plan.Yaw:
    """Return the yaw after a requested change."""
    given = body.given()
    fixed_rad = yaw_rad(given["heading_deg"], frame) if "heading_deg" in given else current.fixed_rad
    return replace(current, policy=given.get("policy", current.policy), fixed_rad=fixed_rad)


def obstacle_desired(body: schemas.Box, obstacle_id: str, now_s: float) -> plan.Obstacle:
    """Convert a requested box, at its position at `now_s`."""
    return plan.Obstacle(id=obstacle_id, **body.model_dump(exclude={"id"}), time_s=now_s)


def fleet_json(view: FleetView, frame: ShowFrame, problem: str, access: str) -> str:
    """The whole state as JSON text."""
    return fleet(view, frame, problem, access).model_dump_json()
