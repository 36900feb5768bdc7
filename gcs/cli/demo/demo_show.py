"""`gcs demo --show`: a written show is checked, selected and flown through the REST API, and judged."""

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gcs.cli.demo.demo_report import GroundTruth
from gcs.cli.demo.demo_script import CONNECT_S, READY_S, Marks, StoppedEarlyError
from gcs.client import Client
from gcs.model.errors import CommandError, ConfigError, RefusedError
from gcs.model.state import Array
from gcs.shows import LoadedShow, find, load

CHECK_S: Final = 900.0
HOME_S: Final = 300.0
PAUSE_S: Final = 0.5
TRACK_RMS_MAX_M: Final = 0.3
"""Largest track error, over time and vehicles, with which a demonstration counts as passed."""


def loaded_for(arguments: argparse.Namespace) -> LoadedShow | None:
    """Load the show that the arguments name. Raises: ConfigError, also for another number of vehicles."""
    if arguments.show is None:
        return None
    loaded = load(find(arguments.show))
    needed = loaded.show.fleet.vehicles
    if arguments.vehicles != needed:
        raise ConfigError(f"--show {arguments.show}: it is for {needed} vehicles")
    named = loaded.show.drawing
    if arguments.stations != 1 and named is not None and named.spares is not None:
        raise ConfigError(f"--show {arguments.show}: spare vehicles fly with one station alone")
    return loaded


def fit(raw: dict[str, Any], loaded: LoadedShow) -> None:
    """Change a configuration so that it can fly the show, from the folder of its file."""
    show = loaded.show
    raw["show_frame"] = show.origin.model_dump()
    raw["shows"] = {"folder": str(Path(loaded.file).resolve().parent)}
    raw["target"] = {"x_m": show.fleet.pads.x_m, "y_m": show.fleet.pads.y_m}
    for key in ("takeoff_height_m", "takeoff_stagger_s"):
        raw["operation"][key] = getattr(show.fleet, key)
    fence = raw["control"]["safety"]["fence"]
    fence["height_min_m"] = min(fence["height_min_m"], show.fence.height_min_m)
    for key in ("height_max_m", "distance_max_m"):
        fence[key] = max(fence[key], getattr(show.fence, key))


def grid_options(loaded: LoadedShow) -> list[str]:
    """Return options with which the fake fleet stands on the pads of a show."""
    show, pads = loaded.show, loaded.show.fleet.pads
    heading_rad = np.radians(show.origin.heading_deg)
    x_m, y_m, _ = show.pads_m[0].tolist()
    north_m = np.cos(heading_rad) * x_m - np.sin(heading_rad) * y_m
    east_m = np.sin(heading_rad) * x_m + np.cos(heading_rad) * y_m
    turn_deg = 0.0 if show.drawing is None else show.drawing.place.turn_deg
    heading = f"--grid-heading={show.origin.heading_deg + turn_deg:.6f}"
    place = ["--grid-columns", str(pads.columns), "--spacing", f"{pads.spacing_m:g}"]
    return [*place, f"--grid-at={north_m:.4f},{east_m:.4f}", heading]


class ShowScript:
    """Flies the show; every step is an API call."""

    def __init__(self, client: Client, loaded: LoadedShow, say: Callable[[str], None]) -> None:
        self.marks = Marks()
        self._client, self._loaded, self._say = client, loaded, say
        self._stopped = False

    def interrupt(self) -> None:
        """Bring the fleet home now. Safe to call from any thread."""
        self._stopped = True

    def fly(self) -> None:
        """Check, select, fly. Raises: CommandError when a step is not done in time, RefusedError."""
        name, shows = self._loaded.name, self._client.shows
        self._say(f"the show {name} is checked: it is flown once in virtual time")
        shows.check(name)
        self._until("the check", CHECK_S, lambda: shows.checked(name).state not in {"waiting", "running"})
        checked = shows.checked(name)
        if not checked.good or checked.hash is None:
            problems = "; ".join(map(str, checked.problems)) or checked.reason
            raise RefusedError(f"the show {name} is not good to fly: {problems}")
        shows.select(name, checked.hash)
        self._say("good to fly, and selected")
        try:
            self._start(checked.hash)
            duration_s = self._loaded.timeline.duration_s
            up_s = READY_S + 2.0 * self._loaded.show.fleet.vehicles
            self._until("take-off", 2.0 * up_s, lambda: self._phase() == "running")
            self._say("all are where the show begins")
            self._until("the show", 2.0 * duration_s + READY_S, lambda: self._phase() != "running")
            self._say("the show is over; all return")
        except StoppedEarlyError:
            self._client.stop()
            self._stopped = False
            self._until("landing", HOME_S, lambda: self._phase() == "landed")
            raise
        self._until("landing", HOME_S, lambda: self._phase() == "landed")
        self._say("landed")

    def _start(self, show_hash: str) -> None:
        """Start as soon as preflight permits it. Raises: RefusedError with what is still wrong at the end."""
        end_s = time.monotonic() + CONNECT_S + READY_S
        while True:
            try:
                self._client.start(show_hash=show_hash)
            except RefusedError:
                if time.monotonic() > end_s:
                    raise
                self._pause()
            else:
                return

    def _phase(self) -> str:
        return self._client.show().phase

    def _until(self, what: str, seconds: float, reached: Callable[[], bool]) -> None:
        end_s = time.monotonic() + seconds
        while not reached():
            self._pause()
            if time.monotonic() > end_s:
                raise CommandError(f"{what}: not within {seconds:g} s ({self._client.show().reason})")

    def _pause(self) -> None:
        if self._stopped:
            raise StoppedEarlyError("stopped by hand")
        time.sleep(PAUSE_S)


def track_figures(
    truth: GroundTruth, loaded: LoadedShow, clock: Array, part_of: Sequence[int]
) -> dict[str, object]:
    """Return the true distances from the trajectories, in m, while the show's clock ran in drawn parts.

    Args:
        truth: of n vehicles.
        loaded: the show.
        clock: (k, 2) times of ticks, and of the show then.
        part_of: n rows of the trajectories that the vehicles fly.
    """
    ran = np.flatnonzero(np.diff(clock[:, 1]) > 0.0) + 1
    rows = np.searchsorted(truth.time_s, clock[ran, 0])
    off_m = []
    for row, show_s in zip(
        np.minimum(rows, len(truth.time_s) - 1).tolist(), clock[ran, 1].tolist(), strict=True
    ):
        motion = loaded.timeline.motion_at(show_s)
        if motion is not None:
            place_m = motion.position_m[list(part_of)]
            off_m.append(np.linalg.norm(truth.position_m[row] - place_m, axis=1))
    if not off_m:
        return {}
    away_m = np.stack(off_m)
    worst_m = np.sqrt(np.mean(away_m**2, axis=0)).max()
    return {
        "track_rms_m": round(float(np.sqrt(np.mean(away_m**2))), 3),
        "track_rms_worst_m": round(float(worst_m), 3),
        "track_max_m": round(float(away_m.max()), 3),
    }
