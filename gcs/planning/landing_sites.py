"""Distinct landing sites, the volume that a lost vehicle may sweep, and stacked vehicles. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from gcs.formation.obstacles import Ellipse
from gcs.model.state import Array, Mask
from gcs.safety.separation import Floor

ROUNDS = 60
"""Iterations of pushing apart; the rest is searched for, because a landing must fit between two ticks."""

RINGS = np.concatenate([np.arange(13) / 4.0, 3.0 * 1.1 ** np.arange(1, 48)]).reshape(-1, 6)
"""Radii of the rings on which the nearest free site is searched, in spacings: close by, and up to 260, no
finer in radius than the directions on a ring. Six are examined at a time.
"""

TINY = 1e-6

STOP_S = 1.0
"""After it notices the loss, a vehicle stops as if it kept its last velocity for this time."""

DRIFT_S = 0.2 + 1.0 + STOP_S
"""Longest time that a vehicle without commands keeps its last velocity, with PX4's defaults: until the
watchdog ends its setpoints, until it notices (COM_OF_LOSS_T), and for its stop. Its last position is
already extrapolated by the 0.5 s after which it is not commanded any more.
"""

NEAR_HOME_M = 10.0
"""As near to home as this (RTL_MIN_DIST) PX4 may return as low as this (RTL_DESCEND_ALT)."""

SEEN_AHEAD_S = 0.5
"""Last positions are brought forward by so much (`gcs.estimation.fleet_state.FORWARD_MAX_S`)."""

ACTS_AFTER_S = 0.4
"""PX4 brakes so long after it notices the loss, as if evenly over 2 STOP_S."""

AHEAD_S = 3.0
"""In which the others leave the space that a silent vehicle can reach."""

AUTO_UP_M_S, AUTO_DOWN_M_S, AUTO_CRUISE_M_S = 3.0, 1.5, 5.0
"""PX4's defaults of MPC_Z_V_AUTO_UP, MPC_Z_V_AUTO_DN and MPC_XY_CRUISE: vehicles that fly by themselves."""

COLUMNS_APART_M = 2.6
"""Greatest distance between the columns along a drift: less than the width that each keeps free."""

OVERSHOOT_M = 1.0
"""A take-off may end this much too high."""

CLEAR_M = 3.0
"""Clearance to obstacles, as AvoidanceSettings.near_m: nearer, the ellipse would push vehicles that land."""


def distinct_sites_m(
    desired_m: Array, taken_m: Array, spacing_m: float, ellipses: Mapping[str, Ellipse]
) -> Array:
    """Return landing sites near the vehicles, no two closer than `spacing_m`, none near an obstacle.

    Moves sites that are too close apart, as little as needed, until none is. If that does not converge
    (between sites that stay), the nearest free site is taken.

    Args:
        desired_m: (n, 2) preferred sites, show frame.
        taken_m: (m, 2) sites in use or assigned; they stay.
        spacing_m: between any two.
        ellipses: obstacles with their margins; sites keep CLEAR_M to them.

    Returns: (n, 2), rows as in `desired_m`; NaN where that is NaN.
    """
    place_m = np.array(desired_m, dtype=np.float64)
    known = np.isfinite(place_m).all(axis=1)
    if not known.all():
        place_m[known] = distinct_sites_m(place_m[known], taken_m, spacing_m, ellipses)
        place_m[~known] = np.nan
        return place_m
    taken_m = taken_m.reshape(-1, 2)
    walls = _Walls.of(ellipses)
    n = len(place_m)
    # two equal positions have no direction in which to separate: a fixed, tiny spiral gives them one
    angle_rad = np.arange(n) * 2.399963
    place_m += TINY * np.arange(1, n + 1)[:, None] * np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    for _ in range(ROUNDS):
        offset_m, distance_m = _offsets(place_m, np.vstack([place_m, taken_m]))
        distance_m[np.arange(n), np.arange(n)] = np.inf
        clear_m, outward = walls.distance_m(place_m), walls.outward(place_m)
        if distance_m.min(initial=np.inf) >= spacing_m and clear_m.min(initial=np.inf) >= CLEAR_M:
            return place_m
        share = np.maximum(spacing_m * 1.01 - distance_m, 0.0) / np.maximum(distance_m, TINY / 100)
        inside_m = np.maximum(CLEAR_M + 0.1 - clear_m, 0.0)
        push_m = (offset_m * share).sum(axis=2).T + (outward * inside_m).sum(axis=2).T
        length_m = np.linalg.norm(push_m, axis=1, keepdims=True)
        place_m = place_m + push_m * np.minimum(0.5, spacing_m / 4.0 / np.maximum(length_m, TINY))
    return _nearest_free_m(place_m, taken_m, spacing_m, walls)


