"""Checks of the distance between pads. Pure."""

from collections.abc import Collection, Sequence
from math import ceil

import numpy as np

from gcs.estimation.positioning import RTK_FIXED
from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, VehicleId
from gcs.preflight.fleet import Pattern
from gcs.preflight.vehicles import PreflightInputs, fix_words, judged

ROOM_TOLERANCE_M, ROOM_HYSTERESIS_M = 0.5, 0.15
"""Reported positions of two pads are off by this much; a check that passed fails only if more is missing."""

PLANNED_TOLERANCE_M = 0.01

WANDER_TOLERANCE_M = 0.5
"""Two 3D fixes that stand wander by 0.27 m (1 sigma, east) to each other. A distance that has passed fails
only when more is missing.
"""

TO_THE_NEXT, ROOM = "distance to the next", "room to wander"


def room_to_wander(
    inputs: PreflightInputs, vehicles: Sequence[VehicleId], pattern: Pattern | None
) -> dict[VehicleId, Check]:
    """Check that neighbours keep the minimum separation while their own autopilots climb and hold them.

    All of them hold at one height until the last is up: the order and the pause between take-offs do not keep
    neighbours from holding side by side, so only the distance of the pads counts.
    """
    wander_m, least_m = inputs.settings.wander_m, inputs.floor.horizontal_m
    if wander_m == 0.0 or len(vehicles) < 2:
        return {}
    at = np.array([inputs.rows[name] for name in vehicles], dtype=np.intp)
    measured_m, planned_m = inputs.fleet.position_m[at, :2], _planned_m(vehicles, pattern)
    needed_m, found = least_m + 2.0 * wander_m, {}
    for index, name in enumerate(vehicles):
        slack_m = ROOM_TOLERANCE_M + (ROOM_HYSTERESIS_M if (name, ROOM) in inputs.passed else 0.0)
        nearest, apart_m = _nearest(measured_m, index)
        beside = f"stands {apart_m:.1f} m from {vehicles[nearest]}"
        good, (next_m, pads_m) = apart_m >= needed_m - slack_m, _nearest(planned_m, index)
        if good and pads_m < needed_m - PLANNED_TOLERANCE_M:
            good, apart_m = False, pads_m
            beside = f"its pad is planned {apart_m:.1f} m from that of {vehicles[next_m]}"
        if not np.isfinite(apart_m):
            continue
        limit = f"at least {needed_m:g} m to the next that flies"
        left = f"which leaves {max(0.0, apart_m - 2.0 * wander_m):.1f} m of {least_m:g} m"
        may_be = f"while their autopilots climb and hold, each may be {wander_m:g} m off its place"
        to_do = f"set the pads at least {needed_m:g} m apart; preflight.wander_m says how far they wander"
        problem = f"{beside}: {may_be}, {left}"
        of = (vehicles[nearest],)
        found[name] = judged(ROOM, apart_m, "m", limit, problem, to_do, good=good, depends_on=of)
    return found


def _planned_m(vehicles: Sequence[VehicleId], pattern: Pattern | None) -> Array:
    """(k, 2) Each vehicle's own place, NaN if it has none."""
    places_m = np.full((len(vehicles), 2), np.nan)
    if pattern is not None:
        housed = [index for index, name in enumerate(vehicles) if name in pattern.place_of]
        places_m[housed] = pattern.places_m[[pattern.place_of[vehicles[index]] for index in housed]]
    return places_m


def _nearest(place_m: Array, index: int) -> tuple[int, float]:
    """Return the nearest of the others (k, 2) to `index`, and its distance; inf if nothing is known."""
    away_m = np.linalg.norm(place_m - place_m[index], axis=1)
    away_m[index] = np.inf
    away_m[np.isnan(away_m)] = np.inf
    nearest = int(away_m.argmin())
    return nearest, float(away_m[nearest])


