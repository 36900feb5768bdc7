"""Start positions, goals and boxes. Pure; random only through the given generator."""

from collections.abc import Iterable
from math import ceil, sqrt

import numpy as np

from gcs.estimation.positioning import Positioning, uncertainty_m
from gcs.model.errors import ConfigError
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.planning.feasibility import radius_allowed, smallest_formation_radius_m
from gcs.shows.format import StandingBox
from gcs.simulation.reference_shapes import best
from gcs.simulation.scenario import FormationFlight, GoalFlight, Scenario

PADS_DEVIATIONS = 3.0
"""By this many standard deviations pads are farther apart than the least: preflight measures it."""

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


def obstacles_of(boxes: Iterable[StandingBox]) -> tuple[Obstacle, ...]:
    """The boxes of a flight, at time 0."""
    return tuple(Obstacle(f"box {number}", **box.model_dump()) for number, box in enumerate(boxes, 1))


def lattice(count: int) -> Array:
    """(count, 3) unit vectors of a Fibonacci lattice: nearly even, from pole to pole."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    ring = np.sqrt(1.0 - z * z)
    angle_rad = GOLDEN_RAD * index
    return np.stack([ring * np.cos(angle_rad), ring * np.sin(angle_rad), z], axis=1)


def formation_start_m(
    flight: FormationFlight, radius_m: float, count: int, random: np.random.Generator
) -> Array:
    """(count, 3) hover positions, show frame, of a formation with that radius."""
    if flight.start == "square" and round(sqrt(count)) ** 2 != count:
        raise ConfigError(f"a square start needs a square number of vehicles, not {count}")
    if flight.start in {"grid", "square"}:
        return grid_m(count, flight.spacing_m, flight.takeoff_height_m)
    if flight.start == "sphere":
        height_m = flight.height_m or flight.takeoff_height_m + 5.0 + radius_m
        turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
        return np.asarray(radius_m * best(count) @ turn.T - (0.0, 0.0, height_m))
    half_m = 1.5 * radius_m
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


RECORDED_M = np.array((0.2, 0.4))
"""Errors of the recorded estimates, sideways and up, one sigma."""

FIX_UP_TO_M = (0.06, 0.5, 1.0)
"""Error of RTK fixed, RTK float and DGPS at most; above it is a 3D fix."""


def reported_accuracy_m(scenario: Scenario) -> tuple[float, float]:
    world = scenario.world
    sideways_m, up_m = (world.reported_share * np.hypot(world.noise * RECORDED_M, world.bias_m)).tolist()
    return sideways_m, up_m


def reported_uncertainty_m(scenario: Scenario) -> float:
    """Uncertainty that the service gives each position, from what the receivers of this world report.

    Their fix is of the kind that has the error they report, also where the world's is greater.
    """
    world, floor = scenario.world, scenario.control.safety.floor
    horizontal_m, vertical_m = world.reported_share * np.hypot(world.noise * RECORDED_M, world.bias_m)
    fix_type = 6.0 - np.searchsorted(FIX_UP_TO_M, max(horizontal_m, vertical_m / floor.vertical_uncertainty))
    reported = *reported_accuracy_m(scenario), fix_type
    level_m, up_m, fix = (np.full(1, value) for value in reported)
    least = floor.uncertainty_m, floor.vertical_uncertainty
    wide_m = uncertainty_m(*least, level_m, up_m, fix, Positioning())
    return float(wide_m[0])


def accepted(scenario: Scenario, flight: FormationFlight, count: int) -> tuple[FormationFlight, float]:
    """Return the flight with pads as far apart as the service needs them, and the formation's radius.

    Raises: ConfigError when the service would refuse the radius.
    """
    safety, uncertainty = scenario.control.safety, np.full(count, reported_uncertainty_m(scenario))
    pads_m = safety.floor.kept_m(safety.floor.worst_reserve_m(uncertainty))[0]
    pads_m += PADS_DEVIATIONS * float(np.hypot(uncertainty[0], uncertainty[0]))  # they are measured, too
    if pads_m > flight.spacing_m:
        flight = flight.model_copy(update={"spacing_m": pads_m})
    least_m, radius_m = smallest_formation_radius_m(count, safety, uncertainty), flight.radius_m
    if radius_m is None or radius_m == "least":
        return flight, max(least_m, assembly_radius_m(count) if radius_m is None else 0.0)
    if radius_m < least_m:
        text = radius_allowed(count, safety, uncertainty)
        raise ConfigError(f"{scenario.name}: flight.radius_m = {radius_m:g}: {text}")
    return flight, radius_m
