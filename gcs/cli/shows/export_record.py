"""`gcs show export` of a recorded flight: estimated positions as a drawn show, with the lights set."""

from pathlib import Path
from typing import Final

import numpy as np

from gcs.cli.flight_report import found_files
from gcs.model.errors import GcsError
from gcs.model.state import Array
from gcs.recording import mcap_layout as layout
from gcs.recording.mcap_reader import FlightData, RecordedSample, Standard
from gcs.shows.drawn import DrawnShow, Trajectory
from gcs.shows.drawn.light_programs import LightProgram
from gcs.shows.drawn.piece_index import TIME_MAX_S
from gcs.shows.formats.samples import through_samples

SAMPLED_S: Final = 0.25


def flown(path: Path) -> DrawnShow:
    """Return the flight in a record; time 0 is its first tick.

    Args:
        path: flight.mcap, or a folder that holds it.

    Raises: GcsError when there is no flight, or one that is too long for a show.
    """
    flights, _ = found_files([path])
    if len(flights) != 1:
        raise GcsError(f"{path}: one flight.mcap is needed, there are {len(flights)}")
    data = FlightData(flights[0])
    ticks = _sampled(data)
    if len(ticks) < 2:
        raise GcsError(f"{data.path}: there is no flight in it")
    times_s = np.round([tick.tick.time_s - ticks[0].tick.time_s for tick in ticks], 3)
    if times_s[-1] > TIME_MAX_S:
        raise GcsError(f"{data.path}: {times_s[-1]:.0f} s: at most {TIME_MAX_S:g} s fit a show")
    table = np.stack([tick.vehicles for tick in ticks])
    path_m = layout.vectors(table, layout.POSITION).astype(np.float64)
    rows = np.flatnonzero(np.isfinite(path_m).all(axis=2).any(axis=0)).tolist()
    if not rows:
        raise GcsError(f"{data.path}: no position of any vehicle is known")
    trajectories = [_trajectory(times_s, path_m[:, row]) for row in rows]
    colours = np.stack([layout.colours(vehicles)[0] for vehicles in table])
    standard = Standard.of(data.about.config, str(data.path))
    return DrawnShow.of_programs(
        tuple(data.about.ids[row] for row in rows),
        trajectories,
        [LightProgram(times_s, colours[:-1, row], colours[1:, row]) for row in rows],
        title=str(path),
        origin=standard.frame,
    )


def _sampled(data: FlightData) -> list[RecordedSample]:
    """Return ticks at least `SAMPLED_S` apart."""
    found: list[RecordedSample] = []
    for tick in data.ticks():
        if not found or tick.tick.time_s >= found[-1].tick.time_s + SAMPLED_S - 1e-3:
            found.append(tick)
    return found


def _trajectory(times_s: Array, path_m: Array) -> Trajectory:
    """Return the path through the known positions; between them, over gaps of the record too."""
    known = np.isfinite(path_m).all(axis=1)
    return through_samples(times_s[known], path_m[known])
