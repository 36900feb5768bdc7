"""Figures of a demonstration flight, computed only from the vehicles' true states."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.formation.laws.protocol import GoalShape
from gcs.formation.repulsion import energy, nearest_m
from gcs.model.errors import GcsError
from gcs.model.frames import ShowFrame
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.recording.trajectories import interpolated, read_true_states
from gcs.safety.floor import Floor, minimum_separation, pairs_that_count, scaled_distance_m
from gcs.simulation.reference_shapes import best

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
        columns = self.center_m, self.radius_m, self.target_m
        return Commanded(time_s, *(interpolated(self.time_s, values, time_s) for values in columns))


def ground_truth(file: Path, frame: ShowFrame, vehicles: int) -> GroundTruth:
    """Read the file that `python -m gcs.sim --truth` wrote. Raises: GcsError naming file and line."""
    period_s = LARGE_SAMPLE_S if vehicles > LARGE else SAMPLE_S
    known = read_true_states([file], period_s=period_s)
    airborne, armed = known.values[..., 6] > 0.5, known.values[..., 8] > 0.5
    return GroundTruth(known.time_s, known.position_m(frame), airborne, ~(airborne[-1] | armed[-1]))


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


def shape(truth: GroundTruth, commanded: Commanded, goal: GoalShape = GoalShape.SPHERE) -> dict[str, float]:
    """Measure the formation over a steady window, from each vehicle's mean position.

    Directions are those from the centre of the sphere through the vehicles: a barometer's scale error moves
    all of them alike, which is no error of the shape.

    Returns: energy and nearest distance relative to those of the best known configuration; in metres the mean
        radius error of the worst vehicle about the commanded centre, and how far that is from the sphere's.
        Nothing for a law with another goal.
    Raises: GcsError where no formation flew in a part of the window.
    """
    desired = commanded.at(truth.time_s)
    flew = np.isfinite(desired.center_m).all(axis=1)
    if not flew.all():
        text = f"for {1.0 - flew.mean():.0%} of the time in which its shape counts"
        raise GcsError(f"the formation was not flown {text}: control stood still, or the machine did")
    if goal is not GoalShape.SPHERE:
        return {}
    offset_m = truth.position_m - desired.center_m[:, None, :]
    radius_m = np.linalg.norm(offset_m, axis=2)
    error_m = np.abs(radius_m - desired.radius_m[:, None]).mean(axis=0).max()
    mean_m = offset_m.mean(axis=0)
    center_m = sphere_center_m(mean_m)
    direction = mean_m - center_m
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ideal = best(len(direction))
    return {
        "energy_ratio": energy(direction) / energy(ideal),
        "nearest_ratio": nearest_m(direction) / nearest_m(ideal),
        "radius_error_m": float(error_m),
        "center_error_m": float(np.linalg.norm(center_m)),
    }


def sphere_center_m(position_m: Array) -> Array:
    """Centre of the sphere through (n, 3) points, by least squares; of several that nearest to their mean."""
    mean_m = position_m.mean(axis=0)
    around_m = position_m - mean_m
    system = np.column_stack([2.0 * around_m, np.ones(len(around_m))])  # |p|^2 = 2 p c + (r^2 - |c|^2)
    solved, *_ = np.linalg.lstsq(system, (around_m**2).sum(axis=1), rcond=1e-6)
    center_m: Array = mean_m + solved[:3]
    return center_m


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
    plain = {name: f"{each:.5g}" if isinstance(each, float) else each for name, each in figures.items()}
    return "\n".join(f"  {name:<{width}}  {value}" for name, value in plain.items())
