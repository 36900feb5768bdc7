"""Random boxes and a target among them. Pure; random only through the given generator."""

from dataclasses import dataclass, replace
from math import cos, pi, sin

import numpy as np

from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.model.errors import ConfigError
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.simulation.home_worlds import SHAPES, home_world
from gcs.simulation.scenario import RandomObstacles

BOX_TRIES = 2000
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
    pads_m: tuple[float, float] | None = None  # their middle; None: below the start


@dataclass(frozen=True, slots=True, eq=False)
class _Draw:
    """What a world is drawn from."""

    random: np.random.Generator
    settings: RandomObstacles
    avoidance: AvoidanceSettings
    sphere_m: float
    pads_m: float

    def speed_m_s(self) -> float:
        return self.random.uniform(self.settings.speed_min_m_s, self.settings.speed_max_m_s)

    def height_m(self, above_m: float = 0.0) -> float:
        return self.random.uniform(self.settings.height_min_m + above_m, self.settings.height_max_m)

    def half_lengths_m(self) -> Array:
        return self.random.uniform(self.settings.half_length_min_m, self.settings.half_length_max_m, 2)

    def course(self) -> tuple[Array, Array]:
        """(2,) unit vector of a random course, and (2,) unit vector to its right."""
        return _along(self.random.uniform(-pi, pi))


def draw_world(
    random: np.random.Generator,
    settings: RandomObstacles,
    avoidance: AvoidanceSettings,
    sphere_m: float,
    pads_m: float = 0.0,
) -> ObstacleWorld:
    """The world of a formation with that radius; `pads_m`: of the farthest pad from the middle of all."""
    worlds = {"one": _one_in_the_way, "on-orbit": _one_on_the_orbit, "many": _many}
    worlds |= {"closing": _closing, "surround": _surround, "walls": _walled, "closed": _walled, "held": _held}
    worlds |= {"sliding": _sliding, "home": _between_home, "home-closed": _between_home}
    return worlds[settings.kind](_Draw(random, settings, avoidance, sphere_m, pads_m))


def _between_home(draw: _Draw) -> ObstacleWorld:
    """Boxes between the formation and its pads, or all about it."""
    shape = "closed" if draw.settings.kind == "home-closed" else str(draw.random.choice(SHAPES))
    boxes, middle_m = home_world(draw.random, shape, draw.sphere_m, draw.pads_m)
    return ObstacleWorld((0.0, 0.0), draw.speed_m_s(), boxes, (0.0,) * len(boxes), pads_m=_pair(middle_m))


def _one_in_the_way(draw: _Draw) -> ObstacleWorld:
    """One box on the sphere's straight path, and a target behind it."""
    random, settings, sphere_m = draw.random, draw.settings, draw.sphere_m
    ahead, aside = draw.course()
    half_m, height_m = draw.half_lengths_m(), draw.height_m()
    size_m = float(np.hypot(*half_m)) + draw.avoidance.margin_m
    spare_m = random.uniform(0.0, 20.0)
    before_m = sphere_m + settings.stopping_m + 1.5 * size_m + spare_m
    aside_m = random.uniform(-1.0, 1.0) * (0.7 * sphere_m + half_m.min())
    place_m = before_m * ahead + aside_m * aside
    behind_m = 1.5 * size_m + sphere_m + settings.beyond_m + random.uniform(0.0, 15.0)
    target_m, speed_m_s = (before_m + behind_m) * ahead, draw.speed_m_s()
    sudden = random.random() < settings.sudden_share
    appears_s = random.uniform(0.0, spare_m / speed_m_s) if sudden else 0.0
    box = _box("box 1", place_m, half_m, height_m)
    return ObstacleWorld(_pair(target_m), speed_m_s, (box,), (appears_s,))


