"""Figures of a simulated flight, computed from the true states in its record."""

from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from gcs.formation.laws.protocol import GoalShape
from gcs.formation.laws.registry import law_of
from gcs.model.state import Array, Mask
from gcs.safety.surroundings import Limits
from gcs.simulation.arrivals import ArrivalFigures, arrival
from gcs.simulation.article import ArticleFigures, article_figures
from gcs.simulation.crossing import TrafficFigures
from gcs.simulation.crossing import figures as crossing_figures
from gcs.simulation.lies import LieFigures, lie_figures
from gcs.simulation.record import (
    STEADY_S,
    THROUGH_M,
    FlightRecord,
    last_passing_tick,
    penetrations_and_clearance_m,
    rounded,
    same_side,
    shortest_path_m,
    through,
)
from gcs.simulation.reference_shapes import SEARCHED_MOST, best, best_figures, energy_and_nearest
from gcs.simulation.scenario import ArticleFlight, FormationFlight, GoalFlight, Judged, ShowFlight
from gcs.simulation.shortest_ways import travel_time_s
from gcs.simulation.site_figures import SiteFigures
from gcs.simulation.site_figures import figures as site_figures

SETTLED_ENERGY = 1.005
SETTLED_RADIUS = 0.02
ON_ORBIT_M = 0.5
REFINED = 40
"""Of all rotations that take a pair of the best configuration onto a flown pair, the closest are refined."""
BESIDE = 6
"""Rows of the best configuration that count as near a row."""
NOT_OPPOSITE = np.array([1e-6, 2e-6, 3e-6])
"""Added to a vector, so that two opposite ones span a plane."""
UNLIKE = 1e3
"""Cost on the unit sphere of matching vehicles with different charges, which must not happen."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """The formation's shape at every tick."""

    energy_ratio: Array  # (ticks,)
    nearest_ratio: Array
    radius_error_m: Array  # largest over the vehicles
    settled: Mask  # for each tick alone


def shape_over_time(record: FlightRecord) -> Shape:
    """Energy and nearest neighbours of the directions from the commanded centre, and the radii."""
    ticks = len(record.time_s)
    energy, nearest, radius_m = (np.full(ticks, np.nan) for _ in range(3))
    settled = np.zeros(ticks, dtype=bool)
    judged = record.scenario.judged
    every = round(record.scenario.world.tick_rate_hz) if record.count > SEARCHED_MOST else 1
    for tick, position_m in enumerate(record.position_m):
        rows = record.formed[tick]
        count = int(rows.sum())
        if (ticks - 1 - tick) % every and tick:  # of many vehicles once a second, as it takes long
            before = tick - 1
            energy[tick], nearest[tick], radius_m[tick] = energy[before], nearest[before], radius_m[before]
            settled[tick] = settled[before]
            continue
        if count < 2 or not np.isfinite(record.center_m[tick]).all():
            continue
        offset_m = position_m[rows].astype(np.float64) - record.center_m[tick]
        distance_m = np.linalg.norm(offset_m, axis=1)
        direction = offset_m / np.maximum(distance_m, 1e-9)[:, None]
        charges = record.charges(rows)
        here, there = energy_and_nearest(direction, np.array(charges)), best_figures(charges)
        energy[tick], nearest[tick] = here[0] / there[0], here[1] / there[1]
        radius_m[tick] = np.abs(distance_m - record.radius_m[tick]).max()
        settled[tick] = (
            energy[tick] < SETTLED_ENERGY
            and nearest[tick] >= least_nearest(judged, count)
            and radius_m[tick] <= SETTLED_RADIUS * record.radius_m[tick]
        )
    return Shape(energy, nearest, radius_m, settled)


def least_nearest(judged: Judged, count: int) -> float:
    return judged.nearest_few if count <= judged.few else judged.nearest_many


def settle_time_s(record: FlightRecord, shape: Shape) -> float | None:
    """Time from the last change until permanently settled; None: not settled at the end."""
    not_yet = np.flatnonzero(~shape.settled)
    first = int(not_yet[-1]) + 1 if len(not_yet) else 0
    if first >= len(record.time_s):
        return None
    return max(0.0, record.time_s[first] - record.changed_s)


def steady_ticks(record: FlightRecord) -> NDArray[np.intp]:
    """The ticks of the last seconds in formation."""
    formed = np.array([rows.any() for rows in record.formed])
    ticks = np.flatnonzero(formed)
    return ticks[-round(STEADY_S * record.scenario.world.tick_rate_hz) :]


