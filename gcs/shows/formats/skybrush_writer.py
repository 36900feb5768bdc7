"""Writes `.skyc`: show.json, and for each drone a trajectory of Bezier curves; axes as the reader's."""

import io
import json
import zipfile
from typing import Any, Final

import numpy as np

from gcs.model.frames import ShowFrame
from gcs.model.state import Array
from gcs.shows.drawn import Claims, DrawnShow, Trajectory
from gcs.shows.drawn.trajectories import bezier_of_power
from gcs.shows.drawn.yaw_programs import YawProgram
from gcs.shows.formats.samples import NWU
from gcs.shows.formats.skybrush_lights import encoded

CURVE_DEGREE_MAX: Final = 3
"""Skybrush's own player draws curves up to this degree, so curves of a higher one are split."""

SPLIT_WITHIN_M: Final = 0.001
"""Greatest error of cubic curves in place of one of a higher degree."""

SPLITS_MAX: Final = 64
_ZERO_M: Final = 1e-7
"""A smaller coefficient does not raise a curve's degree."""

_U: Final = np.linspace(0.0, 1.0, 17)
"""Where the error is looked at."""

_HERMITE: Final = np.array([[1, 0, 0, 0], [1, 1 / 3, 0, 0], [0, 0, 1, -1 / 3], [0, 0, 1, 0]])
"""(4, 4) From position and derivative at both ends to the control points of a cubic curve."""


def write_skyc(show: DrawnShow) -> bytes:
    """Return the show as a compiled show. Within 1 mm, 20 ms of colour steps, and 0.1 degrees."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        drones = []
        for row, name in enumerate(show.vehicles):
            entry = f"drones/{row + 1:04d}/trajectory.json"
            _write(archive, entry, _trajectory(show, row))
            settings: dict[str, Any] = {
                "name": name,
                "home": _rounded(show.home_m[row] * NWU),
                "trajectory": {"$ref": f"./{entry}#"},
                "lights": {"version": 1, "data": encoded(show.lights.of_vehicle(row))},
            }
            yaw = show.yaw.of_vehicle(row)
            if len(yaw.times_s):
                settings["yawControl"] = _yaw(yaw)
            drones.append({"type": "generic", "settings": settings})
        _write(archive, "show.json", _root(show, drones))
    return content.getvalue()


def _write(archive: zipfile.ZipFile, entry: str, document: dict[str, Any]) -> None:
    """Write a document; without a date, so that the same show has the same bytes."""
    info = zipfile.ZipInfo(entry)
    info.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(info, json.dumps(document, separators=(",", ":")))


def _root(show: DrawnShow, drones: list[dict[str, Any]]) -> dict[str, Any]:
    meta: dict[str, Any] = {"title": show.title}
    if show.show_s is not None:
        meta["segments"] = {"show": list(show.show_s)}
    environment: dict[str, Any] = {"type": "outdoor"}
    if show.origin is not None:
        environment["location"] = _location(show.origin)
    settings: dict[str, Any] = {"validation": _claims(show.claims)}
    if show.cues:
        items = [{"time": cue.at_s, "name": cue.name} for cue in show.cues]
        settings["cues"] = {"version": 1, "items": items}
    if show.fence:
        polygons = [
            {
                "isInclusion": one.inside,
                "points": [[*_rounded(point * NWU[:2]), 0.0] for point in one.points_m],
            }
            for one in show.fence
        ]
        settings["geofence"] = {"version": 1, "polygons": polygons}
    swarm = {"drones": drones}
    return {"version": 1, "environment": environment, "meta": meta, "settings": settings, "swarm": swarm}


def _location(origin: ShowFrame) -> dict[str, Any]:
    """Return the origin as Skybrush Studio writes it: whole numbers of 1e-7 degrees and millimetres."""
    degrees = origin.latitude_deg, origin.longitude_deg
    place = [round(one * 1e7) for one in degrees] + [round(origin.altitude_amsl_m * 1e3)]
    return {"origin": place, "orientation": origin.heading_deg}


def _claims(claims: Claims) -> dict[str, float]:
    named = {
        "maxAltitude": claims.height_max_m,
        "maxVelocityXY": claims.speed_max_m_s,
        "maxVelocityZ": claims.sink_max_m_s,
        "maxVelocityZUp": claims.climb_max_m_s,
        "minDistance": claims.separation_min_m,
    }
    return {key: value for key, value in named.items() if value is not None}


def _yaw(yaw: YawProgram) -> dict[str, Any]:
    rows = zip(yaw.times_s.tolist(), np.degrees(yaw.yaw_rad).tolist(), strict=True)
    return {"version": 1, "setpoints": [[round(at_s, 3), round(yaw_deg, 3)] for at_s, yaw_deg in rows]}


def _rounded(values: Array) -> list[float]:
    return [float(value) for value in np.round(values, 4) + 0.0]  # + 0.0: no -0.0


def _trajectory(show: DrawnShow, row: int) -> dict[str, Any]:
    trajectory, takeoff_s = show.trajectories.of_vehicle(row), float(show.takeoff_s[row])
    takeoff_s = min(takeoff_s, float(trajectory.times_s[0]))  # times in the file count from it
    return {
        "version": 1,
        "points": _points(trajectory, takeoff_s),
        "takeoffTime": takeoff_s,
        "landingTime": float(show.landing_s[row]),
    }


def _points(trajectory: Trajectory, takeoff_s: float) -> list[list[Any]]:
    """Return [time, position, control points] of each curve's end; first where the trajectory begins."""
    times_s = trajectory.times_s - takeoff_s
    points = [[round(float(times_s[0]), 6), _rounded(trajectory.coefficients_m[0, 0] * NWU), []]]
    spans = zip(times_s.tolist(), times_s[1:].tolist(), trajectory.coefficients_m, strict=False)
    for begin_s, end_s, coefficients_m in spans:
        curves = _curves(coefficients_m)
        for at, points_m in enumerate(curves, start=1):
            time_s = begin_s + (end_s - begin_s) * at / len(curves)
            controls = [_rounded(point) for point in points_m[1:-1] * NWU]
            points.append([round(time_s, 6), _rounded(points_m[-1] * NWU), controls])
    return points