def _one_on_the_orbit(draw: _Draw) -> ObstacleWorld:
    """One box on the orbit of the centre, which begins at angle 0."""
    random, settings = draw.random, draw.settings
    turn_rad = random.uniform(0.5 * pi, 1.5 * pi)
    off_m = settings.orbit_radius_m + random.uniform(-4.0, 4.0)
    half_m, height_m, speed_m_s = draw.half_lengths_m(), draw.height_m(draw.sphere_m), draw.speed_m_s()
    place_m = off_m * np.array([cos(turn_rad), sin(turn_rad)])
    box = _box("box 1", place_m, half_m, height_m)
    return ObstacleWorld((0.0, 0.0), speed_m_s, (box,), (0.0,), settings.orbit_radius_m)


def _many(draw: _Draw) -> ObstacleWorld:
    """Many boxes between start and target: some overlap, some move, and all leave a passage."""
    random, settings = draw.random, draw.settings
    ahead, aside = draw.course()
    target_m, speed_m_s = settings.length_m * ahead, draw.speed_m_s()
    boxes: list[Obstacle] = []
    desired = int(random.integers(1, settings.boxes_max + 1))
    for _ in range(BOX_TRIES):
        if len(boxes) == desired:
            break
        place_m = random.uniform(0.0, settings.length_m) * ahead + random.uniform(-30.0, 30.0) * aside
        box = _somewhere(draw, place_m, speed_m_s, f"box {len(boxes) + 1}")
        clear = _clear_of_ends(box, draw, target_m)
        if clear and all(_leaves_passage(box, other, settings.passage_m) for other in boxes):
            boxes.append(box)
    late_s = random.uniform(0.0, settings.sudden_until_s, len(boxes))
    sudden = random.random(len(boxes)) < settings.sudden_share
    appear_s = tuple(np.where(sudden, late_s, 0.0).tolist())
    return ObstacleWorld(_pair(target_m), speed_m_s, tuple(boxes), appear_s)


CELL_M, MOVED_S = 3.0, 2.0
GRID_M = np.arange(-120.0, 120.0 + CELL_M, CELL_M)
"""Grid and step of the search for a way out between moving boxes: 1.5 m/s, less than any centre flies."""


def _closing(draw: _Draw) -> ObstacleWorld:
    """Two or three boxes that drive at a standing formation from all sides, and leave a way out."""
    random, settings = draw.random, draw.settings
    for _ in range(BOX_TRIES):
        boxes = []
        for index in range(int(random.integers(2, 4))):
            ahead, aside = draw.course()
            place_m = settings.closing_from_m * ahead + random.uniform(-10.0, 10.0) * aside
            half_m = np.array([random.uniform(2.0, 6.0), random.uniform(6.0, 15.0)])
            velocity_m_s = -random.uniform(0.6, settings.closing_max_m_s) * ahead
            along_x = abs(ahead[0]) > abs(ahead[1])  # the long side ahead, as far as the axes allow
            half_m = half_m if along_x else half_m[::-1]
            boxes.append(_box(f"box {index + 1}", place_m, half_m, 60.0, _pair(velocity_m_s)))
        if _escapes(boxes, draw.avoidance.margin_m + draw.sphere_m):
            return ObstacleWorld((0.0, 0.0), draw.speed_m_s(), tuple(boxes), (0.0,) * len(boxes))
    raise ConfigError("no boxes found that leave a way out")