def straight_line_time_s(start_m: Array, final_m: Array, sideways_m_s: float, limits: Limits) -> float:
    """Smallest possible largest time over all assignments of starts to final positions, (n, 3) each."""
    cost_s = travel_time_s(final_m[None] - start_m[:, None], sideways_m_s, limits)
    levels = np.unique(cost_s)
    low, high = 0, len(levels) - 1
    while low < high:
        middle = (low + high) // 2
        within = scipy.sparse.csr_array(cost_s <= levels[middle])
        matched = scipy.sparse.csgraph.maximum_bipartite_matching(within, perm_type="column")
        low, high = (low, middle) if (matched >= 0).all() else (middle + 1, high)
    return float(levels[low])


def shape_error_m(record: FlightRecord, ticks: NDArray[np.intp]) -> float:
    """RMS distance to the best configuration at the commanded centre, best proper rotation, over `ticks`."""
    offsets_m = [
        record.position_m[tick][record.formed[tick]].astype(np.float64) - record.center_m[tick]
        for tick in ticks
    ]
    charges = record.charges(record.formed[ticks[-1]])
    target = best(charges)
    order = _matched(offsets_m[-1] / record.radius_m[ticks[-1]], target, np.array(charges))
    squares = [
        _squared_error(offset_m, record.radius_m[tick] * target[order])
        for offset_m, tick in zip(offsets_m, ticks, strict=True)
        if len(offset_m) == len(target)
    ]
    return float(np.sqrt(np.mean(squares)))


def _rotation(from_m: Array, to_m: Array) -> Array:
    """(3, 3) proper rotation that best aligns (n, 3) points with others (Kabsch)."""
    left, _, right = np.linalg.svd(from_m.T @ to_m)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation: Array = (left @ flip @ right).T
    return rotation


def _squared_error(offset_m: Array, place_m: Array) -> float:
    turned_m = place_m @ _rotation(place_m, offset_m).T
    return float(((turned_m - offset_m) ** 2).sum(axis=1).mean())


def _frames(ahead: Array, beside: Array) -> Array:
    """(..., 3, 3) right-handed axes as columns: along `ahead` (..., 3), `beside` in the first two's plane."""
    first = ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
    third = np.cross(first, beside + NOT_OPPOSITE)
    third /= np.linalg.norm(third, axis=-1, keepdims=True)
    axes: Array = np.stack([first, np.cross(third, first), third], axis=-1)
    return axes


def _matched(points: Array, target: Array, charge: Array) -> NDArray[np.intp]:
    """Match each point with a target row of the same charge.

    Starts from the rotations that take a target row and one near it onto the first point and its nearest.
    """
    unlike = UNLIKE * (charge[:, None] != charge[None])

    def costs(turn: Array) -> Array:
        squares: Array = ((points[:, None] - (target @ turn.T)[None]) ** 2).sum(axis=2) + unlike
        return squares

    nearest = np.argsort(((points - points[0]) ** 2).sum(axis=1))[:2][-1]
    beside = np.argsort(((target[:, None] - target[None]) ** 2).sum(axis=2), axis=1)[:, 1 : BESIDE + 1]
    row = np.repeat(np.arange(len(target)), beside.shape[1])
    own = _frames(points[0], points[nearest])
    turns = own @ _frames(target[row], target[beside.ravel()]).transpose(0, 2, 1)
    least, best = np.inf, np.arange(len(points))
    for k in np.argsort([costs(turn).min(axis=1).sum() for turn in turns])[:REFINED]:
        turn = turns[k]
        for _ in range(20):
            order = scipy.optimize.linear_sum_assignment(costs(turn))[1]
            better = _rotation(target[order], points)
            if np.abs(better - turn).max() < 1e-6:
                break
            turn = better
        error = _squared_error(points, target[order])
        if error < least:
            least, best = error, order
    return best


@dataclass(frozen=True, slots=True)
class SeparationFigures:
    """How near vehicles came to each other, in the floor's metric."""

    floor_m: float
    minimum_m: float | None
    violations: int  # pairs of vehicles below the floor
    lost_pairs: int  # of two lost vehicles, which no station can part: they are no violations


def separation(record: FlightRecord) -> SeparationFigures:
    lost_pairs = len([pair for pair in record.violating if record.lost_rows.issuperset(pair)])
    return SeparationFigures(
        record.floor_m, rounded(min(record.closest_m)), len(record.violating) - lost_pairs, lost_pairs
    )


