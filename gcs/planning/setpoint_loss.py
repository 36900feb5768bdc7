"""Whether all vehicles stay separated if they lose this station at once, in the planned flight. Pure.

Checked before take-off: then another action can still be chosen. Each autopilot executes COM_OBL_RC_ACT by
itself, and no filter separates the vehicles. Timing is not relied on: climb and cruise speeds differ, so two
paths that come too close count at any times. Only this is relied on: two vehicles that descend alike keep
their difference in height until the lower one has landed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

import numpy as np

from gcs.control import ControlSettings
from gcs.formation.law import begun, directions_from, turned
from gcs.formation.repulsion import sweep
from gcs.model.errors import RefusedError
from gcs.model.plan import Plan
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.landing_sites import spiral
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows

Action: TypeAlias = Literal["descend", "hold", "land", "return"]

ACTIONS: Final[tuple[Action, ...]] = ("hold", "return", "land", "descend")
"""In the order in which they are proposed."""

NOTICED_WITHIN_S: Final = 0.3
"""Vehicles notice the loss at different times: by the watchdog's time, and some for their own clocks. For
this time one of a pair may keep their common velocity while the other already stops.
"""


@dataclass(frozen=True, slots=True)
class Clash:
    """Two vehicles that would violate the minimum separation."""

    first: int  # rows
    second: int
    sideways_m: float  # closest approach of their paths, seen from above


def clashes(
    position_m: Array,
    home_m: Array,
    action: Action,
    *,
    floor: Floor,
    uncertainty_m: Array,
    speed_m_s: float,
    return_height_m: Array | float,
    flies_on_s: Array | float = 0.0,
) -> list[Clash]:
    """Return all pairs that would violate the minimum, widened by both uncertainties, closest first.

    Args:
        position_m: (n, 3) positions at the loss, show frame.
        home_m: (n, 3) each vehicle's own start.
        action: of each vehicle.
        floor: without its margin, which covers the tracking that has ended.
        uncertainty_m: (n,) of each position.
        speed_m_s: common to all: the orbit's and the target's.
        return_height_m: RTL_RETURN_ALT, above home, (n,) or of all.
        flies_on_s: how long each flies on, its stop included, (n,) or all: only differences count.
    """
    first, second = np.triu_indices(len(position_m), 1)
    unsure_m = floor.reserve_m(uncertainty_m[first], uncertainty_m[second])
    on_s = np.broadcast_to(flies_on_s, len(position_m))
    wide_m = floor.horizontal_m + unsure_m
    wide_m = wide_m + speed_m_s * (NOTICED_WITHIN_S + np.abs(on_s[first] - on_s[second]))
    tall_m = floor.vertical_m + floor.vertical_uncertainty * unsure_m
    apart_m = np.hypot(*(position_m[first] - position_m[second])[:, :2].T)
    above_m = np.abs(position_m[first, 2] - position_m[second, 2])
    inside = _is_inside(apart_m, above_m, wide_m, tall_m)
    if action in {"descend", "land"}:
        # the upper one descends beside the landed lower one; below pad_height_m both are on their pads
        least_m = np.minimum(above_m, floor.pad_height_m)
        inside |= _is_inside(apart_m, least_m, wide_m, tall_m)
    elif action == "return":
        apart_m, crosses = _on_the_way_home(
            position_m, home_m, first, second, wide_m, tall_m, return_height_m
        )
        inside |= crosses
    pairs = [Clash(int(first[k]), int(second[k]), float(apart_m[k])) for k in np.flatnonzero(inside).tolist()]
    return sorted(pairs, key=lambda clash: clash.sideways_m)


def turned_upright(position_m: Array, center_m: Array) -> Array:
    """Return the formation (n, 3) turned about its centre so that the nearest two are stacked vertically.

    The law assigns no fixed slots: a formation may turn while it flies. Vertical is the worst orientation,
    because the ellipsoid is taller than wide, and a descending vehicle meets the one below.
    """
    if len(position_m) < 2:
        return position_m.copy()
    first, second = np.triu_indices(len(position_m), 1)
    chord_m = position_m[first] - position_m[second]
    chord_m = chord_m[np.argmin((chord_m**2).sum(axis=1))]
    length_m = float(np.linalg.norm(chord_m))
    if length_m == 0.0:
        return position_m.copy()
    up = np.array([0.0, 0.0, 1.0 if chord_m[2] >= 0.0 else -1.0])
    halfway = chord_m / length_m + up
    halfway /= np.linalg.norm(halfway)
    offset_m = position_m - center_m  # half a turn about the midpoint direction maps one onto the other
    turned: Array = center_m + 2.0 * np.outer(offset_m @ halfway, halfway) - offset_m
    return turned


def _is_inside(apart_m: Array, above_m: Array, wide_m: Array, tall_m: Array) -> Mask:
    inside: Mask = (apart_m / wide_m) ** 2 + (above_m / tall_m) ** 2 < 1.0
    return inside


def _on_the_way_home(
    position_m: Array,
    home_m: Array,
    first: Rows,
    second: Rows,
    wide_m: Array,
    tall_m: Array,
    return_height_m: Array | float,
) -> tuple[Array, Mask]:
    """(k,) Distance of the paths of each pair, seen from above, and whether they are too close.

    A path: up to the return height (or from a greater own height), straight home at that height, down.
    """
    height_m = np.maximum(-position_m[:, 2], return_height_m - home_m[:, 2])
    level_m = np.abs(height_m[first] - height_m[second])
    here_m, there_m = position_m[:, :2], home_m[:, :2]
    apart_m = _between_segments_m(here_m[first], there_m[first], here_m[second], there_m[second])
    crosses = _is_inside(apart_m, level_m, wide_m, tall_m)
    # a climbing or descending vehicle meets those that cruise at a height between; a path home ends above
    # its pad, so that two that descend side by side meet there as well
    for column_m, low_m in ((here_m, -position_m[:, 2]), (there_m, -home_m[:, 2])):
        for i, j in ((first, second), (second, first)):
            past_m = _from_segment_m(column_m[i], here_m[j], there_m[j])
            outside_m = np.maximum(low_m[i] - height_m[j], height_m[j] - height_m[i])
            crosses |= _is_inside(past_m, np.maximum(outside_m, 0.0), wide_m, tall_m)
    # side by side they may climb past each other, whatever their heights
    columns_m = np.hypot(*(here_m[first] - here_m[second]).T)
    crosses |= _is_inside(columns_m, np.zeros(len(first)), wide_m, tall_m)
    return np.minimum(apart_m, columns_m), crosses


def _between_segments_m(a_m: Array, b_m: Array, c_m: Array, d_m: Array) -> Array:
    """(k,) Distances between the segments from a to b and from c to d, (k, 2) each."""

    def turn(p_m: Array, q_m: Array, r_m: Array) -> Array:
        side: Array = np.sign(
            (q_m[:, 0] - p_m[:, 0]) * (r_m[:, 1] - p_m[:, 1])
            - (q_m[:, 1] - p_m[:, 1]) * (r_m[:, 0] - p_m[:, 0])
        )
        return side

    cross = (turn(a_m, b_m, c_m) * turn(a_m, b_m, d_m) < 0) & (turn(c_m, d_m, a_m) * turn(c_m, d_m, b_m) < 0)
    ends_m = np.minimum.reduce(
        [
            _from_segment_m(a_m, c_m, d_m),
            _from_segment_m(b_m, c_m, d_m),
            _from_segment_m(c_m, a_m, b_m),
            _from_segment_m(d_m, a_m, b_m),
        ]
    )
    return np.where(cross, 0.0, ends_m)


def _from_segment_m(point_m: Array, a_m: Array, b_m: Array) -> Array:
    """(k,) Distances of points from the segments from a to b, (k, 2) each."""
    along_m = b_m - a_m
    share = ((point_m - a_m) * along_m).sum(axis=1) / np.maximum((along_m**2).sum(axis=1), 1e-12)
    distance_m: Array = np.linalg.norm(point_m - a_m - np.clip(share, 0.0, 1.0)[:, None] * along_m, axis=1)
    return distance_m


SWEEPS = 300
"""Iterations of the law's own descent, from the pads to the final shape. 50 ms for PREDICTED_MAX vehicles."""

