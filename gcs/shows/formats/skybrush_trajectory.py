"""Trajectories as Skybrush writes them: Bezier curves (version 1) or samples (versions 0 and 2). Pure.

Source, as facts: skybrush-io/skybrush.js, packages/show-format; skybrush-io/studio-blender,
model/trajectory.py; AIMotionLab-SZTAKI/skyc_utils, which writes curves of degree 7 with the yaw as a fourth
coordinate.
"""

from base64 import b64decode
from typing import Final

import numpy as np

from gcs.model.errors import DrawingError
from gcs.model.state import Array
from gcs.shows.drawn import Trajectory
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.drawn.trajectories import DEGREE_MAX, power_of_bezier
from gcs.shows.formats.json_values import Value
from gcs.shows.formats.samples import COORDINATE_MAX_M, NWU, through_samples

POINTS_MAX: Final = 50_000
"""Of one vehicle: two hours at 7 Hz."""


_BROKEN: Final = (TypeError, ValueError, IndexError, KeyError, OverflowError)


def read_trajectory(value: Value) -> Trajectory:
    """Return a trajectory in the show frame, its times from its take-off time on. Raises: DrawingError."""
    version = value.version(0, 1, 2)
    points = value.need("points")
    takeoff = value.get("takeoffTime")
    takeoff_s = 0.0 if takeoff is None else takeoff.number(0.0, TIME_MAX_S)
    if version == 1:
        return _curves(points, takeoff_s)
    samples = _floats(points) if version == 2 else _rows(points)
    times_s = samples[:, 0] + takeoff_s
    _check(points, times_s, samples[:, 1:])
    return through_samples(times_s, samples[:, 1:] * NWU)


def _rows(points: Value) -> Array:
    """(k, 4) Time, x, y, z of version 0."""
    rows = points.items(POINTS_MAX)
    try:
        if any(len(row) != 4 or not _numbers(row) for row in rows):  # type: ignore[arg-type]  # a TypeError is caught
            raise TypeError
    except _BROKEN:
        raise points.wrong("a list of [time, x, y, z]") from None
    return _array(points, rows).reshape(-1, 4)


def _floats(points: Value) -> Array:
    """(k, 4) Time, x, y, z of version 2: little-endian 32-bit floats in base64."""
    text = points.text(POINTS_MAX * 22)
    try:
        return np.frombuffer(b64decode(text, validate=True), "<f4").astype(np.float64).reshape(-1, 4)
    except ValueError as error:
        raise DrawingError(points.place, f"32-bit floats in base64, four for each point: {error}") from None


def _curves(points: Value, takeoff_s: float) -> Trajectory:
    """Return the curves of version 1: points [time, position, control points before it]."""
    found = points.items(POINTS_MAX)
    curves: dict[int, tuple[list[int], list[object]]] = {}  # by degree: pieces, and control points of each
    times_s: list[object] = []
    before: object = None
    for at, point in enumerate(found):
        try:
            time_s, position, *rest = point  # type: ignore[misc]  # a TypeError is caught
            controls = rest[0] if rest and rest[0] else []
            if len(rest) > 1 or not _places(position, *controls):
                raise TypeError
        except _BROKEN:
            needed = "[time, [x, y, z], [control points]]"
            raise points.element(at, point).wrong(needed) from None
        if len(controls) >= DEGREE_MAX:
            wrong = f"{len(controls)} control points: at most {DEGREE_MAX - 1}"
            raise DrawingError(points.element(at, point).place, wrong)
        if at:
            pieces, of_degree = curves.setdefault(len(controls) + 1, ([], []))
            pieces.append(at - 1)
            of_degree.append([one[:3] for one in (before, *controls, position)])  # type: ignore[index]
        before = position
        times_s.append(time_s)
    if not _numbers(times_s):
        at = next(at for at, time_s in enumerate(times_s) if not _numbers([time_s]))
        raise points.element(at, found[at]).wrong("a number as its time")
    when_s = _array(points, times_s) + takeoff_s
    if len(when_s) < 2:
        positions_m = _array(points, [before]).reshape(-1, 3) if found else np.empty((0, 3))
        _check(points, when_s, positions_m)
        return Trajectory(when_s, positions_m[None] * NWU)
    coefficients_m = np.zeros((len(when_s) - 1, max(curves) + 1, 3))
    for degree, (pieces, of_degree) in curves.items():
        points_m = _array(points, of_degree)
        _check(points, when_s, points_m)
        coefficients_m[pieces, : degree + 1] = power_of_bezier(points_m * NWU)
    return Trajectory(when_s, coefficients_m)


def _numbers(row: object) -> bool:
    return set(map(type, row)) <= {int, float}  # type: ignore[call-overload]  # a TypeError is caught


def _places(*places: object) -> bool:
    """Whether all are [x, y, z], or [x, y, z, yaw]."""
    return all(type(one) is list and 3 <= len(one) <= 4 and _numbers(one) for one in places)


def _array(points: Value, values: object) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except _BROKEN:  # a whole number beyond all floats
        raise points.wrong(f"numbers up to {COORDINATE_MAX_M:g}") from None


def _check(points: Value, times_s: Array, positions_m: Array) -> None:
    """Raises: DrawingError for no point, times out of bounds or order, or positions that are not finite."""
    if not len(times_s):
        raise DrawingError(points.place, "a point is needed")
    wrong = ~((times_s >= 0.0) & (times_s <= TIME_MAX_S))
    wrong[1:] |= ~(np.diff(times_s) > 0.0)
    if wrong.any():
        at = int(np.argmax(wrong))
        after = f", after the {times_s[at - 1]:g} s of the point before" if at else ""
        text = f"time {times_s[at]:g} s: from 0 to {TIME_MAX_S:g} s{after}"
        raise DrawingError(f"{points.place}[{at}]", text)
    if not bool((np.abs(positions_m) <= COORDINATE_MAX_M).all()):
        raise DrawingError(points.place, f"a coordinate is not finite, or beyond {COORDINATE_MAX_M:g} m")