@dataclass(frozen=True, slots=True)
class FormationFigures:
    """The shape at the end, and how long it took. None: it does not apply, or never was."""

    settled: bool | None = None
    settle_time_s: float | None = None  # from the last change until it lastingly stands
    straight_line_time_s: float | None = None  # the least possible, straight to the final places
    radius_error_m: float | None = None  # of the worst vehicle
    radius_share: float | None = None  # the same over the radius
    energy_ratio: float | None = None  # of the charges, over that of the best known shape
    nearest_ratio: float | None = None  # likewise the least distance
    shape_error_m: float | None = None  # rms distance from the best known shape
    rest_m_s: float | None = None  # rms speed relative to the centre
    spread_again_s: float | None = None  # after a vehicle was carried and let go


def formation(record: FlightRecord, shape: Shape) -> FormationFigures:
    flight = record.scenario.flight
    ticks = steady_ticks(record)
    if isinstance(flight, GoalFlight | ShowFlight) or len(ticks) == 0:
        return FormationFigures()
    stays = isinstance(flight, ArticleFlight) or flight.ending == "none"
    settle_s = settle_time_s(record, shape) if stays else _settled_once_s(record, shape)
    rows = record.formed[ticks[-1]]
    change = int(np.searchsorted(record.time_s, record.changed_s - 1e-9)) if stays else 0
    straight_s = shape_m = None
    if (
        rows.sum() <= SEARCHED_MOST
    ):  # of more vehicles no best shape is known, and all assignments are too many
        shape_m = shape_error_m(record, ticks)
        straight_s = straight_line_time_s(
            record.position_m[change][rows] - _centered(record, change),
            record.position_m[ticks[-1]][rows] - _centered(record, int(ticks[-1])),
            record.scenario.control.law.speed_m_s,
            record.scenario.control.safety.limits,
        )
    whole = [t for t in ticks if record.formed[t].sum() == rows.sum()]
    offset_m = [record.position_m[t][record.formed[t]] - record.center_m[t] for t in whole]
    goal = goal_of(record)
    off_m = [off_shape_m(goal, each_m, record.radius_m[t]) for t, each_m in zip(whole, offset_m, strict=True)]
    radius_error_m = float(np.mean(off_m, axis=0).max())
    if goal is not GoalShape.SPHERE:
        return FormationFigures(
            radius_error_m=rounded(radius_error_m),
            radius_share=rounded(radius_error_m / record.radius_m[ticks[-1]], 5),
            rest_m_s=rounded(_moving_m_s(record, ticks)),
        )
    return FormationFigures(
        settled=settle_s is not None,
        settle_time_s=rounded(settle_s),
        straight_line_time_s=None if isinstance(flight, ArticleFlight) else rounded(straight_s),
        radius_error_m=rounded(radius_error_m),
        radius_share=rounded(radius_error_m / record.radius_m[ticks[-1]], 5),
        energy_ratio=rounded(float(shape.energy_ratio[ticks].mean()), 6),
        nearest_ratio=rounded(float(shape.nearest_ratio[ticks].mean()), 4),
        shape_error_m=rounded(shape_m),
        rest_m_s=rounded(_moving_m_s(record, ticks)),
        spread_again_s=rounded(_spread_again_s(record, shape)),
    )


def off_shape_m(goal: GoalShape, offset_m: Array, radius_m: float) -> Array:
    """(n,) distances of vehicles at (n, 3) from the centre from the shape; NaN for other shapes."""
    if goal is GoalShape.SPHERE:
        off_m: Array = np.abs(np.linalg.norm(offset_m, axis=1) - radius_m)
    elif goal is GoalShape.RING:
        level_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
        off_m = np.hypot(level_m - max(radius_m, float(level_m.mean())), offset_m[:, 2])
    else:
        off_m = np.full(len(offset_m), np.nan)
    return off_m


def goal_of(record: FlightRecord) -> GoalShape:
    """The shape in which the law of a flight ends."""
    flight = record.scenario.flight
    return law_of(flight.law).goal_shape if isinstance(flight, FormationFlight) else GoalShape.SPHERE


def _centered(record: FlightRecord, tick: int) -> Array:
    """(3,) displacement of the commanded centre since the first tick; 0 without a centre."""
    begin_m, here_m = record.center_m[0], record.center_m[tick]
    return np.where(np.isfinite(here_m) & np.isfinite(begin_m), here_m - begin_m, 0.0)


