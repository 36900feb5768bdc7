"""Checks of the vehicles' positions against each other and against the start pattern. Pure.

Every vehicle follows a show with a wrong heading or origin without an error. It is detectable only before
take-off, by the pads: in the show's frame they are rotated or shifted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees, hypot

import numpy as np
from numpy.typing import NDArray

from gcs.model.preflight_report import Check, State
from gcs.model.state import Array, Mask, VehicleId
from gcs.preflight.vehicles import POSITIONED_BY, PreflightInputs, judged

FIRST_MAX, PARTNERS = 64, 8
"""Number of vehicle pairs that each suggest a fit: vehicles, and the farthest partners of each.

Several partners, because the vehicle farthest from most others may be the misplaced one.
"""

REFITS = 5

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The fit of n pads to their expected places: rotated about the pattern's middle, then shifted.

    Attributes:
        rotation_rad: from x towards y, clockwise seen from above; 0 if not observable.
        reported_rad: the smallest rotation above the uncertainty of the positions; inf for one place.
        shift_m: (2,) of the middle.
        middle_m: (2,) of the expected places of the vehicles that stand in the pattern.
        stands: (n,) which vehicles stand in the pattern as fitted.
        off_m: (n,) distance of each from its place in the pattern as fitted.
    """

    rotation_rad: float
    reported_rad: float
    shift_m: Array
    middle_m: Array
    stands: Mask
    off_m: Array

    def placed_m(self, expected_m: Array) -> Array:
        """(k, 2) Expected places (k, 2), moved to the pattern as fitted."""
        turn = np.exp(1j * self.rotation_rad)
        middle = complex(*self.middle_m)
        return _plane(turn * (_line(expected_m) - middle) + middle + complex(*self.shift_m))


def fit(expected_m: Array, measured_m: Array, uncertainty_m: Array, within_m: float) -> Fit:
    """Find the rotation and shift that match most places, with least squares over those.

    A misplaced vehicle must not rotate the pattern of the others. So several guesses are compared
    by the number of vehicles that match: the expected pattern, fitted to all, and fitted to pairs.
    Rotation and shift are then those of least squares (Kabsch's in the plane, where they are the angle of
    one complex number) over the vehicles that match.

    Args:
        expected_m: (n, 2) places, n at least 1, row i where vehicle i should stand.
        measured_m: (n, 2) measured positions.
        uncertainty_m: (n,) of the measured positions.
        within_m: besides the uncertainty, distance from its place within which a vehicle matches.
    """
    p, q = _line(expected_m), _line(measured_m)
    near_m = within_m + uncertainty_m
    turn, move = _guess(p, q, near_m)
    stands: Mask = np.abs(q - turn * p - move) <= near_m
    for _ in range(REFITS):
        before = stands
        turn, move = _rigid(p[stands], q[stands]) if stands.any() else (turn, move)
        stands = np.abs(q - turn * p - move) <= near_m
        if (stands == before).all():
            break
    members = stands if stands.any() else np.ones(len(p), np.bool_)
    middle = p[members].mean()
    spread_m = float(np.sqrt((np.abs(p[members] - middle) ** 2).sum()))
    wide_m = float(np.sqrt((uncertainty_m[members] ** 2).mean()))
    return Fit(
        rotation_rad=float(np.angle(turn)),
        reported_rad=float(np.arctan2(wide_m, spread_m)) if spread_m > 0.0 else np.inf,
        shift_m=_plane(np.array([turn * middle + move - middle]))[0],
        middle_m=_plane(np.array([middle]))[0],
        stands=stands,
        off_m=np.abs(q - turn * p - move),
    )