def open_places_m(
    pad_m: Array,
    closed: Mask,
    taken_m: Array,
    spacing_m: float,
    ellipses: Mapping[str, Ellipse],
    are_open: Callable[[Array], Mask],
) -> Array:
    """Return each vehicle's own pad, or where that is closed the nearest place that is open.

    Args:
        pad_m: (n, 3) show frame.
        closed: (n,) pads on which no vehicle can land.
        taken_m: (m, 2) other sites in use or assigned.
        spacing_m: between any two, the pads included.
        ellipses: obstacles with their margins; places keep CLEAR_M to them.
        are_open: which of (k, 3) places are open.

    Returns: (n, 3); where no place is found, the pad.
    """
    place_m, walls = np.array(pad_m, dtype=np.float64), _Walls.of(ellipses)
    for row in np.flatnonzero(closed).tolist():
        others_m = np.vstack([np.delete(place_m[:, :2], row, axis=0), taken_m.reshape(-1, 2)])
        ground_z_m = place_m[row, 2]

        def free(level_m: Array, ground_z_m: float = ground_z_m) -> Mask:
            return are_open(np.column_stack([level_m, np.full(len(level_m), ground_z_m)]))

        place_m[row, :2] = _nearest_free_m(place_m[row : row + 1, :2], others_m, spacing_m, walls, free)[0]
    return place_m


@dataclass(frozen=True, slots=True, eq=False)
class _Walls:
    """All ellipses at once: `Ellipse.distance_m` and `Ellipse.outward` for k of them."""

    center_m: Array  # (k, 2)
    semi_m: Array  # (k, 2)

    @staticmethod
    def of(ellipses: Mapping[str, Ellipse]) -> "_Walls":
        center_m = [(ellipse.x_m, ellipse.y_m) for ellipse in ellipses.values()]
        semi_m = [(ellipse.semi_x_m, ellipse.semi_y_m) for ellipse in ellipses.values()]
        return _Walls(np.array(center_m).reshape(-1, 2), np.array(semi_m).reshape(-1, 2))

    def distance_m(self, place_m: Array) -> Array:
        """(n, k) Distances of (n, 2) positions, negative inside."""
        point, slope = self._point_and_slope(place_m)
        radius = _length(point)
        distance_m: Array = np.where(
            radius > TINY, (radius - 1.0) * radius / np.maximum(slope, TINY**2), -self.semi_m.min(axis=1)
        )
        return distance_m

    def outward(self, place_m: Array) -> Array:
        """(2, n, k) Unit normals away from each ellipse; along x at its centre."""
        point, slope = self._point_and_slope(place_m)
        normal = point / self.semi_m.T[:, None] / np.maximum(slope, TINY**2)
        normal[0] += slope <= TINY**2
        return normal

    def _point_and_slope(self, place_m: Array) -> tuple[Array, Array]:
        """(2, n, k) Positions scaled so that each ellipse is the unit circle, and (n, k) the gradient."""
        point = (place_m.T[:, :, None] - self.center_m.T[:, None]) / self.semi_m.T[:, None]
        return point, _length(point / self.semi_m.T[:, None])


def _offsets(place_m: Array, other_m: Array) -> tuple[Array, Array]:
    """(2, n, m) Vectors from each of the others (m, 2) to each place (n, 2), and (n, m) their lengths."""
    offset_m = place_m.T[:, :, None] - other_m.T[:, None]
    return offset_m, _length(offset_m)


def _length(vector: Array) -> Array:
    """(n, m) Lengths of (2, n, m) vectors; many times faster than a norm along an axis."""
    length: Array = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1])
    return length