def _curves(coefficients_m: Array) -> list[Array]:
    """Return control points (d + 1, 3) of one curve, or of cubic ones, each for an equal part of the time."""
    degree = max(int(np.flatnonzero((np.abs(coefficients_m) > _ZERO_M).any(axis=1)).max(initial=0)), 1)
    if degree <= CURVE_DEGREE_MAX:
        padded_m = np.zeros((degree + 1, 3))
        padded_m[: len(coefficients_m)] = coefficients_m[: degree + 1]
        return [bezier_of_power(padded_m)]
    count = 2
    while True:
        curves, error_m = _cubic(coefficients_m, count)
        if error_m <= SPLIT_WITHIN_M or count >= SPLITS_MAX:
            return curves
        count *= 2


def _cubic(coefficients_m: Array, count: int) -> tuple[list[Array], float]:
    """Return `count` cubic curves with the polynomial's positions and slopes at their ends; and the error."""
    powers = np.arange(len(coefficients_m))
    ends = np.arange(count + 1) / count
    positions_m = (ends[:, None] ** powers) @ coefficients_m
    slopes_m = (ends[:, None] ** powers[:-1]) @ (powers[1:, None] * coefficients_m[1:]) / count
    curves = [
        _HERMITE @ np.stack([positions_m[at], slopes_m[at], positions_m[at + 1], slopes_m[at + 1]])
        for at in range(count)
    ]
    bernstein = np.stack([(1 - _U) ** 3, 3 * _U * (1 - _U) ** 2, 3 * _U**2 * (1 - _U), _U**3], axis=1)
    drawn_m = np.concatenate([bernstein @ curve for curve in curves])
    at_u = np.concatenate([(at + _U) / count for at in range(count)])
    exact_m = (at_u[:, None] ** powers) @ coefficients_m
    return curves, float(np.linalg.norm(drawn_m - exact_m, axis=1).max())
