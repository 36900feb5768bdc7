"""Figures of a demonstration flight, computed only from the vehicles' true states."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.formation.repulsion import best_configuration, energy, nearest_m
from gcs.model.errors import GcsError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.safety.separation import Floor, minimum_separation, pairs_that_count, scaled_distance_m

SAMPLE_S = 0.02
LARGE, LARGE_SAMPLE_S = 100, 0.05
"""With more than `LARGE` vehicles true states are sampled at the rate of the file, without interpolation."""

PENETRATION_M = 1.0
"""A vehicle this close to a box's walls, or above its top, counts as inside."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """True states of n vehicles at k common times of the monotonic clock, in the show frame."""

    time_s: Array  # (k,)
    position_m: Array  # (k, n, 3)
    airborne: Mask  # (k, n)
    landed_at_end: Mask  # (n,) on the ground, disarmed

    def between(self, start_s: float, end_s: float) -> "GroundTruth":
        rows = (self.time_s >= start_s) & (self.time_s <= end_s)
        return GroundTruth(self.time_s[rows], self.position_m[rows], self.airborne[rows], self.landed_at_end)


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """What the service commanded at k ticks, in the show frame."""

    time_s: Array  # (k,)
    center_m: Array  # (k, 3), NaN while no formation flew
    radius_m: Array  # (k,)
    target_m: Array  # (k, 2)

    def at(self, time_s: Array) -> "Commanded":
        def values(array: Array) -> Array:
            columns = array.reshape(len(self.time_s), -1)
            picked = [np.interp(time_s, self.time_s, columns[:, i]) for i in range(columns.shape[1])]
            return np.stack(picked, axis=1).reshape(len(time_s), *array.shape[1:])

        return Commanded(time_s, values(self.center_m), values(self.radius_m), values(self.target_m))


def read_truth(files: Sequence[Path], frame: ShowFrame) -> GroundTruth:
    """Join truth files; each has the same vehicles in all its lines.

    Args:
        files: as `python -m gcs.sim --truth` writes them, with the origin of the show.
        frame: the show frame of the result.

    Raises: GcsError when a file is empty.
    """
    trajectories = [_read_trajectories(path) for path in files]
    start_s, end_s = max(t.time_s[0] for t in trajectories), min(t.time_s[-1] for t in trajectories)
    count = sum(len(track.down) for track in trajectories)
    time_s = np.arange(start_s, end_s, LARGE_SAMPLE_S if count > LARGE else SAMPLE_S)
    position_m, airborne = [], []
    for track in trajectories:
        for i in range(track.flying.shape[1]):
            ned_m = [np.interp(time_s, track.time_s, track.ned_m[:, i, axis]) for axis in range(3)]
            position_m.append(frame.from_ned(np.stack(ned_m, axis=1)))
            airborne.append(np.interp(time_s, track.time_s, track.flying[:, i].astype(float)) > 0.5)
    down = np.concatenate([track.down for track in trajectories])
    return GroundTruth(time_s, np.stack(position_m, axis=1), np.stack(airborne, axis=1), down)


@dataclass(frozen=True, slots=True, eq=False)
class _Trajectories:
    """The n vehicles of one file at k times."""

    time_s: Array  # (k,)
    ned_m: Array  # (k, n, 3)
    flying: Mask  # (k, n)
    down: Mask  # (n,) on the ground with motors off at the end


def _read_trajectories(path: Path) -> _Trajectories:
    times_s: list[float] = []
    rows: list[list[tuple[float, ...]]] = []
    with path.open(encoding="utf-8") as lines:
        for line in lines:
            try:
                sample = json.loads(line)
            except json.JSONDecodeError:
                continue  # the last line may be incomplete when the process was killed
            times_s.append(sample["time_s"])
            rows.append(
                [
                    (one["north_m"], one["east_m"], one["down_m"], not one["landed"], one["armed"])
                    for one in sample["vehicles"]
                ]
            )
    if not rows:
        raise GcsError(f"{path}: no true states were written")
    table = np.array(rows, dtype=np.float64)
    flying = table[:, :, 3] > 0.5
    down: Mask = ~flying[-1] & (table[-1, :, 4] < 0.5)
    return _Trajectories(np.array(times_s), table[:, :, :3], flying, down)


def separation(truth: GroundTruth, floor: Floor) -> tuple[float, int]:
    """Return the smallest distance of the pairs that count, and how often a pair fell below the floor."""
    smallest_m, violations = np.inf, 0
    inside_before: set[tuple[int, int]] = set()
    for position_m, airborne in zip(truth.position_m, truth.airborne, strict=True):
        distance_m, _ = minimum_separation(position_m, airborne, floor)
        smallest_m = min(smallest_m, distance_m)
        first, second = pairs_that_count(position_m, airborne, floor)
        close = scaled_distance_m(position_m, first, second, floor) < floor.horizontal_m
        inside = set(zip(first[close].tolist(), second[close].tolist(), strict=True))
        violations += len(inside - inside_before)
        inside_before = inside
    return smallest_m, violations


def shape(truth: GroundTruth, commanded: Commanded) -> dict[str, float]:
    """Measure the formation over a steady window, from each vehicle's mean position about the centre.

    Returns: energy and nearest distance relative to those of the best known configuration, and the mean
        radius error of the worst vehicle in metres.
    """
    desired = commanded.at(truth.time_s)
    offset_m = truth.position_m - desired.center_m[:, None, :]
    radius_m = np.linalg.norm(offset_m, axis=2)
    error_m = np.abs(radius_m - desired.radius_m[:, None]).mean(axis=0).max()
    mean_m = offset_m.mean(axis=0)
    direction = mean_m / np.linalg.norm(mean_m, axis=1, keepdims=True)
    best = best_configuration(len(direction))
    return {
        "energy_ratio": energy(direction) / energy(best),
        "nearest_ratio": nearest_m(direction) / nearest_m(best),
        "radius_error_m": float(error_m),
    }


def orbit_error_m(truth: GroundTruth, commanded: Commanded, orbit_radius_m: float) -> float:
    """Root mean square of the true centroid's distance to the true target, less the orbit's radius."""
    desired = commanded.at(truth.time_s)
    distance_m = np.linalg.norm(truth.position_m.mean(axis=1)[:, :2] - desired.target_m, axis=1)
    return float(np.sqrt(np.mean((distance_m - orbit_radius_m) ** 2)))


def penetrations(truth: GroundTruth, obstacle: Obstacle) -> int:
    """Count how often a vehicle entered the box, grown by `PENETRATION_M` on all sides."""
    inside = (
        (np.abs(truth.position_m[:, :, 0] - obstacle.x_m) < obstacle.half_length_x_m + PENETRATION_M)
        & (np.abs(truth.position_m[:, :, 1] - obstacle.y_m) < obstacle.half_length_y_m + PENETRATION_M)
        & (-truth.position_m[:, :, 2] < obstacle.height_m + PENETRATION_M)
    )
    entered = inside & ~np.vstack([np.zeros((1, inside.shape[1]), dtype=bool), inside[:-1]])
    return int(entered.sum())


def summary(figures: Mapping[str, object]) -> str:
    width = max(len(name) for name in figures)
    return "\n".join(f"  {name:<{width}}  {_plain(value)}" for name, value in figures.items())


def _plain(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)