def _nearest_free_m(
    place_m: Array,
    taken_m: Array,
    spacing_m: float,
    walls: _Walls,
    are_open: Callable[[Array], Mask] | None = None,
) -> Array:
    """Return, row by row, the place itself if it is free, otherwise the nearest free place."""
    turn_rad = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    circle = np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=1)
    around_m = [(spacing_m * rings[:, None, None] * circle).reshape(-1, 2) for rings in RINGS]
    found_m = np.array(place_m)
    for row, desired_m in enumerate(place_m):
        settled_m = np.vstack([found_m[:row], taken_m])
        away_m = _length((settled_m - desired_m).T)
        for offset_m in (np.zeros((1, 2)), *around_m):
            candidate_m = desired_m + offset_m
            candidate_m = candidate_m[walls.distance_m(candidate_m).min(axis=1, initial=np.inf) >= CLEAR_M]
            beside_m = settled_m[away_m <= _length(offset_m.T).max() + spacing_m]
            apart_m = _offsets(candidate_m, beside_m)[1].min(axis=1, initial=np.inf)
            candidate_m = candidate_m[apart_m >= spacing_m]
            if are_open is not None and len(candidate_m):
                candidate_m = candidate_m[are_open(candidate_m)]
            if len(candidate_m):
                found_m[row] = candidate_m[0]
                break
    return found_m


def return_heights_m(count: int, lowest_m: float, layer_m: float, highest_m: float) -> Array:
    """(n,) heights above home at which vehicles return by themselves, RTL_RETURN_ALT.

    The first vehicle in the list returns lowest, the last highest. In most of a sphere the vehicles of the
    outer pads fly above the others: listed last, they return above them, and none climbs through another's
    height (decision 0041). Neighbours in the list share a height where there are more vehicles than layers.

    Args:
        count: n vehicles.
        lowest_m: the lowest of the heights.
        layer_m: between two layers; 0: all return at the same height.
        highest_m: no layer is above; 0 or more.
    """
    room = int((highest_m - lowest_m) / layer_m + 1e-9) if layer_m and highest_m > lowest_m else 0
    layers = max(1, min(count, room + 1))
    layer = np.arange(count) * layers // max(count, 1)
    heights_m: Array = lowest_m + layer_m * layer.astype(np.float64)
    return heights_m


def swept_segments_m(
    last_m: Array,
    last_velocity_m_s: Array | None,
    home_m: Array | None,
    action: str,
    return_height_m: float,
    *,
    climbing_to_m: float | None = None,
    drift_s: float = DRIFT_S,
) -> Array:
    """Return the straight segments that a vehicle may fly by itself without commands.

    It keeps its last velocity for at most `drift_s`, stops somewhere on that path, and executes `action` from
    there. Columns stand at both ends, and between them so close that no vehicle can pass through.

    Args:
        last_m: (3,) last known position, show frame.
        last_velocity_m_s: (3,) last known velocity; None if unknown.
        home_m: (3,) its own start, if known.
        action: "descend" and "land": straight down; "hold": stays, and may come down later; "return":
            climbs to `return_height_m`, or near home less high (NEAR_HOME_M), flies home at that height and
            descends there.
        return_height_m: above its home (RTL_RETURN_ALT).
        climbing_to_m: above its home; a vehicle last seen lower may still climb to it (a take-off goes on
            without this service). None: it does not climb by itself.
        drift_s: see DRIFT_S.

    Returns: (m, 2, 3).
    """
    stops_m = _stops_m(last_m, last_velocity_m_s, drift_s)
    stops_m[:, 2] = stops_m[:, 2].min()
    lowest_z_m = max(0.0, float(last_m[2]))
    columns = [np.array([stop_m, (stop_m[0], stop_m[1], lowest_z_m)]) for stop_m in stops_m]
    paths = [np.array([stops_m[0], stops_m[-1]])] if len(stops_m) > 1 else []
    if climbing_to_m is not None and home_m is not None and home_m[2] - last_m[2] < climbing_to_m:
        top_m = home_m - (0.0, 0.0, climbing_to_m + OVERSHOOT_M)
        columns.append(np.array([top_m, home_m]))
    if action != "return" or home_m is None:
        return np.array([*columns, *paths])
    top_z_m = min(float(stops_m[0, 2]), float(home_m[2]) - return_height_m)
    for stop_m in stops_m:
        away_m = float(np.hypot(*(stop_m - home_m)[:2]))
        least_m = NEAR_HOME_M if away_m <= NEAR_HOME_M else return_height_m
        corner = np.array([stop_m[0], stop_m[1], top_z_m])
        paths.append(np.array([stop_m, corner]))
        levels_m = sorted({top_z_m, min(float(stop_m[2]), float(home_m[2]) - least_m)})
        paths += [np.array([(*stop_m[:2], z_m), (*home_m[:2], z_m)]) for z_m in levels_m]
    return np.array([*columns, *paths, np.array([(home_m[0], home_m[1], top_z_m), home_m])])


