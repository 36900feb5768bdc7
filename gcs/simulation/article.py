"""Section 5 of the article: its own law, parameters and virtual dynamics, instead of the real tick.

With the article's parameters it is nearly undamped (zeta = 0.025). Real flights use `gcs.formation.law`.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from math import inf, sqrt

import numpy as np

from gcs.control import Task
from gcs.formation.article import ArticleParameters
from gcs.formation.obstacles import AvoidanceSettings, Ellipse, Outlines
from gcs.formation.orbit import (
    SIDE_KEPT,
    SLOWEST_M_S,
    Center,
    advance_center,
    orbit_velocity,
    sides_taken,
)
from gcs.formation.steering import LEFT, RIGHT, contacts_m, level, steer_past, turns
from gcs.model.plan import Obstacle, Target
from gcs.model.state import Array
from gcs.safety.floor import Floor, scaled_distance_m
from gcs.simulation.article_forces import acceleration, avoiding_force, feed_forward_force, formation_force
from gcs.simulation.initial_states import obstacles_of, scattered_m
from gcs.simulation.record import FlightRecord
from gcs.simulation.scenario import ArticleFlight, Scenario

SUBSTEPS = 10
"""Steps of the virtual dynamics per tick; at 20 Hz each is 5 ms."""

JUDGED_S = 10.0
"""Edges and orbit are measured over this time at the end, which is more than one orbit."""

AWARE_M = 40.0
"""Boxes farther from the centre than this are ignored: they are out of range of the avoidance."""

VERTICES = 4
TETRAHEDRON_EDGE = sqrt(8.0 / 3.0)
"""Edge of the regular tetrahedron in the unit sphere: 1.633."""


@dataclass(slots=True, eq=False)
class VirtualFormation:
    """State of the virtual dynamics: vehicles, centre and chosen sides, in the show frame."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)
    center: Center
    sides: dict[str, float] = field(default_factory=dict)


class ArticleRun:
    """A flight of section 5; `record` is filled by `fly`."""

    def __init__(self, scenario: Scenario, flight: ArticleFlight, count: int, seed: int) -> None:
        """Raises: ConfigError when the vehicles do not fit into the start volume."""
        start_m = _start_m(flight, count, np.random.default_rng([seed, 1]))
        self._course = course = Course.of(flight, count)
        self._formation = VirtualFormation(
            start_m, np.zeros_like(start_m), Center.at_rest(np.append(course.target_m(0.0), -flight.height_m))
        )
        self._floor = floor = scenario.control.safety.floor
        nowhere_m = np.full_like(start_m, np.nan)
        self.record = FlightRecord(scenario, seed, start_m, nowhere_m, floor.horizontal_m)

    def fly(self, on_progress: Callable[[float], None] | None = None) -> FlightRecord:
        """Fly to the end. `on_progress` is called with the share that is flown."""
        record, scenario, formation = self.record, self.record.scenario, self._formation
        tick_s, ticks = 1.0 / scenario.world.tick_rate_hz, scenario.duration_s * scenario.world.tick_rate_hz
        began_s = time.process_time()
        for index in range(round(ticks)):
            now_s = index * tick_s
            _keep(record, now_s, formation, self._course)
            tick_began_s, least_m = time.thread_time(), np.inf
            for substep in range(SUBSTEPS):
                _step(formation, self._course, now_s + substep * tick_s / SUBSTEPS, tick_s / SUBSTEPS)
                least_m = min(least_m, _closest_m(formation.position_m, self._floor, record))
            record.tick_s.append((time.thread_time() - tick_began_s) / SUBSTEPS)
            record.closest_m.append(least_m)
            if on_progress is not None:
                on_progress(index / ticks)
        record.busy_s = time.process_time() - began_s
        return record