def _moving_m_s(record: FlightRecord, ticks: NDArray[np.intp]) -> float:
    """Root mean square of the vehicles' speeds relative to the commanded centre in these ticks."""
    rows = record.formed[ticks[-1]]
    offset_m = [record.position_m[t][rows] - _centered(record, int(t)) for t in ticks]
    velocity_m_s = np.diff(np.array(offset_m), axis=0) * record.scenario.world.tick_rate_hz
    return float(np.sqrt((velocity_m_s**2).sum(axis=2).mean())) if len(ticks) > 1 else 0.0


SPREAD_AGAIN = 0.85


def _spread_again_s(record: FlightRecord, shape: Shape) -> float | None:
    """Longest time, after a vehicle was held or let go, until the vehicles are lastingly spread again."""
    if not record.carried_s:
        return None
    ticks = np.searchsorted(record.time_s, np.array(record.carried_s) - 1e-9)
    close = shape.nearest_ratio < SPREAD_AGAIN
    took = [np.flatnonzero(close[since:until]) for since, until in pairwise(ticks.tolist())]
    return (
        max(float(each[-1] + 1) if len(each) else 0.0 for each in took) / record.scenario.world.tick_rate_hz
    )


def _settled_once_s(record: FlightRecord, shape: Shape) -> float | None:
    settled = np.flatnonzero(shape.settled)
    return record.time_s[int(settled[0])] if len(settled) else None


@dataclass(frozen=True, slots=True)
class TrackingFigures:
    """Errors of the vehicles' centroid on its orbit, of a spinning sphere, and behind an estimated target."""

    orbit_radius_error_m: float | None = None  # rms, after the first settling
    center_speed_m_s: float | None = None  # mean, likewise
    spin_radius_error_m: float | None = None  # of the worst vehicle, from the first change of the spin on
    target_median_m: float | None = None  # distance from the place at the true target: half are less,
    target_p95_m: float | None = None  # 95 % are less
    target_worst_m: float | None = None
    target_nearest_m: float | None = None  # least distance of a vehicle from the target on the ground
    center_rms_m_s2: float | None = None  # acceleration of the centre


def tracking(record: FlightRecord, shape: Shape) -> TrackingFigures:
    flight = record.scenario.flight
    figures = TrackingFigures(spin_radius_error_m=_spin_radius_error_m(record, shape))
    if isinstance(flight, FormationFlight) and flight.tracked is not None:
        figures = _behind_target(figures, record, flight, flight.tracked.from_s)
    if isinstance(flight, GoalFlight | ShowFlight) or not flight.orbit.radius_m:
        return figures
    settle_s = _on_orbit_s(record, flight)
    flown = [t for t, formed in enumerate(record.formed) if formed.any()]
    ticks = [t for t in flown if settle_s is not None and record.time_s[t] >= settle_s]
    if len(ticks) < 2:
        return figures
    centroid_m = np.array(
        [record.position_m[t][record.formed[t], :2].mean(axis=0) for t in ticks], dtype=np.float64
    )
    rho_m = np.linalg.norm(centroid_m - np.array([record.target_m[t] for t in ticks]), axis=1)
    speed_m_s = np.linalg.norm(np.diff(centroid_m, axis=0), axis=1) * record.scenario.world.tick_rate_hz
    return replace(
        figures,
        orbit_radius_error_m=rounded(float(np.sqrt(((rho_m - flight.orbit.radius_m) ** 2).mean()))),
        center_speed_m_s=rounded(float(speed_m_s.mean())),
    )


def _behind_target(
    figures: TrackingFigures, record: FlightRecord, flight: FormationFlight, from_s: float
) -> TrackingFigures:
    """Add errors of the true centroid from its place at the true target, and how hard the centre turns."""
    ticks = np.flatnonzero(np.array(record.time_s) >= from_s)
    path_m, center_m = np.array(record.position_m)[ticks], np.array(record.center_m)[ticks, :2]
    target_m = np.array(record.target_m)[ticks]
    off_m = np.linalg.norm(path_m[:, :, :2].mean(axis=1) - target_m, axis=1)
    on_ground_m = np.column_stack([target_m, np.zeros(len(target_m))])
    nearest_m = np.linalg.norm(path_m - on_ground_m[:, None], axis=2).min()
    off_m = np.abs(off_m - flight.orbit.radius_m)
    center_m_s2 = np.linalg.norm(np.diff(center_m, 2, axis=0), axis=1) * record.scenario.world.tick_rate_hz**2
    median_m, p95_m = np.percentile(off_m, [50, 95]).tolist()
    return replace(
        figures,
        target_median_m=rounded(median_m),
        target_p95_m=rounded(p95_m),
        target_worst_m=rounded(float(off_m.max())),
        target_nearest_m=rounded(float(nearest_m)),
        center_rms_m_s2=rounded(float(np.sqrt((center_m_s2**2).mean()))),
    )


