"""Reads and writes Skybrush's CSV: a zip archive with one file per drone, samples of position and colour.

A row is time in ms, x, y, z in m and, if it has them, red, green, blue from 0 to 255. Axes are those of
`.skyc`. Source, as facts: skybrush-io/studio-blender, addons/io_export_skybrush_csv.py and
operators/import_from_csv.py.
"""

import io
import re
import zipfile
from collections.abc import Iterator
from itertools import chain
from typing import Final

import numpy as np

from gcs.model.errors import DrawingError
from gcs.model.state import Array
from gcs.shows.drawn import DrawnShow, Trajectory
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.format import MAX_VEHICLES
from gcs.shows.formats.archive import Archive
from gcs.shows.formats.csv_table import NUMBERS_MAX, table
from gcs.shows.formats.polynomials import COLUMNS as POLYNOMIAL_COLUMNS
from gcs.shows.formats.polynomials import polynomial_show
from gcs.shows.formats.samples import COORDINATE_MAX_M, NWU, through_samples

HEADER: Final = "Time_msec,X,Y,Z,R,G,B"
WRITTEN_HZ: Final = 5.0
CORNER_M_S: Final = 0.2
"""Where a velocity jumps by more, rows `BESIDE_S` before and after keep readers from rounding it off."""

BESIDE_S: Final = 0.02

SECONDS_BELOW: Final = 1000.0
"""A file of which the last time is less than this, in ms, has seconds, or shows nothing."""


def read_csv_zip(archive: Archive) -> DrawnShow:
    """Read a zip of CSV files: Skybrush's, or polynomials of Crazyswarm. Raises: DrawingError."""
    file, names = archive.file, sorted(archive.with_suffix(".csv"), key=_natural)
    if not 1 <= len(names) <= MAX_VEHICLES:
        raise DrawingError(
            file, f"{len(names)} CSV files: 1 to {MAX_VEHICLES}, one for each drone, are needed"
        )
    vehicles = tuple(name.rsplit("/", 1)[-1][:-4] for name in names)
    tables = _tables(archive, names)
    first = next(tables)
    if first.shape[1] == POLYNOMIAL_COLUMNS:
        return polynomial_show([first, *tables], vehicles, [f"{file}: {name}" for name in names])
    trajectories: list[Trajectory] = []
    lights: list[LightProgram] = []
    for rows, name in zip(chain([first], tables), names, strict=True):
        _check(rows, f"{file}: {name}")
        trajectories.append(through_samples(rows[:, 0] / 1e3, rows[:, 1:4] * NWU))
        lights.append(_colours(rows))
    return DrawnShow.of_programs(vehicles, trajectories, lights)


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key by which drone 2 comes before drone 10."""
    parts = re.split(r"([0-9]+)", name.casefold())
    return [
        (0, part) if at % 2 == 0 else (len(number := part.lstrip("0")), number)
        for at, part in enumerate(parts)
    ]


def _tables(archive: Archive, names: list[str]) -> Iterator[Array]:
    """Yield the numbers of one file after the other, all with as many columns. Raises: DrawingError."""
    numbers = columns = 0
    for name in names:
        content, place = archive.read(name), f"{archive.file}: {name}"
        numbers += content.count(b",")
        if numbers > NUMBERS_MAX:
            raise DrawingError(place, f"more than {NUMBERS_MAX} numbers with the files before it")
        rows = table(content, place, (4, 7, POLYNOMIAL_COLUMNS))
        columns = columns or rows.shape[1]
        if rows.shape[1] != columns:
            raise DrawingError(place, f"{rows.shape[1]} columns: {columns} as in {names[0]} are needed")
        yield rows


def _check(rows: Array, place: str) -> None:
    """Raises: DrawingError for times, positions or colours out of bounds."""
    times_ms = rows[:, 0]
    wrong = ~((times_ms >= 0.0) & (times_ms <= TIME_MAX_S * 1e3))
    wrong[1:] |= ~(np.diff(times_ms) > 0.0)
    whole = (times_ms[-1] < SECONDS_BELOW) & (np.arange(len(rows)) == len(rows) - 1) & (len(rows) > 1)
    checks = (
        (wrong, f"times from 0 to {TIME_MAX_S * 1e3:.0f} ms that increase"),
        (whole, "times in milliseconds, to more than a second,"),
        (~(np.abs(rows[:, 1:4]) <= COORDINATE_MAX_M).all(axis=1), f"positions within {COORDINATE_MAX_M:g} m"),
        (~((rows[:, 4:] >= 0.0) & (rows[:, 4:] <= 255.0)).all(axis=1), "colours from 0 to 255"),
    )
    for flawed, needed in checks:
        if flawed.any():
            at = int(np.argmax(flawed))
            shown = ", ".join(f"{value:g}" for value in rows[at].tolist())
            raise DrawingError(f"{place}: row {at + 1}", f"{shown}: {needed} are needed")


def _colours(rows: Array) -> LightProgram:
    """Return fades between the samples' colours; white where the file has none."""
    rgb = (
        np.rint(rows[:, 4:]).astype(np.uint8)
        if rows.shape[1] == 7
        else np.full((len(rows), 3), 255, np.uint8)
    )
    times_s = rows[:, 0] / 1e3
    if times_s[0] > 0.0:
        times_s, rgb = np.append(0.0, times_s), np.concatenate([rgb[:1], rgb])
    if len(times_s) == 1:
        times_s, rgb = np.array([0.0, 1.0]), np.concatenate([rgb, rgb])
    return LightProgram(times_s, rgb[:-1], rgb[1:])