def _surround(draw: _Draw) -> ObstacleWorld:
    """Three to six boxes that drive at a standing formation from all sides. Each vehicle has a way out."""
    random, sphere_m = draw.random, draw.sphere_m
    for _ in range(BOX_TRIES):
        count, first_rad = int(random.integers(3, 7)), random.uniform(-pi, pi)
        boxes = []
        for index in range(count):
            course_rad = first_rad + 2.0 * pi * (index + random.uniform(-0.3, 0.3)) / count
            ahead, aside = _along(course_rad)
            half_m, speed_m_s = random.uniform(2.5, 15.0, 2), random.uniform(0.5, 2.0)
            until_m = speed_m_s * random.uniform(5.0, 60.0)  # its way until it reaches the sphere
            deep_m = float(np.abs(ahead) @ half_m)
            place_m = (sphere_m + deep_m + until_m) * ahead + random.uniform(-0.5, 0.5) * sphere_m * aside
            velocity_m_s = _pair(-speed_m_s * ahead)
            height_m = random.uniform(20.0, 60.0)
            boxes.append(_box(f"box {index + 1}", place_m, half_m, height_m, velocity_m_s))
        start_m = np.hypot(*np.meshgrid(GRID_M, GRID_M, indexing="ij"))
        if _escaping(boxes, draw.avoidance.margin_m)[start_m < sphere_m].all():
            return ObstacleWorld((0.0, 0.0), draw.speed_m_s(), tuple(boxes), (0.0,) * count)
    raise ConfigError("no boxes found that leave each vehicle a way out")


def _escapes(boxes: list[Obstacle], clear_m: float) -> bool:
    """Whether a centre that starts at the origin can keep `clear_m` from all boxes at 1.5 m/s."""
    middle = len(GRID_M) // 2
    return bool(_escaping(boxes, clear_m)[middle, middle])


def _escaping(boxes: list[Obstacle], clear_m: float) -> Array:
    """(cells, cells) of the grid: from which a centre can keep `clear_m` from all boxes at 1.5 m/s."""
    x_m, y_m = np.meshgrid(GRID_M, GRID_M, indexing="ij")
    kept = np.ones(x_m.shape, dtype=bool)
    for time_s in np.arange(MOMENTS_S[-1] - MOVED_S, -MOVED_S, -MOVED_S):
        wider = kept.copy()
        for axis in (0, 1):
            wider |= np.roll(kept, 1, axis) | np.roll(kept, -1, axis)
        for box in boxes:
            box_x_m, box_y_m = box.position_m(float(time_s))
            inside_x = np.abs(x_m - box_x_m) < box.half_length_x_m + clear_m
            wider &= ~(inside_x & (np.abs(y_m - box_y_m) < box.half_length_y_m + clear_m))
        kept = wider
    return kept


def _walled(draw: _Draw) -> ObstacleWorld:
    """A U, an L, a spiral, or a closed ring of walls between start and target, turned at random.

    Passages are wide enough for the sphere and its margins.
    """
    random, settings, sphere_m = draw.random, draw.settings, draw.sphere_m
    thick_m = random.uniform(2.0, 8.0)
    clear_m = sphere_m + draw.avoidance.margin_m + draw.avoidance.near_m
    width_m = 2.0 * clear_m + thick_m + random.uniform(4.0, 20.0)
    closed = settings.kind == "closed"
    shape = "ring" if closed else random.choice(["U inside", "U into", "U past", "L", "spiral"])
    turns = {"L": "NE", "spiral": "ENWSE"}.get(shape, "NESW" if closed else "NES")
    deep_m = width_m * (1.0 if shape in {"spiral", "ring"} else random.uniform(1.0, 2.0))
    lengths = [width_m * (1 + k // 2) if shape == "spiral" else deep_m for k in range(len(turns))]
    corner_m = -np.array([1.0, 1.0]) * (width_m if shape == "spiral" else deep_m) / 2.0
    walls = _walls(corner_m, turns, lengths, thick_m)
    beyond_m = deep_m / 2.0 + 2.0 * sphere_m + thick_m + settings.beyond_m + random.uniform(5.0, 25.0)
    start_m = {
        "U past": np.array([0.0, -beyond_m - sphere_m]),
        "U into": np.array([random.uniform(-20.0, 20.0), beyond_m]),
    }.get(shape, np.zeros(2))
    target_m = np.array([random.uniform(-10.0, 10.0), beyond_m])
    if shape == "U into":
        target_m = np.zeros(2)
    if shape == "spiral":
        target_m = np.array([random.uniform(-width_m, width_m), 2.0 * width_m + beyond_m])
    quarter, mirror = int(random.integers(0, 4)), float(random.choice([-1.0, 1.0]))
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), quarter) * (1.0, mirror)
    height_m = random.uniform(35.0, 60.0)
    boxes: list[Obstacle] = []
    for low_m, high_m in walls:
        ends_m = np.array([turn @ (low_m - start_m), turn @ (high_m - start_m)])
        half_m = np.abs(ends_m[1] - ends_m[0]) / 2.0
        boxes.append(_box(f"wall {len(boxes) + 1}", ends_m.mean(axis=0), half_m, height_m))
    there_m = turn @ (target_m - start_m)
    return ObstacleWorld(_pair(there_m), draw.speed_m_s(), tuple(boxes), (0.0,) * len(boxes))