def _spin_radius_error_m(record: FlightRecord, shape: Shape) -> float | None:
    """Largest distance of a vehicle from the sphere from the first change of the spin on."""
    flight = record.scenario.flight
    if not isinstance(flight, FormationFlight) or not flight.spins:
        return None
    since = int(np.searchsorted(record.time_s, flight.spins[0].from_s))
    return rounded(float(np.nanmax(shape.radius_error_m[since:])))


def _on_orbit_s(record: FlightRecord, flight: FormationFlight | ArticleFlight) -> float | None:
    """Time when the commanded centre first reaches its orbit, plus 5 s for the vehicles to settle."""
    for t, center_m in enumerate(record.center_m):
        rho_m = float(np.linalg.norm(center_m[:2] - record.target_m[t]))
        if record.time_s[t] >= flight.center_moves_from_s and abs(rho_m - flight.orbit.radius_m) < ON_ORBIT_M:
            return record.time_s[t] + STEADY_S
    return None


@dataclass(frozen=True, slots=True)
class ObstacleFigures:
    """How the vehicles passed boxes. None: there are none, or it does not apply."""

    penetrations: int | None = None  # vehicles that were inside a box grown by 1 m
    minimum_clearance_m: float | None = None
    reformed_time_s: float | None = None  # from the last passing until the shape was whole again
    same_side: bool | None = None  # whether all passed a single box on one side
    through: bool | None = None  # whether the formation is where it was to go
    away_m: float | None = None  # greatest distance of the centre from the target
    path_ratio: float | None = None  # way of the centre over the shortest
    rest_m_s: float | None = None  # greatest speed of the centre at the end
    noticed_s: float | None = None  # when an obstacle was named that keeps the centre from its target


def obstacles(record: FlightRecord, shape: Shape) -> ObstacleFigures:
    if not any(record.boxes):
        return ObstacleFigures()
    penetrations, clearance_m = penetrations_and_clearance_m(record)
    if isinstance(record.scenario.flight, GoalFlight):
        return ObstacleFigures(penetrations=penetrations, minimum_clearance_m=rounded(clearance_m))
    return ObstacleFigures(
        penetrations=penetrations,
        minimum_clearance_m=rounded(clearance_m),
        reformed_time_s=rounded(_reformed_s(record, shape)),
        same_side=same_side(record) if _single_box(record) else None,
        through=through(record),
        away_m=rounded(float(np.max(_away_m(record)))),
        path_ratio=rounded(_path_ratio(record)),
        rest_m_s=rounded(_rest_m_s(record)),
        noticed_s=rounded(_noticed_s(record)),
    )


def _away_m(record: FlightRecord) -> Array:
    """(ticks,) distance of the commanded centre from the target, over the ground."""
    away_m: Array = np.linalg.norm(np.array(record.center_m)[:, :2] - np.array(record.target_m), axis=1)
    return away_m


def _path_ratio(record: FlightRecord) -> float | None:
    """Length of the centre's path to the target, over the shortest past boxes grown by sphere and margin.

    None where boxes move, on an orbit, and when it does not arrive or starts there.
    """
    away_m, boxes = _away_m(record), record.boxes[-1]
    there = away_m < THROUGH_M
    if record.orbit_radius_m or there[0] or not there.any() or any(box.speed_m_s for box in boxes):
        return None
    steps_m = np.linalg.norm(np.diff(np.array(record.center_m), axis=0), axis=1)
    clear_m = record.radius_m[-1] + record.scenario.control.law.avoidance.margin_m
    return float(steps_m[: int(there.argmax())].sum()) / shortest_path_m(record, clear_m)


def _rest_m_s(record: FlightRecord) -> float:
    ticks = round(STEADY_S * record.scenario.world.tick_rate_hz)
    steps_m = np.diff(np.array(record.center_m[-ticks:]), axis=0)
    return float(np.linalg.norm(steps_m, axis=1).max()) * record.scenario.world.tick_rate_hz


def _noticed_s(record: FlightRecord) -> float | None:
    """When the control tick first named an obstacle that keeps the centre from its target; None: never."""
    named = [time_s for time_s, name in zip(record.time_s, record.held_by, strict=False) if name]
    return named[0] if named else None


