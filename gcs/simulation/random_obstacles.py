"""Random worlds with boxes in the way. Pure; random only through the given generator."""

from dataclasses import dataclass
from math import cos, pi, sin

import numpy as np

from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.simulation.scenario import RandomObstacles

TRIES = 2000
"""Tries to place one box; a full field then has fewer boxes."""

MOMENTS_S = np.arange(0.0, 121.0, 1.0)
"""Times at which the paths of moving boxes are checked."""

START_CLEAR_S = 5.0
"""Time during which no moving box comes near the start."""


@dataclass(frozen=True, slots=True)
class ObstacleWorld:
    """A world in which the centre flies from the origin to the target, or around the origin, among boxes."""

    target_m: tuple[float, float]
    speed_m_s: float
    boxes: tuple[Obstacle, ...]
    appear_s: tuple[float, ...]  # when each box becomes known
    orbit_radius_m: float = 0.0


def draw_world(
    random: np.random.Generator, settings: RandomObstacles, avoidance: AvoidanceSettings, sphere_m: float
) -> ObstacleWorld:
    """Draw a world for a scenario and a sphere of that radius."""
    if settings.kind == "one":
        return _one_in_the_way(random, settings, avoidance, sphere_m)
    if settings.kind == "on-orbit":
        return _one_on_the_orbit(random, settings, sphere_m)
    return _many(random, settings, avoidance, sphere_m)


def _one_in_the_way(
    random: np.random.Generator, settings: RandomObstacles, avoidance: AvoidanceSettings, sphere_m: float
) -> ObstacleWorld:
    """One box on the sphere's straight path, and a target behind it."""
    ahead, aside = _course(random)
    half_m = _half_lengths_m(random, settings)
    height_m = random.uniform(settings.height_min_m, settings.height_max_m)
    size_m = float(np.hypot(*half_m)) + avoidance.margin_m
    spare_m = random.uniform(0.0, 20.0)
    before_m = sphere_m + settings.stopping_m + 1.5 * size_m + spare_m
    aside_m = random.uniform(-1.0, 1.0) * (0.7 * sphere_m + half_m.min())
    place_m = before_m * ahead + aside_m * aside
    behind_m = 1.5 * size_m + sphere_m + settings.beyond_m + random.uniform(0.0, 15.0)
    target_m = (before_m + behind_m) * ahead
    speed_m_s = random.uniform(settings.speed_min_m_s, settings.speed_max_m_s)
    sudden = random.random() < settings.sudden_share
    appears_s = random.uniform(0.0, spare_m / speed_m_s) if sudden else 0.0
    box = _box("box 1", place_m, half_m, height_m)
    return ObstacleWorld((float(target_m[0]), float(target_m[1])), speed_m_s, (box,), (appears_s,))


def _one_on_the_orbit(
    random: np.random.Generator, settings: RandomObstacles, sphere_m: float
) -> ObstacleWorld:
    """One box on the orbit of the centre, which begins at angle 0."""
    turn_rad = random.uniform(0.5 * pi, 1.5 * pi)
    off_m = settings.orbit_radius_m + random.uniform(-4.0, 4.0)
    half_m = _half_lengths_m(random, settings)
    height_m = random.uniform(settings.height_min_m + sphere_m, settings.height_max_m)
    speed_m_s = random.uniform(settings.speed_min_m_s, settings.speed_max_m_s)
    place_m = off_m * np.array([cos(turn_rad), sin(turn_rad)])
    box = _box("box 1", place_m, half_m, height_m)
    return ObstacleWorld((0.0, 0.0), speed_m_s, (box,), (0.0,), settings.orbit_radius_m)