def _guess(p: Complex, q: Complex, near_m: Array) -> tuple[complex, complex]:
    """Return the guess that most vehicles match; of equals the first, the expected pattern."""
    n = len(p)
    first = np.unique(np.linspace(0, n - 1, min(n, FIRST_MAX)).astype(np.intp))
    farthest = np.argsort(-np.abs(p[first][:, None] - p[None]), axis=1, kind="stable")[:, :PARTNERS]
    first, second = np.repeat(first, farthest.shape[1]), farthest.ravel()
    base, seen = p[second] - p[first], q[second] - q[first]
    usable = (base != 0) & (seen != 0)
    ratio = seen[usable] / base[usable]
    by_all = _rigid(p, q)
    turns = np.concatenate([[1.0, by_all[0]], ratio / np.abs(ratio)])
    middles = (p[first] + p[second])[usable] / 2, (q[first] + q[second])[usable] / 2
    moves = np.concatenate([[0.0, by_all[1]], middles[1] - ratio / np.abs(ratio) * middles[0]])
    count = (np.abs(q[None] - turns[:, None] * p[None] - moves[:, None]) <= near_m[None]).sum(axis=1)
    best = int(count.argmax())
    return complex(turns[best]), complex(moves[best])


def _rigid(p: Complex, q: Complex) -> tuple[complex, complex]:
    """Return the least-squares rotation, a complex number of length 1, and shift: q is turn * p + move."""
    p_mean, q_mean = p.mean(), q.mean()
    lever = (np.conj(p - p_mean) * (q - q_mean)).sum()
    turn = complex(lever / abs(lever)) if abs(lever) > 1e-9 else 1.0 + 0.0j
    return turn, complex(q_mean - turn * p_mean)


def _line(place_m: Array) -> Complex:
    return np.asarray(place_m[:, 0] + 1j * place_m[:, 1])


def _plane(line: Complex) -> Array:
    return np.stack([line.real, line.imag], axis=1)


def assigned(
    expected_m: Array, measured_m: Array, own: NDArray[np.intp], within_m: float
) -> NDArray[np.intp]:
    """(n,) The place of each vehicle: its own, or for a vehicle without one (-1) the nearest that is left.

    Places are compared as fitted to the vehicles that have one of their own. No place is assigned twice.

    Args:
        expected_m: (m, 2) places.
        measured_m: (n, 2) where the vehicles stand.
        own: (n,) the place of each, -1 for none.
        within_m: as for `fit`.
    """
    place = own.copy()
    homeless = np.flatnonzero(own < 0)
    free = np.setdiff1d(np.arange(len(expected_m)), own)
    if not len(homeless) or not len(free):
        return place
    known = np.flatnonzero(own >= 0)
    lies_m = expected_m
    if len(known) >= 2:
        sure_m = np.zeros(len(known))
        lies_m = fit(expected_m[own[known]], measured_m[known], sure_m, within_m).placed_m(expected_m)
    away_m = np.linalg.norm(measured_m[homeless][:, None] - lies_m[free][None], axis=2)
    for _ in range(min(len(homeless), len(free))):
        one, other = np.unravel_index(int(away_m.argmin()), away_m.shape)
        place[homeless[one]] = free[other]
        away_m[one, :], away_m[:, other] = np.inf, np.inf
    return place


OFF_DEVIATIONS = 2.0
"""A standing vehicle may be this many standard deviations of its position off its place."""

REPORTED_MAX_DEG = 30.0
"""A pattern too small to detect even this rotation has no rotation check."""

START_PATTERN = "start pattern"
OF_THE_PATTERN = START_PATTERN, "rotation of the start pattern", "shift of the start pattern"

CLOCKWISE = ("clockwise", "counterclockwise")


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """Where vehicles should stand. Places without an owner are for vehicles without a place."""

    places_m: Array  # (m, 2) show frame
    place_of: Mapping[VehicleId, int]  # rows of `places_m`
    heading_deg: float  # of the show frame
    drawn: str = ""  # the drawn show with these pads, which can be placed; empty: none


@dataclass(slots=True)
class FleetReadiness:
    """Checks of each vehicle, and of the fleet."""

    fleet: list[Check] = field(default_factory=list)
    of: dict[VehicleId, list[Check]] = field(default_factory=dict)
    not_checked: list[str] = field(default_factory=list)