def _single_box(record: FlightRecord) -> bool:
    boxes = record.boxes[-1]
    return len(boxes) == 1 and not boxes[0].speed_m_s and record.orbit_radius_m == 0.0


def _reformed_s(record: FlightRecord, shape: Shape) -> float | None:
    """Time from the last passing until permanently settled; None: not settled at the end."""
    last = last_passing_tick(record)
    not_yet = np.flatnonzero(~shape.settled[last:])
    first = last + (int(not_yet[-1]) + 1 if len(not_yet) else 0)
    return record.time_s[first] - record.time_s[last] if first < len(record.time_s) else None


@dataclass(frozen=True, slots=True)
class TickFigures:
    """Durations of ticks in processor time, which parallel runs do not affect."""

    p50_ms: float | None
    p99_ms: float | None


def ticks_ms(record: FlightRecord) -> TickFigures:
    took_ms = np.array(record.tick_s) * 1e3
    return TickFigures(rounded(float(np.median(took_ms))), rounded(float(np.percentile(took_ms, 99))))


@dataclass(frozen=True, slots=True)
class Lag:
    """How far one vehicle was from its trajectory while drawn parts ran."""

    vehicle: int  # of the show, from 1
    trajectory: str  # name of the file
    rms_m: float
    max_m: float
    at_s: float  # time of the show, of the largest
    cue: str


@dataclass(frozen=True, slots=True)
class TrackFigures:
    """How far the vehicles of a show were from their trajectories while drawn parts ran."""

    rms_m: float | None  # of all
    own_rms_m: float | None  # the same of where the vehicles themselves estimate to be
    own_max_m: float | None
    worst_rms_m: float | None  # of the worst vehicle
    max_m: float | None
    lags: tuple[Lag, ...]  # of each vehicle that was far off


@dataclass(frozen=True, slots=True)
class ActedFailsafe:
    """A failsafe of the service that acted."""

    time_s: float | None
    cause: str
    action: str


@dataclass(frozen=True, slots=True)
class LawFailed:
    """When a law of another package was relied on no more, and why."""

    time_s: float
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightMetrics:
    """All figures of one flight. None: a flight of this kind has no such section."""

    scenario: str
    vehicles: int
    seed: int
    duration_s: float | None
    realtime_factor: float | None  # duration over processor time
    separation: SeparationFigures
    formation: FormationFigures | None = None
    tracking: TrackingFigures | None = None
    obstacles: ObstacleFigures | None = None
    arrival: ArrivalFigures
    article: ArticleFigures | None = None
    track: TrackFigures | None = None
    tick: TickFigures
    traffic: TrafficFigures | None = None
    site: SiteFigures | None = None
    lies: LieFigures | None = None
    failsafes: tuple[ActedFailsafe, ...] | None = None
    goal_shape: str | None = None  # of a law that ends in no sphere
    law_failed: LawFailed | None = None  # when the law was relied on no more

    def figures(self) -> dict[str, object]:
        """The same as one JSON object, as `gcs simulate --json` prints it, without absent sections."""
        return {name: section for name, section in asdict(self).items() if section is not None}


def metrics(record: FlightRecord) -> FlightMetrics:
    """All figures of a flight that is not a show."""
    shape = shape_over_time(record)
    return FlightMetrics(
        **common(record, record.scenario.name),
        formation=formation(record, shape),
        tracking=tracking(record, shape),
        obstacles=obstacles(record, shape),
        arrival=arrival(record),
        article=article_figures(record),
        traffic=None if record.passages is None else crossing_figures(record.passages),
        site=site_figures(record),
        lies=None if record.liars is None else lie_figures(record.liars, record.violating),
        failsafes=tuple(ActedFailsafe(rounded(when_s), why, what) for when_s, why, what in record.failsafes)
        or None,
        goal_shape=None if goal_of(record) is GoalShape.SPHERE else goal_of(record).value,
        law_failed=None if record.law_failed is None else LawFailed(*record.law_failed),
    )


def common(record: FlightRecord, name: str) -> dict[str, Any]:
    """What every kind of flight has."""
    duration_s = record.time_s[-1] + 1.0 / record.scenario.world.tick_rate_hz
    return {
        "scenario": name,
        "vehicles": record.count,
        "seed": record.seed,
        "duration_s": rounded(duration_s),
        "realtime_factor": rounded(duration_s / max(record.busy_s, 1e-9), 1),
        "separation": separation(record),
        "tick": ticks_ms(record),
    }


def report(record: FlightRecord) -> dict[str, object]:
    return metrics(record).figures()