def _many(
    random: np.random.Generator, settings: RandomObstacles, avoidance: AvoidanceSettings, sphere_m: float
) -> ObstacleWorld:
    """Many boxes between start and target: some overlap, some move, and all leave a passage."""
    ahead, aside = _course(random)
    target_m = settings.length_m * ahead
    speed_m_s = random.uniform(settings.speed_min_m_s, settings.speed_max_m_s)
    boxes: list[Obstacle] = []
    desired = int(random.integers(1, settings.boxes_max + 1))
    for _ in range(TRIES):
        if len(boxes) == desired:
            break
        place_m = random.uniform(0.0, settings.length_m) * ahead + random.uniform(-30.0, 30.0) * aside
        box = _somewhere(random, settings, place_m, speed_m_s, f"box {len(boxes) + 1}")
        clear = _clear_of_ends(box, settings, avoidance, target_m, sphere_m)
        if clear and all(_leaves_passage(box, other, settings.passage_m) for other in boxes):
            boxes.append(box)
    late_s = random.uniform(0.0, settings.sudden_until_s, len(boxes))
    sudden = random.random(len(boxes)) < settings.sudden_share
    appear_s = tuple(np.where(sudden, late_s, 0.0).tolist())
    return ObstacleWorld((float(target_m[0]), float(target_m[1])), speed_m_s, tuple(boxes), appear_s)


def _course(random: np.random.Generator) -> tuple[Array, Array]:
    """(2,) unit vector of a random course, and (2,) unit vector to its right."""
    heading_rad = random.uniform(-pi, pi)
    return np.array([cos(heading_rad), sin(heading_rad)]), np.array([-sin(heading_rad), cos(heading_rad)])


def _half_lengths_m(random: np.random.Generator, settings: RandomObstacles) -> Array:
    return random.uniform(settings.half_length_min_m, settings.half_length_max_m, 2)


def _box(
    name: str, place_m: Array, half_m: Array, height_m: float, velocity_m_s: tuple[float, float] = (0.0, 0.0)
) -> Obstacle:
    place, half = place_m.tolist(), half_m.tolist()
    return Obstacle(name, place[0], place[1], half[0], half[1], float(height_m), *velocity_m_s)


def _somewhere(
    random: np.random.Generator, settings: RandomObstacles, place_m: Array, speed_m_s: float, name: str
) -> Obstacle:
    half_m = _half_lengths_m(random, settings)
    height_m = random.uniform(settings.height_min_m, settings.height_max_m)
    moves = random.random() < settings.moving_share
    fast_m_s = random.uniform(0.2, 0.5) * speed_m_s if moves else 0.0
    way_rad = random.uniform(-pi, pi)
    return _box(name, place_m, half_m, height_m, (fast_m_s * cos(way_rad), fast_m_s * sin(way_rad)))


def _clear_of_ends(
    box: Obstacle, settings: RandomObstacles, avoidance: AvoidanceSettings, target_m: Array, sphere_m: float
) -> bool:
    """Whether a box is never near the sphere at the target, nor near the start at the beginning."""
    for time_s in MOMENTS_S if box.speed_m_s else MOMENTS_S[:1]:
        ellipse = Ellipse.around(
            box, margin_m=avoidance.margin_m, headroom_m=avoidance.headroom_m, time_s=float(time_s)
        )
        start_m, end_m = ellipse.distance_m(np.stack([np.zeros(2), target_m]))
        if time_s <= START_CLEAR_S and start_m < sphere_m + settings.stopping_m:
            return False
        if end_m < sphere_m + settings.beyond_m:
            return False
    return True


def _leaves_passage(box: Obstacle, other: Obstacle, passage_m: float) -> bool:
    """Whether two boxes leave a passage at all times; standing boxes may overlap instead."""
    half_m = np.array(
        [box.half_length_x_m + other.half_length_x_m, box.half_length_y_m + other.half_length_y_m]
    )
    here_m = np.array([box.position_m(time_s) for time_s in MOMENTS_S])
    there_m = np.array([other.position_m(time_s) for time_s in MOMENTS_S])
    gap_m = np.hypot(*np.maximum(np.abs(here_m - there_m) - half_m, 0.0).T)
    if box.speed_m_s == 0.0 and other.speed_m_s == 0.0:
        return bool(gap_m[0] == 0.0 or gap_m[0] >= passage_m)
    return bool((gap_m >= passage_m).all())