def write_csv_zip(show: DrawnShow) -> bytes:
    """Return the show as a zip of CSV files: rows at `WRITTEN_HZ`, and where a drone's colour changes.

    Where the lights go on after the last trajectory, so do the rows.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        regular_s = sample_times_s(show, WRITTEN_HZ)
        for row in range(len(show)):
            archive.writestr(f"drone_{row + 1:04d}.csv", _file(show, row, regular_s))
    return content.getvalue()


def _file(show: DrawnShow, row: int, regular_s: Array) -> str:
    """Return the rows of one vehicle; a step of its colour has rows 1 ms apart."""
    knots_s = np.round(show.lights.of_vehicle(row).times_s, 3)
    corners_s = _corners_s(show.trajectories.of_vehicle(row))
    beside_s = [corners_s - BESIDE_S, corners_s, corners_s + BESIDE_S]
    times_s = np.unique(np.round(np.concatenate([regular_s, knots_s, knots_s - 0.001, *beside_s]), 3))
    times_s = times_s[(times_s >= 0.0) & (times_s <= TIME_MAX_S)]
    vehicles = np.full(len(times_s), row)
    places_m = (show.trajectories.at(times_s, vehicles).position_m * NWU).tolist()
    colours = show.lights.colours_at(times_s, vehicles).tolist()
    lines = [
        f"{round(time_s * 1e3)},{x_m:.6f},{y_m:.6f},{z_m:.6f},{red},{green},{blue}"
        for time_s, (x_m, y_m, z_m), (red, green, blue) in zip(
            times_s.tolist(), places_m, colours, strict=True
        )
    ]
    return "\n".join((HEADER, *lines)) + "\n"


def _corners_s(trajectory: Trajectory) -> Array:
    """(k,) Times at which the velocity jumps, from rest at the beginning and to rest at the end as well."""
    if len(trajectory.times_s) < 2:
        return trajectory.times_s
    coefficients_m, durations_s = trajectory.coefficients_m, np.diff(trajectory.times_s)[:, None]
    powers = np.arange(coefficients_m.shape[1])[:, None]
    begin_m_s = coefficients_m[:, 1] / durations_s if len(powers) > 1 else np.zeros_like(durations_s)
    end_m_s = (powers * coefficients_m).sum(axis=1) / durations_s
    rest_m_s = np.zeros((1, 3))
    jumps_m_s = np.concatenate([begin_m_s, rest_m_s]) - np.concatenate([rest_m_s, end_m_s])
    return np.asarray(trajectory.times_s[np.linalg.norm(jumps_m_s, axis=1) > CORNER_M_S])


def sample_times_s(show: DrawnShow, rate_hz: float) -> Array:
    """(k,) Times from 0 to the end of the show, at least two, at a constant rate; whole milliseconds."""
    count = max(int(np.ceil(show.duration_s * rate_hz)), 1)
    return np.round(np.arange(count + 1) / rate_hz, 3)