PREDICTED_MAX = 64
"""Larger fleets use an even lattice as shape: the slots are not predicted, but the distances are."""

PAIRS_NAMED = 4

LOOKED_AT_MAX = 12
"""Plans of a show that are examined for vehicles that fly home."""

TURNS_RAD = (0.5 * np.pi, np.pi, 1.5 * np.pi)
"""Further orientations to the pads of a formation that spins."""


def formation_m(ids: tuple[VehicleId, ...], home_m: Array, plan: Plan, control: ControlSettings) -> Array:
    """(n, 3) Predicted positions in the formation: each vehicle from its pad to its slot.

    Args:
        ids: n vehicles, in the order of the fleet.
        home_m: (n, 3) their pads, show frame.
        plan: the sphere, its target, its orbit.
        control: the law's settings.
    """
    formed_m: Array = _center_m(plan) + plan.formation.radius_m * _places(ids, home_m, plan, control)
    return formed_m


def _places(ids: tuple[VehicleId, ...], home_m: Array, plan: Plan, control: ControlSettings) -> Array:
    """(n, 3) Unit vectors from the centre to the predicted slots."""
    if len(ids) > PREDICTED_MAX:
        return spiral(1.0 - (2.0 * np.arange(len(ids)) + 1.0) / len(ids))
    rows = np.arange(len(ids), dtype=np.intp)
    direction, _ = directions_from(home_m, _center_m(plan))
    place = begun(direction, ids, rows, control.law)
    place, _ = sweep(place, np.zeros_like(place), place.copy(), np.ones(len(ids)), SWEEPS, 0.0)
    return place