def _stops_m(last_m: Array, last_velocity_m_s: Array | None, drift_s: float) -> Array:
    """(k, 3) places along the drift, COLUMNS_APART_M apart at most; k is 1 without a level drift.

    The last place is that of the whole drift also where it only leads up or down.
    """
    drift_m = np.zeros(3) if last_velocity_m_s is None else last_velocity_m_s * drift_s
    if not np.isfinite(drift_m).all():
        drift_m = np.zeros(3)
    steps = ceil(float(np.hypot(drift_m[0], drift_m[1])) / COLUMNS_APART_M)
    stops_m: Array = last_m + np.linspace(0.0, 1.0, steps + 1)[:, None] * drift_m
    if not steps:
        stops_m[0, 2] = min(float(last_m[2]), float(last_m[2] + drift_m[2]))
    return stops_m


def expected_drift(
    last_m: Array, last_velocity_m_s: Array, silent_s: Array, rows: Mask, *, noticed_s: float
) -> tuple[Array, Array]:
    """Return where vehicles that fell silent a few seconds ago are expected, and how fast; NaN elsewhere.

    They keep their last velocity; ACTS_AFTER_S after they notice the loss they brake, evenly over 2 STOP_S.
    The others keep clear of this estimate, too, until STOP_S after that: it moves as they do.

    Args:
        last_m: (n, 3) last known positions, brought forward by SEEN_AHEAD_S at most.
        last_velocity_m_s: (n, 3) last known velocities.
        silent_s: (n,) since the newest position; inf: unknown.
        rows: (n,) that are silent or lost.
        noticed_s: after this silence the vehicles act (COM_OF_LOSS_T).

    Returns: (n, 3) positions and (n, 3) velocities, show frame.
    """
    acts_s, braking_s = noticed_s + ACTS_AFTER_S, 2.0 * STOP_S
    drifts = rows & (silent_s < acts_s + braking_s + STOP_S)
    since_s = np.where(drifts, silent_s, np.nan)
    brakes_s = np.clip(since_s - acts_s, 0.0, braking_s)
    flown_s = np.minimum(since_s, acts_s) + brakes_s - brakes_s**2 / (2.0 * braking_s)
    flown_s -= np.minimum(since_s, SEEN_AHEAD_S)
    velocity_m_s = last_velocity_m_s * (1.0 - brakes_s / braking_s)[:, None]
    return last_m + last_velocity_m_s * flown_s[:, None], velocity_m_s


def silent_segments_m(
    last_m: Array,
    last_velocity_m_s: Array | None,
    home_m: Array | None,
    action: str,
    return_height_m: float,
    *,
    silent_s: float,
    noticed_s: float,
    drift_s: float = DRIFT_S,
) -> Array:
    """Return the part of `swept_segments_m` that a silent vehicle, not lost yet, can reach within AHEAD_S.

    A silence may end: only what the others could no longer avoid later is closed to them. It grows. Before
    the vehicle can have noticed the silence it flies on: `expected_drift` keeps the others apart from it.

    Args:
        last_m: as for `swept_segments_m`, and so are the next four.
        last_velocity_m_s: see there.
        home_m: see there.
        action: see there; "hold" only drifts.
        return_height_m: see there.
        silent_s: since the newest position.
        noticed_s: after this silence, at the earliest, the vehicle executes `action` (COM_OF_LOSS_T).
        drift_s: see DRIFT_S.

    Returns: (m, 2, 3).
    """
    acts_s = max(silent_s + AHEAD_S - noticed_s, 0.0)
    surely_s = min(max(noticed_s - SEEN_AHEAD_S, 0.0) + STOP_S / 2.0, drift_s)  # half of its usual stop
    moves_m_s = np.zeros(3) if last_velocity_m_s is None else last_velocity_m_s
    surely_m = np.where(np.isfinite(moves_m_s).all(), moves_m_s * surely_s, 0.0)
    stops_m = _stops_m(last_m + surely_m, last_velocity_m_s, drift_s - surely_s)
    to_climb_m = np.inf if home_m is None else max(float(stops_m[0, 2] - home_m[2]) + return_height_m, 0.0)
    up_m = min(AUTO_UP_M_S * acts_s, to_climb_m) if action == "return" else 0.0
    down_m = AUTO_DOWN_M_S * acts_s if action in {"land", "descend"} else 0.0
    top_m, bottom_m = stops_m.copy(), stops_m.copy()
    top_m[:, 2], bottom_m[:, 2] = stops_m[:, 2].min() - up_m, stops_m[:, 2].max() + down_m
    pieces = [np.stack([top_m, bottom_m], axis=1), np.stack([stops_m[:-1], stops_m[1:]], axis=1)]
    if action == "return" and home_m is not None:
        level_m = np.vstack([last_m, stops_m])  # near home it may return without a climb
        level_m = level_m[np.hypot(*(home_m - level_m)[:, :2].T) <= NEAR_HOME_M]
        begun_m = np.concatenate([level_m, top_m[: len(top_m) if up_m == to_climb_m else 0]])
        way_m = home_m[:2] - begun_m[:, :2]
        share = np.minimum(AUTO_CRUISE_M_S * acts_s / np.maximum(np.hypot(*way_m.T), TINY), 1.0)
        reached_m = begun_m.copy()
        reached_m[:, :2] += share[:, None] * way_m
        pieces.append(np.stack([begun_m, reached_m], axis=1))
    return np.concatenate(pieces)