def _start_m(flight: ArticleFlight, count: int, random: np.random.Generator) -> Array:
    half_m = np.full(3, flight.start_half_m)
    start_m = scattered_m(count, -half_m, half_m, flight.spacing_m, random)
    middle_m = np.array([flight.target.x_m, flight.target.y_m, -flight.height_m])
    return np.asarray(start_m + middle_m)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Obstacles, target and charges of a flight."""

    flight: ArticleFlight
    target: Target
    boxes: tuple[Obstacle, ...]
    ellipses: dict[str, Ellipse]
    charge: Array  # (n,)

    @staticmethod
    def of(flight: ArticleFlight, count: int) -> "Course":
        boxes = obstacles_of(flight.boxes)
        avoidance = flight.avoidance
        ellipses = {
            box.id: Ellipse.around(box, margin_m=avoidance.margin_m, headroom_m=avoidance.headroom_m)
            for box in boxes
        }
        target = Target(**flight.target.model_dump())
        return Course(flight, target, boxes, ellipses, np.full(count, flight.charge))

    def target_m(self, time_s: float) -> Array:
        return np.array(self.target.position_m(time_s))

    def center_velocity_m_s(self, center_m: Array, time_s: float) -> Array:
        """(3,) velocity of the corrected tracking law for a centre at (3,), with the target's velocity."""
        if time_s < self.flight.center_moves_from_s:
            return np.zeros(3)
        orbit = self.flight.orbit
        relative_m_s = orbit_velocity(
            center_m[:2] - self.target_m(time_s),
            radius_m=orbit.radius_m,
            speed_m_s=orbit.speed_m_s,
            direction=orbit.direction,
            braking_m_s2=self.flight.center_acceleration_max_m_s2,
        )
        return np.append(relative_m_s + self.target.velocity_m_s, 0.0)


def _step(formation: VirtualFormation, course: Course, time_s: float, dt_s: float) -> None:
    flight, before = course.flight, formation.center
    away_m = (ellipse.distance_m(before.position_m[None])[0] for ellipse in course.ellipses.values())
    ellipses = course.ellipses if any(distance_m < AWARE_M for distance_m in away_m) else {}
    ahead_m = before.position_m + dt_s * before.velocity_m_s  # the field counts where the step ends
    desired_m_s, formation.sides = steer_center(
        before.position_m,
        course.center_velocity_m_s(ahead_m, time_s + dt_s),
        formation.position_m,
        ellipses,
        formation.sides,
        flight.avoidance,
        radius_m=flight.parameters.radius_m,
        way=Way(None, flight.orbit.radius_m),
    )
    center = step_center(before, desired_m_s, dt_s, flight.center_acceleration_max_m_s2)
    state, parameters = (formation.position_m, formation.velocity_m_s), flight.parameters
    force_n = formation_force(
        formation.position_m, before.position_m, course.charge, parameters
    ) + feed_forward_force(before.velocity_m_s, center.acceleration_m_s2, parameters)
    if ellipses:
        sliding_m_s = np.full(len(course.charge), np.hypot(*center.velocity_m_s[:2]))
        force_n = avoiding_force(
            *state, force_n, ellipses, formation.sides, sliding_m_s, parameters, flight.avoidance
        )
    formation.position_m, formation.velocity_m_s = step_virtual(*state, force_n, dt_s, parameters)
    formation.center = center


def _keep(record: FlightRecord, time_s: float, formation: VirtualFormation, course: Course) -> None:
    all_rows = np.ones(record.count, dtype=bool)
    record.time_s.append(time_s)
    record.position_m.append(formation.position_m.astype(np.float32))
    record.formed.append(all_rows)
    record.in_air.append(all_rows)
    record.center_m.append(formation.center.position_m)
    record.radius_m.append(course.flight.parameters.radius_m)
    record.target_m.append(course.target_m(time_s))
    record.boxes.append(course.boxes)
    record.limited.append(0)
    if record.details is not None:
        record.details.velocity_m_s.append(formation.velocity_m_s.astype(np.float32))
        record.details.setpoint_m_s.append(np.full((record.count, 3), np.nan, np.float32))
        record.details.limited_by.append(("",) * record.count)
        record.details.task.append(np.full(record.count, Task.FORMATION, np.int8))