def standing(inputs: PreflightInputs, flying: Sequence[VehicleId], pattern: Pattern | None) -> FleetReadiness:
    """Check pad heights against each other, and the start pattern; only for vehicles with a position."""
    found = FleetReadiness(of={name: [] for name in flying})
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
    inputs: PreflightInputs, placed: Sequence[VehicleId], at: NDArray[np.intp], found: FleetReadiness
) -> None:
    """Compare the pads, which are on one field: a height far from the others is a wrong altitude."""
    height_m = -inputs.fleet.position_m[at, 2]
    above_m, most_m = height_m - float(np.median(height_m)), inputs.settings.height_spread_max_m
    for name, off_m in zip(placed, above_m.tolist(), strict=True):
        beside = f"{abs(off_m):.1f} m {'above' if off_m > 0.0 else 'below'} the middle one of all pads"
        limit, problem = f"from -{most_m:g} to {most_m:g} m of the middle one", f"stands {beside}, at most"
        to_do = "reboot it where it stands; on a slope raise preflight.height_spread_max_m"
        text, good = f"{problem} {most_m:g} m", abs(off_m) <= most_m
        of = (*POSITIONED_BY, "height of the origin")
        check = judged("height of the pad", off_m, "m", limit, text, to_do, good=good, depends_on=of)
        found.of[name].append(check)


def _pattern(
    inputs: PreflightInputs,
    placed: Sequence[VehicleId],
    at: NDArray[np.intp],
    pattern: Pattern,
    found: FleetReadiness,
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
    found: FleetReadiness,
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
        of = (*POSITIONED_BY, "distance of the origin", START_PATTERN)
        found.of[name].append(judged("place", off_m, "m", limit, problem, to_do, good=good, depends_on=of))


def _lies(inputs: PreflightInputs, count: int, fitted: Fit, pattern: Pattern, found: FleetReadiness) -> None:
    """Check rotation and shift of the pattern as a whole."""
    settings, stand = inputs.settings, int(fitted.stands.sum())
    half = f"more than half of {count}"
    if 2 * stand <= count and count > 1:
        problem = f"only {stand} of {count} stand in the start pattern, however it is turned and shifted"
        to_do = "check which show is selected, and which vehicle stands where"
        found.fleet.append(Check(START_PATTERN, State.FAIL, stand, "vehicles", half, problem, to_do))
        return
    found.fleet.append(Check(START_PATTERN, State.PASS, stand, "vehicles", half))
    x_m, y_m = fitted.placed_m(np.zeros((1, 2)))[0].tolist()
    turned_deg, reported_deg = degrees(fitted.rotation_rad), degrees(fitted.reported_rad)
    heading_deg = (pattern.heading_deg + turned_deg) % 360.0
    lies = (
        f"as the pads lie, the show's origin is at x {x_m:.1f} m, y {y_m:.1f} m,"
        f" its heading {heading_deg:.1f} deg"
    )
    middle = f"its middle (x {fitted.middle_m[0]:.1f} m, y {fitted.middle_m[1]:.1f} m)"
    to_do = f"check show_frame (heading, latitude, longitude) and how the pads were set out: {lies}"
    if pattern.drawn:
        place = f"Shows, Place (gcs shows place {pattern.drawn} --fit yes)"
        to_do += f"; or fit the show to the vehicles: {place}"
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
        found.fleet.append(judged(OF_THE_PATTERN[1], turned_deg, "deg", limit, problem, to_do, good=good))
    shift_m, (along_m, right_m) = hypot(*fitted.shift_m.tolist()), fitted.shift_m.tolist()
    limit, good = f"at most {settings.shift_max_m:g} m", shift_m <= settings.shift_max_m
    shifted = f"{shift_m:.1f} m ({along_m:+.1f} m along x, {right_m:+.1f} m along y)"
    problem = f"the start pattern is shifted by {shifted} from {middle}, {limit}"
    found.fleet.append(judged(OF_THE_PATTERN[2], shift_m, "m", limit, problem, to_do, good=good))
