"""Checks of the vehicles' positions against each other and against the start pattern. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees, hypot

import numpy as np
from numpy.typing import NDArray

from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, VehicleId
from gcs.preflight.start_pattern import Fit, assigned, fit
from gcs.preflight.vehicles import PreflightInputs, judged

ROOM_TOLERANCE_M, ROOM_HYSTERESIS_M = 0.5, 0.15
"""Reported positions of two pads are off by this much; a check that passed fails only if more is missing."""

PLANNED_TOLERANCE_M = 0.01

OFF_DEVIATIONS = 2.0
"""A standing vehicle may be this many standard deviations of its position off its place."""

REPORTED_MAX_DEG = 30.0
"""A pattern too small to detect even this rotation has no rotation check."""

CLOCKWISE = ("clockwise", "counterclockwise")


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Where vehicles should stand. Places without an owner are for vehicles without a place."""

    places_m: Array  # (m, 2) show frame
    place_of: Mapping[VehicleId, int]  # rows of `places_m`
    heading_deg: float  # of the show frame


@dataclass(slots=True)
class Stand:
    """Checks of each vehicle, and of the fleet."""

    fleet: list[Check] = field(default_factory=list)
    of: dict[VehicleId, list[Check]] = field(default_factory=dict)
    not_checked: list[str] = field(default_factory=list)


def standing(inputs: PreflightInputs, flying: Sequence[VehicleId], pattern: Pattern | None) -> Stand:
    """Check pad heights against each other, and the start pattern; only for vehicles with a position."""
    found = Stand(of={name: [] for name in flying})
    rows = inputs.rows
    placed = [name for name in flying if inputs.is_placed(rows[name])]
    at = np.array([rows[name] for name in placed], dtype=np.intp)
    if len(placed) > 1:
        _heights(inputs, placed, at, found)
    if pattern is None:
        found.not_checked.append(
            "start pattern: no show is selected, and preflight.start_places names no places"
        )
    elif placed:
        _pattern(inputs, placed, at, pattern, found)
    return found


def _heights(
    inputs: PreflightInputs, placed: Sequence[VehicleId], at: NDArray[np.intp], found: Stand
) -> None:
    """Compare the pads, which are on one field: a height far from the others is a wrong altitude."""
    height_m = -inputs.fleet.position_m[at, 2]
    above_m, most_m = height_m - float(np.median(height_m)), inputs.settings.height_spread_max_m
    for name, off_m in zip(placed, above_m.tolist(), strict=True):
        beside = f"{abs(off_m):.1f} m {'above' if off_m > 0.0 else 'below'} the middle one of all pads"
        limit, problem = f"from -{most_m:g} to {most_m:g} m of the middle one", f"stands {beside}, at most"
        to_do = "reboot it where it stands; on a slope raise preflight.height_spread_max_m"
        text, good = f"{problem} {most_m:g} m", abs(off_m) <= most_m
        found.of[name].append(judged("height of the pad", off_m, "m", limit, text, to_do, good=good))


def _pattern(
    inputs: PreflightInputs, placed: Sequence[VehicleId], at: NDArray[np.intp], pattern: Pattern, found: Stand
) -> None:
    measured_m, within_m = inputs.fleet.position_m[at, :2], inputs.settings.place_max_m
    own = np.array([pattern.place_of.get(name, -1) for name in placed], dtype=np.intp)
    place = assigned(pattern.places_m, measured_m, own, within_m)
    housed = np.flatnonzero(place >= 0)
    for name in (placed[index] for index in np.flatnonzero(place < 0).tolist()):
        limit, problem = "a place of its own", "has no place in the start pattern"
        to_do = "take it out of the show, or name its place in preflight.start_places"
        found.of[name].append(Check("place", State.UNKNOWN, None, "", limit, problem, to_do))
    if not len(housed):
        return
    names, places_m = [placed[index] for index in housed.tolist()], pattern.places_m[place[housed]]
    fitted = fit(places_m, measured_m[housed], OFF_DEVIATIONS * inputs.uncertainty_m[at[housed]], within_m)
    _places(inputs, names, at[housed], fitted, place[housed], pattern, found)
    _lies(inputs, len(names), fitted, pattern, found)


def _places(
    inputs: PreflightInputs,
    names: Sequence[VehicleId],
    at: NDArray[np.intp],
    fitted: Fit,
    place: NDArray[np.intp],
    pattern: Pattern,
    found: Stand,
) -> None:
    """Compare each vehicle with its own place in the pattern as fitted."""
    owner_of = {row: name for name, row in pattern.place_of.items()}
    owner_of |= {int(row): name for name, row in zip(names, place, strict=True)}
    lies_m = fitted.placed_m(pattern.places_m)
    most_m = inputs.settings.place_max_m
    for index, name in enumerate(names):
        off_m = float(fitted.off_m[index])
        problem = f"stands {off_m:.1f} m off its start place"
        if not fitted.stands[index]:
            away_m = np.linalg.norm(lies_m - inputs.fleet.position_m[at[index], :2], axis=1)
            nearest, near_m = int(away_m.argmin()), OFF_DEVIATIONS * inputs.uncertainty_m[at[index]]
            if away_m[nearest] <= most_m + near_m and nearest != place[index]:
                owner = f"that of {owner_of[nearest]}" if nearest in owner_of else "another"
                problem += f", on {owner}"
        limit, good = f"at most {most_m:g} m, and what its position may be off", bool(fitted.stands[index])
        to_do = "put it on its own place, or take it out of the show"
        found.of[name].append(judged("place", off_m, "m", limit, problem, to_do, good=good))


