"""Whether the fleet would stay separated if it lost this ground station during the planned flight. Pure.

Checked before take-off: then another action can still be chosen.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs.control import ControlSettings
from gcs.formation.law import begun, directions_from, turned
from gcs.formation.repulsion import sweep
from gcs.model.errors import RefusedError
from gcs.model.plan import Plan
from gcs.model.state import Array, VehicleId
from gcs.planning.loss_conflicts import ACTIONS, Action, Clash, clashes, turned_upright

SWEEPS = 300
"""Iterations of the law's own descent, from the pads to the final shape. 50 ms for PREDICTED_MAX vehicles."""

PREDICTED_MAX = 64
"""Larger fleets use an even lattice as shape: the slots are not predicted, but the distances are."""

GOLDEN_ANGLE_RAD = np.pi * (3.0 - np.sqrt(5.0))

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
        return _lattice(len(ids))
    rows = np.arange(len(ids), dtype=np.intp)
    direction, _ = directions_from(home_m, _center_m(plan))
    place = begun(direction, ids, rows, control.law)
    place, _ = sweep(place, np.zeros_like(place), place.copy(), np.ones(len(ids)), SWEEPS, 0.0)
    return place


def _lattice(count: int) -> Array:
    """(n, 3) Unit vectors, evenly: a Fibonacci lattice."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    level, turn = np.sqrt(1.0 - z**2), GOLDEN_ANGLE_RAD * np.arange(count)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), z])


def check_setpoint_loss(
    ids: tuple[VehicleId, ...],
    home_m: Array,
    plans: Sequence[tuple[str, Plan]],
    control: ControlSettings,
    uncertainty_m: Array,
    action: Action,
    return_height_m: float,
) -> None:
    """Check that `action`, by all vehicles at once, keeps the minimum separation.

    Args:
        ids: n vehicles that are to fly.
        home_m: (n, 3) their pads, show frame.
        plans: to be flown in order, each with the name of its cue ("" without).
        control: law and minimum separation.
        uncertainty_m: (n,) of each position.
        action: `operation.setpoint_loss_action`.
        return_height_m: RTL_RETURN_ALT.

    Raises: RefusedError naming the pairs, and an action that would keep it.
    """
    places = _places(ids, home_m, plans[0][1], control)  # each vehicle keeps its slot throughout

    def found_by(what: Action) -> tuple[str, list[Clash]]:
        for cue, plan in _worst(plans) if what != "return" else _spread(plans):
            found = _first_clashes(places, home_m, plan, control, uncertainty_m, what, return_height_m)
            if found:
                return f" at cue '{cue}'" if cue else "", found
        return "", []

    when, found = found_by(action)
    if not found:
        return
    named = ", ".join(f"{ids[clash.first]} and {ids[clash.second]}" for clash in found[:PAIRS_NAMED])
    more = f" and {len(found) - PAIRS_NAMED} pairs more" if len(found) > PAIRS_NAMED else ""
    better = next((other for other in ACTIONS if not found_by(other)[1]), None)
    fix = (
        "no action would keep them apart: a larger radius is needed"
        if better is None
        else f"'{better}' would keep them apart: set operation.setpoint_loss_action to it,"
        " and run: gcs params apply --config FILE"
    )
    raise RefusedError(
        f"if all vehicles lost this ground station at once{when}, '{action}' would bring {named}{more} closer"
        f" than the floor ({found[0].sideways_m:.1f} m, seen from above; the formation may turn). {fix}"
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


def _first_clashes(
    places: Array,
    home_m: Array,
    plan: Plan,
    control: ControlSettings,
    uncertainty_m: Array,
    action: Action,
    return_height_m: float,
) -> list[Clash]:
    """Return the conflicts of the first orientation or orbit position that has any."""
    center_m = _center_m(plan)
    begins_m = center_m + plan.formation.radius_m * places
    shapes_m = [begins_m, turned_upright(begins_m, center_m)]
    if plan.formation.spin_rad_s and action == "return":  # for other actions only the spin rate matters
        shapes_m += [center_m + plan.formation.radius_m * turned(places, turn) for turn in TURNS_RAD]
    for place_m in shapes_m:
        for shift_m in _shifts_m(plan, action):
            found = clashes(
                place_m + shift_m,
                home_m,
                action,
                floor=control.safety.floor,
                uncertainty_m=uncertainty_m,
                speed_m_s=_speed_m_s(plan),
                return_height_m=return_height_m,
            )
            if found:
                return found
    return []


def _shifts_m(plan: Plan, action: Action) -> list[Array]:
    """(3,) each: possible positions of the centre around the target. They matter only for flights home."""
    radius_m = plan.orbit.radius_m
    if action != "return" or radius_m == 0.0:
        return [np.zeros(3)]
    return [radius_m * np.array([np.cos(turn), np.sin(turn), 0.0]) for turn in np.arange(4) * np.pi / 2]


def _center_m(plan: Plan) -> Array:
    return np.array([plan.target.x_m, plan.target.y_m, -plan.formation.height_m])