def spacing(
    inputs: PreflightInputs, vehicles: Sequence[VehicleId], flying: Collection[VehicleId] | None = None
) -> dict[VehicleId, list[Check]]:
    """Check for vehicles too close to another one, flying or not, to climb beside it.

    A pair that both fly is reported once, with the first of them: the second has no such check then. One that
    passed fails only if more is missing than receivers wander. The receiver of one that stays on the ground
    counts as no worse than that of the other, as in the safety filter.

    Args:
        inputs: of the whole fleet.
        vehicles: those to check.
        flying: those that fly; None: all.
    """
    floor, ids = inputs.floor, list(inputs.fleet.ids)
    place_m, kept_m = inputs.fleet.position_m[:, :2], floor.kept_m(0.0)[0]
    uncertainty_m = inputs.uncertainty_m
    if (others := inputs.others) is not None:
        ids += others.names
        place_m = np.concatenate([place_m, others.place_m])
        uncertainty_m = np.concatenate([uncertainty_m, others.uncertainty_m])
    fly = np.array(
        [flying is None or name in flying or row >= len(inputs.rows) for row, name in enumerate(ids)]
    )
    found: dict[VehicleId, list[Check]] = {}
    reported: set[tuple[int, int]] = set()
    for name in vehicles:
        row, found[name] = inputs.rows[name], []
        if not np.isfinite(place_m[row]).all():
            continue
        away_m = np.linalg.norm(place_m - place_m[row], axis=1)
        away_m[row] = np.inf
        near_m = np.where(np.isfinite(away_m), away_m, np.inf)
        theirs_m = np.where(fly, uncertainty_m, np.minimum(uncertainty_m, uncertainty_m[row]))
        least_m = kept_m + floor.reserve_m(theirs_m, uncertainty_m[row])
        slack_m = WANDER_TOLERANCE_M if (name, TO_THE_NEXT) in inputs.passed else 0.0
        too_close = np.flatnonzero(near_m < least_m - slack_m).tolist()
        for other in too_close:
            if (other, row) in reported and fly[other]:
                continue
            reported.add((row, other))
            limit, value_m = f"at least {rounded_up(least_m[other]):.1f} m", float(near_m[other])
            least_certain, more_certain = (
                (row, other) if uncertainty_m[row] >= theirs_m[other] else (other, row)
            )
            because, instead = _by_receiver(inputs, least_certain, float(least_m[other]))
            problem = f"stands {value_m:.1f} m from {ids[other]}, {limit} is needed{because}"
            apart_m = rounded_up(least_m[other] - value_m)
            to_do = f"move {name} and {ids[other]} {apart_m:.1f} m farther apart{instead}"
            of = (ids[least_certain], ids[more_certain])
            found[name].append(Check(TO_THE_NEXT, State.FAIL, value_m, "m", limit, problem, to_do, of))
        if not too_close and np.isfinite(near_m).any():
            nearest = int(near_m.argmin())
            limit, value_m = f"at least {rounded_up(least_m[nearest]):.1f} m", float(near_m[nearest])
            found[name].append(Check(TO_THE_NEXT, State.PASS, value_m, "m", limit))
    return found


def _by_receiver(inputs: PreflightInputs, row: int, needed_m: float) -> tuple[str, str]:
    """What the less certain receiver of a pair has to do with the distance, and which distance RTK needs."""
    floor, wander_m = inputs.floor, inputs.settings.wander_m
    best_m = float(inputs.positioning.least_by_type_m[RTK_FIXED])
    enough_m = floor.kept_m(float(floor.reserve_m(best_m, best_m)))[0]
    if wander_m:
        enough_m = max(enough_m, floor.horizontal_m + 2.0 * wander_m)
    if row >= len(inputs.telemetry.fix_type):  # of another station
        return "", ""
    because = f" with {fix_words(inputs, row)}"
    if enough_m >= needed_m:
        return because, ""
    if inputs.telemetry.fix_type[row] == RTK_FIXED:
        return because, f", or wait for a better accuracy ({rounded_up(enough_m):.1f} m at {best_m:g} m)"
    return because, f", or use RTK ({rounded_up(enough_m):.1f} m)"


def rounded_up(value_m: float) -> float:
    """To a tenth: a limit that is named must itself be accepted."""
    return ceil(10.0 * value_m - 1e-6) / 10.0
