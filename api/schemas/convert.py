"""Converts between the service's types and the API's schemas, in both directions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import degrees, hypot, isfinite, pi, radians
from typing import Any, Final, TypeVar

import numpy as np
from pydantic import BaseModel

from gcs.api.schemas import fleet as schemas
from gcs.api.schemas import requests
from gcs.api.schemas.binary_frame import FLOATS, fill_floats
from gcs.model import plan
from gcs.model.errors import InvalidError
from gcs.model.frames import ShowFrame
from gcs.model.lifecycle import AIRBORNE, SHOW_NEXT, ShowEvent
from gcs.model.state import Array
from gcs.model.vehicle_columns import COLUMNS, REST_ONLY
from gcs.service import FleetView, ShowAction
from gcs.service.alarms import CAUSES, Alarm, AlarmCause, overall
from gcs.service.vehicle_table import VehicleTable

M = TypeVar("M", bound=BaseModel)

ALWAYS_IN_THE_AIR: Final = frozenset({ShowAction.PAUSE, ShowAction.STOP, ShowAction.ABORT})
"""Commands that are accepted whenever a vehicle is airborne."""

VIEW_AGE_MAX_S: Final = 1.0
"""Oldest valid state: PX4 leaves OFFBOARD after 1.0 s without setpoints (COM_OF_LOSS_T)."""


# Health


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
        return "the control loop has completed no tick in time: no setpoints are sent"
    return ""


def readiness_problem(view: FleetView, now_s: float) -> str:
    """Why no vehicle can be commanded at `now_s`; empty when at least one can."""
    problem = health_problem(view, now_s)
    if problem:
        return problem
    rows = view.rows
    if not (any(rows.ready) or AIRBORNE.intersection(rows.phases)):
        first = f"{rows.ids[0]} is {rows.phases[0]}: {rows.reasons[0]}"
        return f"no vehicle of {len(rows.ids)} is ready or flies; {first}"
    return ""


# Alarms


def current_alarms(view: FleetView, problem: str) -> tuple[Alarm, ...]:
    """Return the alarms of a state, first the alarm that control has stopped, which a state cannot contain.

    `problem` is the result of `health_problem`. A replay has no control that could stop.
    """
    if not problem or view.playback is not None:
        return view.alarms
    cause = AlarmCause.CONTROL_STOPPED
    row = CAUSES[cause]
    text = f"{row.headline}: {problem}."
    times = (view.unix_time_s, view.unix_time_s)
    return (Alarm(cause.value, row.severity, cause, text, row.advice, (), *times), *view.alarms)


# Vehicles


def records(rows: VehicleTable) -> list[schemas.VehicleRecord]:
    return _models(schemas.VehicleRecord, _record_columns(rows))


def vehicles(view: FleetView, frame: ShowFrame) -> list[schemas.Vehicle]:
    """Each vehicle, with the numbers of a frame in double precision."""
    rows = view.rows
    floats = np.empty((len(FLOATS), len(rows.ids)))
    fill_floats(floats, rows, frame, view.estimates)
    columns: dict[str, Sequence[object]] = {
        **_record_columns(rows),
        **dict(zip(FLOATS, floats.tolist(), strict=True)),
        "phase": rows.phases,
        "mode": rows.modes,
        "armed": rows.armed,
        "landed": [landed.name.lower() for landed in rows.landed],
        "ready": rows.ready,
        **{COLUMNS[name].api: getattr(rows, name).tolist() for name in REST_ONLY},
        "colour": rows.colours(),
    }
    return _models(schemas.Vehicle, columns)


def fixes(rows: VehicleTable) -> list[int | None]:
    """GPS_FIX_TYPE of each vehicle; None: not known."""
    return [int(fix) if isfinite(fix) else None for fix in rows.fix_type.tolist()]


def stations_of(rows: VehicleTable) -> list[str | None]:
    """The station that flies each vehicle; None: one station flies all, or no station is known to."""
    return [name or None for name in rows.stations] or [None] * len(rows.ids)


def _record_columns(rows: VehicleTable) -> dict[str, Sequence[object]]:
    return {
        "id": rows.ids,
        "system_id": rows.system_ids,
        "link": rows.links,
        "autopilot": rows.autopilots,
        "station": stations_of(rows),
        "reason": rows.reasons,
        "limited_by": rows.limited_by,
        "home": [_home(place_m) for place_m in rows.homes_m],
        "fix_type": fixes(rows),
    }


def _models(model: type[M], columns: Mapping[str, Sequence[object]]) -> list[M]:
    return [
        model.model_validate(dict(zip(columns, row, strict=True)))
        for row in zip(*columns.values(), strict=True)
    ]


def _home(place_m: Array | None) -> schemas.Home | None:
    if place_m is None:
        return None
    x_m, y_m, z_m = place_m.tolist()
    return schemas.Home(x_m=x_m, y_m=y_m, height_m=_above(z_m))


def _above(down_m: float) -> float:
    return 0.0 - down_m  # not -down_m: that makes -0.0


def heading_deg(yaw_rad: float, frame: ShowFrame) -> float:
    """Convert a yaw in the show frame to degrees clockwise from north, in [0, 360)."""
    heading = (degrees(yaw_rad) + frame.heading_deg) % 360.0
    return 0.0 if heading == 360.0 else heading  # a tiny negative angle rounds up to 360


def yaw_rad(heading: float, frame: ShowFrame) -> float:
    """Convert degrees clockwise from north to a yaw in the show frame, in [-pi, pi)."""
    return (radians(heading - frame.heading_deg) + pi) % (2 * pi) - pi


# The whole state


def fleet(view: FleetView, frame: ShowFrame, problem: str, access: str) -> schemas.Fleet:
    """Convert the whole state; `problem` is the result of `health_problem`, `access` `Authorization.text`."""
    return schemas.Fleet(
        **summary(view, frame, problem, access),
        control_alive=not problem,
        center=center(view, frame),
        minimum_separation_m=view.minimum_separation_m,
        setpoints_sent=view.setpoints_sent,
        filter_interventions=view.interventions,
        tick=view.tick,
        vehicles=vehicles(view, frame),
    )


def summary(view: FleetView, frame: ShowFrame, problem: str, access: str) -> dict[str, Any]:
    """Fields of `FleetSummary`; `problem` and `access` as of `fleet`."""
    desired, alarms = view.plan, current_alarms(view, problem)
    return {
        "time_s": view.time_s,
        "unix_time_s": view.unix_time_s,
        "control_reason": problem,
        "show": show(view, problem),
        "stations": list(view.stations),
        "counts": view.counts,
        "origin": frame,
        "formation": formation(desired.formation, view),
        "target": target(desired.target, view.target_m, frame),
        "orbit": desired.orbit,
        "yaw": yaw(desired.yaw, frame),
        "obstacles": [obstacle(box, view.time_s) for box in desired.obstacles],
        "interrupted": view.interrupted,
        "severity": overall(alarms),
        "alarms": list(alarms),
        "estimates": estimates(view),
        "features": view.features,
        "access": access,
    }


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


def start_refused(view: FleetView, problem: str) -> str:
    """Why a start would be refused now, in short; empty: it would not. `problem` as of `fleet`."""
    if view.playback is not None:
        return "a replay flies nothing"
    return f"control is not alive: {problem}" if problem else view.start_refused


def show(view: FleetView, problem: str) -> schemas.Show:
    flies, refused = view.counts.airborne > 0, start_refused(view, problem)
    possible = [
        action
        for action in ShowAction
        if (view.show, ShowEvent(action.value)) in SHOW_NEXT or (flies and action in ALWAYS_IN_THE_AIR)
    ]
    if view.playback is not None:
        possible = []
    if refused and ShowAction.START in possible:
        possible.remove(ShowAction.START)
    return schemas.Show(
        phase=view.show,
        reason=view.reason,
        possible=possible,
        start_refused=refused,
        selected=view.selected,
        start_unix_time_s=view.start_unix_time_s,
        countdown_s=view.countdown_s,
    )


def formation(desired: plan.Formation, view: FleetView) -> schemas.Formation:
    return schemas.Formation(
        radius_m=desired.radius_m,
        height_m=desired.height_m,
        law=desired.law,
        radius_now_m=view.radius_m,
        height_now_m=None if view.center_m is None else _above(view.center_m[2]),
    )


def center(view: FleetView, frame: ShowFrame) -> schemas.Center | None:
    if view.center_m is None:
        return None
    x_m, y_m, z_m = view.center_m
    vx_m_s, vy_m_s, vz_m_s = view.center_velocity_m_s or (None, None, None)
    latitude_deg, longitude_deg, altitude_amsl_m = (
        float(column[0]) for column in frame.geodetic(np.array([view.center_m]))
    )
    return schemas.Center(
        x_m=x_m,
        y_m=y_m,
        height_m=_above(z_m),
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
        altitude_amsl_m=altitude_amsl_m,
        vx_m_s=vx_m_s,
        vy_m_s=vy_m_s,
        vup_m_s=None if vz_m_s is None else _above(vz_m_s),
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
        height_m=desired.height_m,
        clearance_m=desired.clearance_m,
    )


def yaw(desired: plan.Yaw, frame: ShowFrame) -> schemas.Yaw:
    return schemas.Yaw(policy=desired.policy, heading_deg=heading_deg(desired.fixed_rad, frame))


def obstacle(box: plan.Obstacle, now_s: float) -> plan.Obstacle:
    """Return an obstacle at its position at `now_s`."""
    x_m, y_m = box.position_m(now_s)
    return replace(box, x_m=x_m, y_m=y_m, time_s=now_s)


# Requests


def target_desired(
    body: requests.ShowTarget | requests.GeodeticTarget, frame: ShowFrame, now_s: float
) -> plan.Target:
    """Convert a requested target into the show frame, at `now_s`.

    Raises: InvalidError when a geodetic position is too far away for a flat frame.
    """
    if isinstance(body, requests.ShowTarget):
        return plan.Target(**body.model_dump(), time_s=now_s)
    place_m = frame.position_m(
        np.array([body.latitude_deg]), np.array([body.longitude_deg]), np.array([frame.altitude_amsl_m])
    )
    velocity_m_s = frame.from_ned(np.array([[body.velocity_north_m_s, body.velocity_east_m_s, 0.0]]))
    x_m, y_m = float(place_m[0, 0]), float(place_m[0, 1])
    # z is included: the opposite side of the globe is straight below the origin.
    if not hypot(x_m, y_m, float(place_m[0, 2])) <= requests.LENGTH_MAX_M:
        allowed = f"within {requests.LENGTH_MAX_M / 1000:.0f} km of the show's origin"
        raise InvalidError(
            "latitude_deg, longitude_deg", f"{body.latitude_deg}, {body.longitude_deg}", allowed
        )
    x_m_s, y_m_s, _ = velocity_m_s[0].tolist()
    return plan.Target(x_m, y_m, x_m_s, y_m_s, now_s, height_m=body.height_m, clearance_m=body.clearance_m)


def yaw_desired(body: requests.YawChange, current: plan.Yaw, frame: ShowFrame) -> plan.Yaw:
    given = body.given()
    fixed_rad = yaw_rad(given["heading_deg"], frame) if "heading_deg" in given else current.fixed_rad
    return replace(current, policy=given.get("policy", current.policy), fixed_rad=fixed_rad)


def obstacle_desired(body: requests.Box, obstacle_id: str, now_s: float) -> plan.Obstacle:
    """Convert a requested box, at its position at `now_s`."""
    return plan.Obstacle(id=obstacle_id, **body.model_dump(exclude={"id"}), time_s=now_s)