def _walls(corner_m: Array, turns: str, lengths_m: list[float], thick_m: float) -> list[tuple[Array, Array]]:
    """Lowest and highest corners of overlapping walls along a path from `corner_m` to N, E, S and W."""
    way = {"N": (0.0, 1.0), "E": (1.0, 0.0), "S": (0.0, -1.0), "W": (-1.0, 0.0)}
    walls, here_m = [], corner_m
    for heading, length_m in zip(turns, lengths_m, strict=True):
        there_m = here_m + length_m * np.array(way[heading])
        ends_m = np.array([here_m, there_m])
        walls.append((ends_m.min(axis=0) - thick_m / 2.0, ends_m.max(axis=0) + thick_m / 2.0))
        here_m = there_m
    return walls


def _held(draw: _Draw) -> ObstacleWorld:
    """A target inside a box, or in a ring that the sphere does not fit into; boxes may overlap."""
    random, settings, sphere_m = draw.random, draw.settings, draw.sphere_m
    ahead, aside = draw.course()
    height_m, boxes = random.uniform(35.0, 60.0), list[Obstacle]()
    if random.random() < 0.5:
        halls = [random.uniform(4.0, 15.0, 2) for _ in range(int(random.integers(1, 4)))]
        places_m = [np.zeros(2), *(random.uniform(-1.0, 1.0, 2) * halls[0] for _ in halls[1:])]
        boxes += [_box(f"hall {k + 1}", places_m[k], half_m, height_m) for k, half_m in enumerate(halls)]
        inside_m = random.uniform(-0.9, 0.9, 2) * halls[0]
    else:
        thick_m, width_m = random.uniform(2.0, 5.0), random.uniform(0.5, 1.8) * sphere_m
        corner_m, door_m = (
            -np.ones(2) * width_m / 2.0,
            random.choice([0.0, random.uniform(1.0, 0.8 * width_m)]),
        )
        for low_m, high_m in _walls(corner_m, "NESW", [width_m] * 3 + [width_m - door_m], thick_m):
            boxes.append(
                _box(f"wall {len(boxes) + 1}", (low_m + high_m) / 2.0, (high_m - low_m) / 2.0, height_m)
            )
        inside_m = random.uniform(-0.4, 0.4, 2) * (width_m - thick_m)
    widest_m = max(float(np.hypot(box.half_length_x_m, box.half_length_y_m)) for box in boxes)
    far_m = 3.0 * widest_m + sphere_m + settings.stopping_m + random.uniform(0.0, 20.0)
    place_m = far_m * ahead + random.uniform(-10.0, 10.0) * aside
    moved = [replace(box, x_m=box.x_m + place_m[0], y_m=box.y_m + place_m[1]) for box in boxes]
    return ObstacleWorld(_pair(place_m + inside_m), draw.speed_m_s(), tuple(moved), (0.0,) * len(moved))