def check_setpoint_loss(
    ids: tuple[VehicleId, ...],
    home_m: Array,
    plans: Sequence[tuple[str, Plan]],
    control: ControlSettings,
    uncertainty_m: Array,
    action: Action,
    return_height_m: Array | float,
    flies_on_s: Array | float = 0.0,
) -> None:
    """Check that `action`, by all vehicles at once, keeps the minimum separation.

    Args:
        ids: n vehicles that are to fly.
        home_m: (n, 3) their pads, show frame.
        plans: to be flown in order, each with the name of its cue ("" without).
        control: law and minimum separation.
        uncertainty_m: (n,) of each position.
        action: `operation.setpoint_loss_action`.
        return_height_m: RTL_RETURN_ALT, (n,) or of all.
        flies_on_s: see `clashes`.

    Raises: RefusedError naming the pairs, and an action that would keep it.
    """
    places = _places(ids, home_m, plans[0][1], control)  # each vehicle keeps its slot throughout

    def found_by(what: Action) -> tuple[str, list[Clash]]:
        for cue, plan in _worst(plans) if what != "return" else _spread(plans):
            for position_m in _formations_m(places, plan, what):
                clashing = clashes(
                    position_m,
                    home_m,
                    what,
                    floor=control.safety.floor,
                    uncertainty_m=uncertainty_m,
                    speed_m_s=_speed_m_s(plan),
                    return_height_m=return_height_m,
                    flies_on_s=flies_on_s,
                )
                if clashing:
                    return f" at cue '{cue}'" if cue else "", clashing
        return "", []

    when, clashing = found_by(action)
    if not clashing:
        return
    named = ", ".join(f"{ids[clash.first]} and {ids[clash.second]}" for clash in clashing[:PAIRS_NAMED])
    more = f" and {len(clashing) - PAIRS_NAMED} pairs more" if len(clashing) > PAIRS_NAMED else ""
    better = next((other for other in ACTIONS if not found_by(other)[1]), None)
    fix = (
        "no action would keep them apart: a larger radius is needed"
        if better is None
        else f"'{better}' would keep them apart: set operation.setpoint_loss_action to it,"
        " and run: gcs params apply --config FILE"
    )
    raise RefusedError(
        f"if all vehicles lost this ground station at once{when}, '{action}' would bring {named}{more} closer"
        f" than the floor ({clashing[0].sideways_m:.1f} m, seen from above; the formation may turn). {fix}"
    )


def _worst(plans: Sequence[tuple[str, Plan]]) -> Sequence[tuple[str, Plan]]:
    """For actions in place: return the smallest sphere with the greatest speed of all plans."""
    cue, smallest = min(plans, key=lambda entry: entry[1].formation.radius_m)
    fastest = max((plan for _, plan in plans), key=_speed_m_s)
    spin_rad_s = _rim_m_s(fastest) / smallest.formation.radius_m
    formation = replace(smallest.formation, spin_rad_s=spin_rad_s)
    return [(cue, replace(smallest, formation=formation, orbit=fastest.orbit, target=fastest.target))]


def _spread(plans: Sequence[tuple[str, Plan]]) -> Sequence[tuple[str, Plan]]:
    """For flights home: return plans spread over the show, few enough not to delay a start."""
    if len(plans) <= LOOKED_AT_MAX:
        return plans
    return [plans[row] for row in np.linspace(0, len(plans) - 1, LOOKED_AT_MAX).astype(int).tolist()]


def _rim_m_s(plan: Plan) -> float:
    """Speed of the vehicle farthest from the spin axis."""
    return abs(plan.formation.spin_rad_s) * plan.formation.radius_m


def _speed_m_s(plan: Plan) -> float:
    """Greatest speed of any vehicle: if one of a pair stops later than the other, it moves on with it."""
    return plan.orbit.speed_m_s * (plan.orbit.radius_m > 0.0) + plan.target.speed_m_s + _rim_m_s(plan)


def _formations_m(places: Array, plan: Plan, action: Action) -> Iterator[Array]:
    """Yield (n, 3) positions at the loss: every orientation; for flights home every place on the orbit."""
    center_m = _center_m(plan)
    radius_m = plan.orbit.radius_m if action == "return" else 0.0
    begins_m = center_m + plan.formation.radius_m * places
    shapes_m = [begins_m, turned_upright(begins_m, center_m)]
    if plan.formation.spin_rad_s and action == "return":  # for other actions only the spin rate matters
        shapes_m += [center_m + plan.formation.radius_m * turned(places, turn) for turn in TURNS_RAD]
    for place_m in shapes_m:
        for turn in np.arange(4 if radius_m else 1) * np.pi / 2:
            yield place_m + radius_m * np.array([np.cos(turn), np.sin(turn), 0.0])


def _center_m(plan: Plan) -> Array:
    return np.array([plan.target.x_m, plan.target.y_m, -plan.formation.height_m])