def _closest_m(position_m: Array, floor: Floor, record: FlightRecord) -> float:
    first, second = np.triu_indices(len(position_m), 1)
    distance_m = scaled_distance_m(position_m, first, second, floor)
    near = distance_m < floor.horizontal_m
    record.violating.update(zip(first[near].tolist(), second[near].tolist(), strict=True))
    return float(distance_m.min(initial=np.inf))


@dataclass(frozen=True, slots=True)
class ArticleFigures:
    """Figures of the claims in section 5, from the true states at the end of a flight of four vehicles."""

    edge_error: float | None = None  # largest error of any edge, as a share of 1.633 r_d
    orbit_radius_error_m: float | None = None  # largest distance of the centroid from the orbit
    inside_ellipse: int | None = None  # vehicles that ever were in the article's own ellipse, at any height


def article_figures(record: FlightRecord) -> ArticleFigures:
    """The article's ellipse has half-axes of sqrt(2) times the half-lengths."""
    flight = record.scenario.flight
    if not isinstance(flight, ArticleFlight):
        return ArticleFigures()
    judged = round(JUDGED_S * record.scenario.world.tick_rate_hz)
    path_m = record.path_m
    first, second = np.triu_indices(record.count, 1)
    edge_m = np.linalg.norm(path_m[-judged:, first] - path_m[-judged:, second], axis=2)
    edge_error = np.abs(edge_m / (TETRAHEDRON_EDGE * flight.parameters.radius_m) - 1.0).max(initial=0.0)
    from_target_m = path_m[-judged:, :, :2].mean(axis=1) - np.array(record.target_m[-judged:])
    rho_m = np.hypot(from_target_m[:, 0], from_target_m[:, 1])
    inside = np.zeros(record.count, dtype=bool)
    for box in record.boxes[-1]:
        ellipse = Ellipse.around(box, margin_m=0.0, headroom_m=0.0)
        for position_m in path_m:
            inside |= ellipse.contains(position_m)
    return ArticleFigures(
        edge_error=round(float(edge_error), 5) if record.count == VERTICES else None,
        orbit_radius_error_m=round(float(np.abs(rho_m - flight.orbit.radius_m).max()), 4),
        inside_ellipse=int(inside.sum()) if flight.boxes else None,
    )


def step_center(center: Center, desired_m_s: Array, dt_s: float, acceleration_max_m_s2: float) -> Center:
    """Move the centre as `step_virtual` moves vehicles, (3,) each, within the acceleration limit.

    With the same integration and `feed_forward_force`, the vehicles' motion relative to the centre is exactly
    that about a centre at rest, however hard the centre turns.
    """
    moved = advance_center(center, desired_m_s, dt_s, acceleration_max_m_s2)
    return replace(moved, position_m=center.position_m + dt_s * moved.velocity_m_s)


def step_virtual(
    position_m: Array, velocity_m_s: Array, force_n: Array, dt_s: float, parameters: ArticleParameters
) -> tuple[Array, Array]:
    """One semi-implicit Euler step of ``M p'' = u - k p'``; all arrays (n, 3).

    Returns: position and velocity `dt_s` later.
    Source: article, section 1.
    """
    later_m_s = velocity_m_s + dt_s * acceleration(velocity_m_s, force_n, parameters)
    return position_m + dt_s * later_m_s, later_m_s


FORESEEN_S = 8.0
"""A centre at rest makes way for a moving obstacle this long in advance."""


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """What is known beforehand of the centre's path."""

    ends_m: Array | None  # (2,) where it comes to rest, if it does
    straight_m: float  # distance over which its desired velocity stays about the same