def _lies(inputs: PreflightInputs, count: int, fitted: Fit, pattern: Pattern, found: Stand) -> None:
    """Check rotation and shift of the pattern as a whole."""
    settings, stand = inputs.settings, int(fitted.stands.sum())
    half = f"more than half of {count}"
    if 2 * stand <= count and count > 1:
        problem = f"only {stand} of {count} stand in the start pattern, however it is turned and shifted"
        to_do = "check which show is selected, and which vehicle stands where"
        found.fleet.append(Check("start pattern", State.FAIL, stand, "vehicles", half, problem, to_do))
        return
    found.fleet.append(Check("start pattern", State.PASS, stand, "vehicles", half))
    x_m, y_m = fitted.placed_m(np.zeros((1, 2)))[0].tolist()
    turned_deg, reported_deg = degrees(fitted.rotation_rad), degrees(fitted.reported_rad)
    heading_deg = (pattern.heading_deg + turned_deg) % 360.0
    lies = (
        f"as the pads lie, the show's origin is at x {x_m:.1f} m, y {y_m:.1f} m,"
        f" its heading {heading_deg:.1f} deg"
    )
    middle = f"its middle (x {fitted.middle_m[0]:.1f} m, y {fitted.middle_m[1]:.1f} m)"
    to_do = f"check show_frame (heading, latitude, longitude) and how the pads were set out: {lies}"
    if reported_deg > REPORTED_MAX_DEG:
        found.not_checked.append("rotation of the start pattern: it is too small to tell one")
    else:
        most_deg = max(settings.rotation_max_deg, reported_deg)
        limit = f"from -{most_deg:.1f} to {most_deg:.1f} deg, clockwise seen from above"
        if reported_deg >= most_deg:
            limit += " (less cannot be distinguished between pads so near to each other)"
        turned = f"turned by {abs(turned_deg):.1f} deg {CLOCKWISE[turned_deg < 0]} about {middle}"
        problem, good = (
            f"the start pattern is {turned}, at most {most_deg:.1f} deg",
            abs(turned_deg) <= most_deg,
        )
        name = "rotation of the start pattern"
        found.fleet.append(judged(name, turned_deg, "deg", limit, problem, to_do, good=good))
    shift_m, (along_m, right_m) = hypot(*fitted.shift_m.tolist()), fitted.shift_m.tolist()
    limit, good = f"at most {settings.shift_max_m:g} m", shift_m <= settings.shift_max_m
    shifted = f"{shift_m:.1f} m ({along_m:+.1f} m along x, {right_m:+.1f} m along y)"
    problem = f"the start pattern is shifted by {shifted} from {middle}, {limit}"
    found.fleet.append(judged("shift of the start pattern", shift_m, "m", limit, problem, to_do, good=good))


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
        slack_m = ROOM_TOLERANCE_M + (ROOM_HYSTERESIS_M if name in inputs.roomy else 0.0)
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
        found[name] = judged("room to wander", apart_m, "m", limit, problem, to_do, good=good)
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


def spacing(inputs: PreflightInputs, vehicles: Sequence[VehicleId]) -> dict[VehicleId, list[Check]]:
    """Check for vehicles too close to another one, flying or not, to climb beside it.

    A pair that both fly is reported once, with the first of them: the second has no such check then.
    """
    floor, ids = inputs.floor, inputs.fleet.ids
    place_m, kept_m = inputs.fleet.position_m[:, :2], floor.kept_m(0.0)[0]
    found: dict[VehicleId, list[Check]] = {}
    reported: set[tuple[int, int]] = set()
    for name in vehicles:
        row, found[name] = inputs.rows[name], []
        if not np.isfinite(place_m[row]).all():
            continue
        away_m = np.linalg.norm(place_m - place_m[row], axis=1)
        away_m[row] = np.inf
        near_m = np.where(np.isfinite(away_m), away_m, np.inf)
        least_m = kept_m + floor.reserve_m(inputs.uncertainty_m, inputs.uncertainty_m[row])
        too_close = np.flatnonzero(near_m < least_m).tolist()
        for other in too_close:
            if (other, row) in reported:
                continue
            reported.add((row, other))
            limit, value_m = f"at least {least_m[other]:.3g} m", float(near_m[other])
            problem = f"stands {value_m:.1f} m from {ids[other]}, {limit} is needed"
            to_do = f"move it away from {ids[other]}"
            found[name].append(Check("distance to the next", State.FAIL, value_m, "m", limit, problem, to_do))
        if not too_close and np.isfinite(near_m).any():
            nearest = int(near_m.argmin())
            limit, value_m = f"at least {least_m[nearest]:.3g} m", float(near_m[nearest])
            found[name].append(Check("distance to the next", State.PASS, value_m, "m", limit))
    return found