TURNS = 200
NAMED_MAX = 10


def column_m(floor: Floor, uncertainty_m: Array | None = None) -> float:
    """Width of the column that a descending vehicle keeps free; `uncertainty_m` as of `Floor.widest_m`."""
    return floor.kept_m(floor.worst_reserve_m(uncertainty_m))[0]


def overlapping(position_m: Array, width_m: float) -> tuple[NDArray[np.intp], Array]:
    """Return the pairs with overlapping columns.

    Args:
        position_m: (n, 3) show frame.
        width_m: of a column.

    Returns: (k, 2) upper and lower of each pair, nearest first, seen from above; and (k,) their distances,
    seen from above.
    """
    first, second = np.triu_indices(len(position_m), 1)
    apart_m = np.hypot(*(position_m[first] - position_m[second])[:, :2].T)
    found = np.flatnonzero(apart_m < width_m)
    found = found[np.argsort(apart_m[found], kind="stable")]
    first, second = first[found], second[found]
    is_upper = position_m[first, 2] <= position_m[second, 2]  # z points down
    pairs = np.column_stack([np.where(is_upper, first, second), np.where(is_upper, second, first)])
    return pairs, apart_m[found]


def most_overlapping(position_m: Array, width_m: float) -> int:
    """Return the greatest number of overlapping pairs over all orientations of the formation (n, 3).

    The law assigns no fixed slots: the shape's orientation and the vehicles' slots are not known beforehand.
    """
    first, second = np.triu_indices(len(position_m), 1)
    chord_m = position_m[first] - position_m[second]
    upward = spiral((np.arange(TURNS) + 0.5) / TURNS)  # possible orientations of a formation
    along_m = chord_m @ upward.T
    sideways_m2 = (chord_m**2).sum(axis=1)[:, None] - along_m**2
    return int((sideways_m2 < width_m**2).sum(axis=0).max(initial=0))


def spiral(z: Array) -> Array:
    """(k, 3) Unit vectors with these components along z (k,): a golden spiral; even if `z` is."""
    level, turn = np.sqrt(1.0 - z**2), np.pi * (3.0 - np.sqrt(5.0)) * np.arange(len(z))
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def describe_columns(pairs: int, rehearsed: Sequence[str] = ()) -> str:
    """Describe stacked pairs in words; empty if there are none.

    Args:
        pairs: the greatest number over all assignments of slots.
        rehearsed: the pairs of the show's check by name; others may be stacked in flight.
    """
    if not pairs and not rehearsed:
        return ""
    names = [*rehearsed[:NAMED_MAX], *(["others"] if len(rehearsed) > NAMED_MAX else [])]
    named = f" (in the show's check {', '.join(names)})" if names else ""
    return (
        f"up to {max(pairs, len(rehearsed))} pairs in the formation are stacked{named}:"
        " land now leads them apart first, and brings the lowest down first"
    )
