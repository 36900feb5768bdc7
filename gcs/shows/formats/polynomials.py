"""Reads trajectories of Crazyswarm (uav_trajectories): rows of a duration and polynomials of x, y, z and yaw.

A row is 33 numbers: seconds, then 8 coefficients each, of t^0 to t^7, for x, y, z in m (x ahead, y left,
z up) and yaw in rad, counterclockwise. Source, as facts: whoenig/uav_trajectories, scripts/uav_trajectory.py.
"""

from pathlib import Path
from typing import Final

import numpy as np

from gcs.model.errors import DrawingError
from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow, Trajectory
from gcs.shows.drawn.light_programs import WHITE
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.drawn.yaw_programs import YawProgram
from gcs.shows.formats.csv_table import table
from gcs.shows.formats.samples import COORDINATE_MAX_M, NWU

COLUMNS: Final = 33
TERMS: Final = 8
JUMP_MAX_M: Final = 0.05
"""Most that one piece may begin away from where the piece before it ends; files are rounded."""

YAW_S: Final = 0.1
"""Interval of the set points that stand for the yaw's polynomial."""


def read_polynomials(data: bytes, file: str) -> DrawnShow:
    """Read the file of one vehicle; `file` names it in errors. Raises: DrawingError."""
    rows = table(data, file, (4, 7, COLUMNS))
    if rows.shape[1] != COLUMNS:
        samples = f"{rows.shape[1]} columns, as samples of one drone have"
        raise DrawingError(file, f"{samples}: put the CSV files of all drones into a .zip")
    return polynomial_show([rows], (Path(file).stem,), [file])


def polynomial_show(tables: list[Array], vehicles: tuple[str, ...], places: list[str]) -> DrawnShow:
    """Return the show of tables (k, 33), one for each vehicle; `places` names them in errors.

    Raises: DrawingError.
    """
    pairs = [_vehicle(rows, place) for rows, place in zip(tables, places, strict=True)]
    trajectories, yaws = zip(*pairs, strict=True)
    return DrawnShow.of_programs(vehicles, trajectories, [WHITE] * len(vehicles), yaws)


def _vehicle(rows: Array, place: str) -> tuple[Trajectory, YawProgram]:
    durations_s = rows[:, 0]
    times_s = np.append(0.0, np.cumsum(durations_s))
    flawed = ~((durations_s > 0.0) & (times_s[1:] <= TIME_MAX_S))
    if flawed.any():
        at = int(np.argmax(flawed))
        text = f"duration {durations_s[at]:g} s: more than 0, and up to {TIME_MAX_S:g} s in all, is needed"
        raise DrawingError(f"{place}: row {at + 1}", text)
    by_axis = rows[:, 1:].reshape(-1, 4, TERMS)
    over_u = by_axis * (durations_s[:, None] ** np.arange(TERMS))[:, None, :]  # t = u times duration
    if not np.isfinite(over_u).all():
        at = int(np.argmax(~np.isfinite(over_u).all(axis=(1, 2))))
        raise DrawingError(f"{place}: row {at + 1}", "finite coefficients are needed")
    coefficients_m = over_u[:, :3].transpose(0, 2, 1) * NWU
    ends_m = coefficients_m.sum(axis=1)
    jumps_m = np.linalg.norm(coefficients_m[1:, 0] - ends_m[:-1], axis=1)
    if not bool((np.abs(ends_m) <= COORDINATE_MAX_M).all()):
        at = int(np.argmax((np.abs(ends_m) > COORDINATE_MAX_M).any(axis=1)))
        text = f"it ends beyond {COORDINATE_MAX_M:g} m: are these coefficients of seconds?"
        raise DrawingError(f"{place}: row {at + 1}", text)
    if (jumps_m > JUMP_MAX_M).any():
        at = int(np.argmax(jumps_m > JUMP_MAX_M))
        raise DrawingError(
            f"{place}: row {at + 2}", f"begins {jumps_m[at]:.2f} m from where the row before ends"
        )
    return Trajectory(times_s, np.ascontiguousarray(coefficients_m)), _yaw(times_s, over_u[:, 3])


def _yaw(times_s: Array, over_u: Array) -> YawProgram:
    """Return set points every `YAW_S`; one alone where the yaw never changes."""
    if not over_u[:, 1:].any() and not np.ptp(over_u[:, 0]):
        return YawProgram(np.zeros(1), -over_u[:1, 0])
    at_s = np.append(np.arange(0.0, times_s[-1], YAW_S), times_s[-1])
    piece = np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, len(over_u) - 1)
    u = (at_s - times_s[piece]) / np.diff(times_s)[piece]
    yaw_rad = (over_u[piece] * u[:, None] ** np.arange(TERMS)).sum(axis=1)
    return YawProgram(at_s, -yaw_rad)
