"""Fits the measured positions of the pads to the expected start pattern. Pure.

Every vehicle follows a show with a wrong heading or origin without an error. It is detectable only before
take-off, by the pads: in the show's frame they are rotated or shifted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask

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