def steer_center(
    center_m: Array,
    desired_m_s: Array,
    drones_m: Array,
    ellipses: Mapping[str, Ellipse],
    sides: Mapping[str, float],
    settings: AvoidanceSettings,
    *,
    radius_m: float,
    way: Way,
) -> tuple[Array, dict[str, float]]:
    """The velocity that leads the formation's centre, and with it the whole sphere, past every obstacle.

    The ellipses are grown by as much of the sphere as is below their tops, so that no vehicle has to leave
    the shape. Where the centre is nearer already, or its destination is, they are grown less.

    Args:
        center_m: (3,) of the sphere, show frame.
        desired_m_s: (3,).
        drones_m: (n, 3) of the formation; a side is kept while one of them is near the obstacle.
        ellipses: the obstacles, margin and headroom included.
        sides: chosen so far: LEFT or RIGHT by name.
        settings: distances and rates.
        radius_m: of the sphere.
        way: the centre's path.

    Returns: (3,) in m/s, and the sides that count from now on: one for the whole formation.
    """
    if not ellipses:
        return desired_m_s, {}
    outlines = Outlines.of(ellipses)
    tall = -center_m[2] - radius_m < outlines.top_height_m
    there_m = np.full(len(outlines), inf)
    if way.ends_m is not None:  # the future position of a moving obstacle is not known
        there_m = np.where(outlines.stand, outlines.nearest_m(way.ends_m[None]), inf)
    grown = _grown(outlines, center_m, there_m, radius_m, settings)
    reach_m = _reach_m(outlines, desired_m_s, way, settings)
    waits = bool((there_m[tall] < 0.0).any())  # the destination is inside an obstacle
    keep_m_s = np.array([0.0 if waits else float(np.hypot(desired_m_s[0], desired_m_s[1]))])
    chosen_m_s, _, met = steer_past(
        grown, sides, level(center_m[None]), level(desired_m_s[None]), keep_m_s, tall[None], reach_m[None]
    )
    ahead = tall & (
        contacts_m(
            np.array(center_m), np.array(desired_m_s), grown.center_m, grown.semi_m, grown.velocity_m_s
        )
        < reach_m
    )
    near = outlines.nearest_m(drones_m) < SIDE_KEPT * settings.lookahead_m
    kept = sides_taken(grown, center_m, chosen_m_s[0], ahead) | dict(sides)
    if met[0] >= 0:
        right = turns(desired_m_s[:2], chosen_m_s[0], grown.velocity_m_s[met[0]])
        kept[grown.names[met[0]]] = RIGHT if right > 0.0 else LEFT
    counts = {name for name, counting in zip(grown.names, ahead | near, strict=True) if counting}
    return np.append(chosen_m_s[0], desired_m_s[2]), {n: side for n, side in kept.items() if n in counts}


def _grown(
    outlines: Outlines, center_m: Array, there_m: Array, radius_m: float, settings: AvoidanceSettings
) -> Outlines:
    """The ellipses grown for the sphere's centre (3,), so that its section below each top passes whole.

    No farther than to the centre itself, nor than `there_m` (m,): its destination's distance to each.
    """
    above_m = np.maximum(-center_m[2] - outlines.top_height_m, 0.0)
    section_m = np.sqrt(np.maximum(radius_m**2 - above_m**2, 0.0))
    clear_m = settings.center_clearance * section_m + settings.near_m
    possible_m = np.minimum(outlines.nearest_m(center_m[None]), there_m)
    return outlines.grown(np.clip(clear_m, 0.0, np.maximum(possible_m, 0.0)))


def _reach_m(outlines: Outlines, desired_m_s: Array, way: Way, settings: AvoidanceSettings) -> Array:
    """(m,) distance ahead of the centre from which each ellipse counts: its straight path, and the lookahead.

    A moving one also counts for FORESEEN_S when the centre arrives before, or stands.
    """
    speed_m_s = float(np.hypot(desired_m_s[0], desired_m_s[1]))
    relative_m_s = np.hypot(*(desired_m_s[:2] - outlines.velocity_m_s).T)
    foreseen_s = max(way.straight_m / max(speed_m_s, SLOWEST_M_S), FORESEEN_S)
    reach_m = np.where(outlines.stand, way.straight_m, relative_m_s * foreseen_s)
    return np.minimum(reach_m, settings.center_lookahead_m)