def _sliding(draw: _Draw) -> ObstacleWorld:
    """A target in a ring of walls with a doorway that the sphere fits through, and a box that slides past it.

    The box stands in the doorway at first, or comes before it does.
    """
    random, settings, sphere_m = draw.random, draw.settings, draw.sphere_m
    clear_m = sphere_m + draw.avoidance.margin_m + draw.avoidance.near_m
    thick_m, gap_m = random.uniform(2.0, 5.0), 2.0 * clear_m + random.uniform(2.0, 12.0)
    width_m, slides_m_s = gap_m + 2.0 * clear_m + random.uniform(0.0, 20.0), random.uniform(0.3, 1.0)
    half_m, post_m, height_m = width_m / 2.0, (width_m - gap_m) / 4.0, random.uniform(35.0, 60.0)
    walls = [((0.0, half_m), (half_m, thick_m / 2.0)), ((0.0, -half_m), (half_m, thick_m / 2.0))]
    walls += [((half_m, 0.0), (thick_m / 2.0, half_m))]
    walls += [((-half_m, side * (half_m - post_m)), (thick_m / 2.0, post_m)) for side in (-1.0, 1.0)]
    side, late_s = float(random.choice([-1.0, 1.0])), float(random.choice([0.0, random.uniform(5.0, 20.0)]))
    slides = ((-half_m, -side * slides_m_s * late_s), (thick_m / 2.0, gap_m / 2.0 + 1.0))
    ahead, _ = draw.course()
    away_m = 1.5 * width_m + sphere_m + settings.stopping_m + random.uniform(0.0, 20.0)
    place_m = np.array([away_m, 0.0]) if ahead[0] > 0.0 else np.array([-away_m, 0.0])
    boxes = [
        _box(f"wall {number}", place_m + at_m, np.array(size_m), height_m)
        for number, (at_m, size_m) in enumerate(walls, 1)
    ]
    boxes.append(_box("panel", place_m + slides[0], np.array(slides[1]), height_m, (0.0, side * slides_m_s)))
    target_m = place_m + random.uniform(-2.0, 2.0, 2)
    return ObstacleWorld(_pair(target_m), draw.speed_m_s(), tuple(boxes), (0.0,) * len(boxes))


def _along(course_rad: float) -> tuple[Array, Array]:
    """(2,) unit vector of a course, and (2,) unit vector to its right."""
    ahead, aside = (cos(course_rad), sin(course_rad)), (-sin(course_rad), cos(course_rad))
    return np.array(ahead), np.array(aside)


def _pair(vector: Array) -> tuple[float, float]:
    return float(vector[0]), float(vector[1])


def _box(
    name: str, place_m: Array, half_m: Array, height_m: float, velocity_m_s: tuple[float, float] = (0.0, 0.0)
) -> Obstacle:
    place, half = place_m.tolist(), half_m.tolist()
    return Obstacle(name, place[0], place[1], half[0], half[1], float(height_m), *velocity_m_s)


def _somewhere(draw: _Draw, place_m: Array, speed_m_s: float, name: str) -> Obstacle:
    random, half_m, height_m = draw.random, draw.half_lengths_m(), draw.height_m()
    moves = random.random() < draw.settings.moving_share
    fast_m_s = random.uniform(0.2, 0.5) * speed_m_s if moves else 0.0
    way_rad = random.uniform(-pi, pi)
    return _box(name, place_m, half_m, height_m, (fast_m_s * cos(way_rad), fast_m_s * sin(way_rad)))


def _clear_of_ends(box: Obstacle, draw: _Draw, target_m: Array) -> bool:
    """Whether a box is never near the sphere at the target, nor near the start at the beginning."""
    settings, sphere_m = draw.settings, draw.sphere_m
    around = {"margin_m": draw.avoidance.margin_m, "headroom_m": draw.avoidance.headroom_m}
    for time_s in MOMENTS_S if box.speed_m_s else MOMENTS_S[:1]:
        ellipse = Ellipse.around(box, **around, time_s=float(time_s))
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
