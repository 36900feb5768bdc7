"""Trajectories as Skybrush writes them: Bezier curves (version 1) or samples (versions 0 and 2). Pure.

Source, as facts: skybrush-io/skybrush.js, packages/show-format; skybrush-io/studio-blender,
model/trajectory.py; AIMotionLab-SZTAKI/skyc_utils, which writes curves of degree 7 with the yaw as a fourth
coordinate.
"""

from base64 import b64decode
from itertools import chain
from typing import Any, Final, NoReturn

import numpy as np

from gcs.model.errors import DrawingError
from gcs.model.json_values import Value
from gcs.model.state import Array
from gcs.shows.drawn import Trajectory
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.drawn.trajectories import DEGREE_MAX, power_of_bezier
from gcs.shows.formats.samples import COORDINATE_MAX_M, NWU, through_samples

POINTS_MAX: Final = 50_000
"""Of one vehicle: two hours at 7 Hz."""


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


def has_yaw(value: Value) -> bool:
    """Whether a trajectory that was read has a yaw other than 0 in its points."""
    points = value.need("points").raw
    return isinstance(points, list) and any(
        len(place) == 4 and place[3] != 0
        for point in points
        if len(point) <= 3
        for place in (point[1], *(point[2] or () if len(point) == 3 else ()))
    )


def _rows(points: Value) -> Array:
    """(k, 4) Time, x, y, z of version 0."""
    rows: list[Any] = points.items(POINTS_MAX)
    try:
        well_formed = set(map(len, rows)) <= {4} and all(map(_numbers, rows))
    except TypeError:
        well_formed = False
    if not well_formed:
        raise points.wrong("a list of [time, x, y, z]")
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
    found: list[Any] = points.items(POINTS_MAX)
    controls = [point[2] or () if type(point) is list and len(point) == 3 else () for point in found]
    if not _well_formed(found, controls):
        _refuse(points, found)
    counts = np.array([len(one) for one in controls], dtype=np.intp)
    if counts.max(initial=0) >= DEGREE_MAX:
        at = int(counts.argmax())
        wrong = f"{counts[at]} control points: at most {DEGREE_MAX - 1}"
        raise DrawingError(points.element(at, None).place, wrong)
    times_s = _array(points, [point[0] for point in found]) + takeoff_s
    places_m = _coordinates(points, [point[1] for point in found])
    controls_m = _coordinates(points, list(chain.from_iterable(controls)))
    _check(points, times_s, places_m)
    _check(points, times_s, controls_m)
    if len(times_s) < 2:
        return Trajectory(times_s, places_m[None] * NWU)
    first = np.cumsum(counts) - counts  # of each point's control points
    coefficients_m = np.zeros((len(times_s) - 1, int(counts[1:].max()) + 2, 3))
    for count in np.unique(counts[1:]).tolist():
        ends = np.flatnonzero(counts[1:] == count) + 1
        inner_m = controls_m[first[ends][:, None] + np.arange(count)]
        points_m = np.concatenate([places_m[ends - 1][:, None], inner_m, places_m[ends][:, None]], axis=1)
        coefficients_m[ends - 1, : count + 2] = power_of_bezier(points_m * NWU)
    return Trajectory(times_s, coefficients_m)


def _well_formed(found: list[Any], controls: list[Any]) -> bool:
    """Whether all points are lists of a number, a place and, if they have them, places."""
    try:
        return (
            set(map(type, found)) <= {list}
            and set(map(len, found)) <= {2, 3}
            and _numbers([point[0] for point in found])
            and _places([point[1] for point in found])
            and set(map(type, controls)) <= {list, tuple}
            and _places(list(chain.from_iterable(controls)))
        )
    except TypeError:
        return False


def _refuse(points: Value, found: list[Any]) -> NoReturn:
    """Raises: DrawingError for the first point that is not well formed."""
    for at, point in enumerate(found):
        controls = point[2] or () if type(point) is list and len(point) == 3 else ()
        if not _well_formed([point], [controls]):
            raise points.element(at, point).wrong("[time, [x, y, z], [control points]]")
    raise points.wrong("a list of points")


def _numbers(values: list[Any]) -> bool:
    return set(map(type, values)) <= {int, float}


def _places(places: list[Any]) -> bool:
    """Whether all are [x, y, z], or [x, y, z, yaw]."""
    return (
        set(map(type, places)) <= {list}
        and set(map(len, places)) <= {3, 4}
        and _numbers(list(chain.from_iterable(places)))
    )


def _coordinates(points: Value, places: list[Any]) -> Array:
    """(k, 3) Coordinates of places, without the yaw of those that have one."""
    if set(map(len, places)) <= {3}:
        return _array(points, places).reshape(-1, 3)
    return _array(points, [place[:3] for place in places]).reshape(-1, 3)


def _array(points: Value, values: object) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:  # a whole number beyond all floats
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
