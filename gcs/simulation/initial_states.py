"""Start positions and goals of all vehicles. Pure; random only through the given generator."""

from math import ceil, sqrt

import numpy as np

from gcs.model.errors import ConfigError
from gcs.model.state import Array
from gcs.simulation.reference_shapes import best
from gcs.simulation.scenario import FormationFlight, GoalFlight

GOLDEN_RAD = np.pi * (3.0 - sqrt(5.0))
TRIES = 20_000


def assembly_radius_m(count: int) -> float:
    """max(10, 1.4 sqrt(N)) m: nearest neighbours settle about 4.3 m apart."""
    return max(10.0, 1.4 * sqrt(count))


def grid_m(count: int, spacing_m: float, height_m: float) -> Array:
    """(count, 3) positions in rows, centred at the origin."""
    side = ceil(sqrt(count))
    index = np.arange(count)
    place_m = np.stack([index // side, index % side, np.zeros(count)], axis=1, dtype=np.float64) * spacing_m
    place_m[:, :2] -= place_m[:, :2].mean(axis=0)
    place_m[:, 2] = -height_m
    return place_m


def square_m(count: int, spacing_m: float, height_m: float) -> Array:
    """(count, 3) positions on a square grid. Raises: ConfigError when `count` is not a square number."""
    side = round(sqrt(count))
    if side * side != count:
        raise ConfigError(f"a square start needs a square number of vehicles, not {count}")
    return grid_m(count, spacing_m, height_m)


def scattered_m(
    count: int, low_m: Array, high_m: Array, spacing_m: float, random: np.random.Generator
) -> Array:
    """(count, 3) random positions in a box, at least `spacing_m` apart with heights scaled by 1.5.

    Raises: ConfigError when the box is too small.
    """
    found_m = np.zeros((0, 3))
    stretch = np.array([1.0, 1.0, 1.0 / 1.5])
    for _ in range(TRIES):
        place_m = random.uniform(low_m, high_m)
        if (np.linalg.norm((found_m - place_m) * stretch, axis=1) >= spacing_m).all():
            found_m = np.vstack([found_m, place_m])
        if len(found_m) == count:
            return found_m
    raise ConfigError(f"{count} vehicles do not fit {spacing_m:g} m apart between {low_m} and {high_m}")


def lattice(count: int) -> Array:
    """(count, 3) unit vectors of a Fibonacci lattice: nearly even, from pole to pole."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    ring = np.sqrt(1.0 - z * z)
    angle_rad = GOLDEN_RAD * index
    return np.stack([ring * np.cos(angle_rad), ring * np.sin(angle_rad), z], axis=1)


def formation_start_m(flight: FormationFlight, count: int, random: np.random.Generator) -> Array:
    """(count, 3) hover positions, show frame."""
    if flight.start == "grid":
        return grid_m(count, flight.spacing_m, flight.takeoff_height_m)
    if flight.start == "square":
        return square_m(count, flight.spacing_m, flight.takeoff_height_m)
    if flight.start == "sphere":
        radius_m = flight.radius_m or assembly_radius_m(count)
        height_m = flight.height_m or flight.takeoff_height_m + 5.0 + radius_m
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        on_sphere: Array = radius_m * best(count) @ turn.T - (0.0, 0.0, height_m)
        return on_sphere
    half_m = 1.5 * (flight.radius_m or assembly_radius_m(count))
    low_m = np.array([-half_m, -half_m, -flight.takeoff_height_m - 2.0 * half_m])
    high_m = np.array([half_m, half_m, -flight.takeoff_height_m])
    return scattered_m(count, low_m, high_m, flight.spacing_m, random)


def goals_m(flight: GoalFlight, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """(count, 3) start positions and (count, 3) goals, show frame. Raises: ConfigError."""
    if flight.layout == "opposite":
        middle_m = np.array([0.0, 0.0, -flight.lowest_m - flight.extent_m])
        start_m = middle_m + flight.extent_m * lattice(count)
        return start_m, 2.0 * middle_m - start_m
    if flight.layout == "cube":
        half_m = flight.extent_m / 2.0
        low_m = np.array([-half_m, -half_m, -flight.lowest_m - flight.extent_m])
        high_m = np.array([half_m, half_m, -flight.lowest_m])
        start_m = scattered_m(count, low_m, high_m, flight.spacing_m, random)
        return start_m, scattered_m(count, low_m, high_m, flight.spacing_m, random)
    return _streams_m(flight, count)


def _streams_m(flight: GoalFlight, count: int) -> tuple[Array, Array]:
    """Two groups in ranks of four that fly head-on, or across each other's path."""
    half = count - count // 2
    index = np.arange(count) % half
    ranks = ceil(half / 4)
    wide = min(half, 4)
    across_m = flight.spacing_m * (index % wide - (wide - 1) / 2.0)
    behind_m = flight.extent_m / 2.0 + flight.spacing_m * (index // wide)
    ahead_m = flight.extent_m / 2.0 + flight.spacing_m * (ranks - 1 - index // wide)
    second = np.arange(count) >= half
    height_m = np.full(count, -flight.lowest_m)
    start_m = np.stack([-behind_m, across_m, height_m], axis=1)
    goal_m = np.stack([ahead_m, across_m, height_m], axis=1)
    if flight.layout == "head-on":
        flip = np.where(second[:, None], (-1.0, 1.0, 1.0), 1.0)
        return start_m * flip, goal_m * flip
    turned = [1, 0, 2]
    rows = second[:, None]
    return np.where(rows, start_m[:, turned], start_m), np.where(rows, goal_m[:, turned], goal_m)
