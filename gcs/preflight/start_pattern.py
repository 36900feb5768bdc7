"""Whether the fleet stands where the show has it stand: the pads fitted to the pattern expected. Pure.

A show whose heading or origin is wrong is flown by every vehicle without a fault. It is seen before take-off
alone, by the pads: in the show's frame they lie turned, or beside where they were set out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask

FIRST_MAX, PARTNERS = 64, 8
"""Pairs of vehicles, each of which suggests how the pattern lies: so many, each with the farthest from it.

With several, for the one that is farthest from nearly everybody may be the one that stands elsewhere.
"""

REFITS = 5

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How n pads lie to their expected places: turned about the pattern's middle, then shifted.

    Attributes:
        rotation_rad: from x towards y, clockwise seen from above; 0 where nothing can be told.
        reported_rad: what is less cannot be told from the uncertainty of the positions; inf for one place.
        shift_m: (2,) of the middle.
        middle_m: (2,) of the expected places of those who stand in the pattern.
        stands: (n,) who stands in the pattern as it lies.
        off_m: (n,) how far each is from its place in the pattern as it lies.
    """

    rotation_rad: float
    reported_rad: float
    shift_m: Array
    middle_m: Array
    stands: Mask
    off_m: Array

    def placed_m(self, expected_m: Array) -> Array:
        """(k, 2) where the pattern as it lies has these expected places (k, 2)."""
        turn = np.exp(1j * self.rotation_rad)
        middle = complex(*self.middle_m)
        return _plane(turn * (_line(expected_m) - middle) + middle + complex(*self.shift_m))

    @property
    def origin_m(self) -> Array:
        """(2,) where the pattern, as it lies, has the origin of the frame."""
        placed_m: Array = self.placed_m(np.zeros((1, 2)))[0]
        return placed_m


def fit(expected_m: Array, measured_m: Array, uncertainty_m: Array, within_m: float) -> Fit:
    """The rotation and shift that bring most places onto their pads, and of those the least squares.

    A vehicle that stands elsewhere must not turn the pattern of the others. So several guesses are compared
    by how many stand in the pattern as each has it: as it should lie, fitted to all, and fitted to pairs.
    Then rotation and shift are those of least squares (Kabsch's in the plane, where they are the angle of
    one complex number) over those who stand in it.

    Args:
        expected_m: (n, 2) places, n at least 1, row i where vehicle i should stand.
        measured_m: (n, 2) where it stands.
        uncertainty_m: (n,) of that.
        within_m: besides the uncertainty, so far from its place a vehicle still stands in the pattern.
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
    """The guess under which most stand in the pattern; of equals the first: as it should lie."""
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
    """The least-squares rotation, a complex number of length 1, and shift: q is turn * p + move."""
    p_mean, q_mean = p.mean(), q.mean()
    lever = (np.conj(p - p_mean) * (q - q_mean)).sum()
    turn = complex(lever / abs(lever)) if abs(lever) > 1e-9 else 1.0 + 0.0j
    return turn, complex(q_mean - turn * p_mean)


def _line(place_m: Array) -> Complex:
    line: Complex = place_m[:, 0] + 1j * place_m[:, 1]
    return line


def _plane(line: Complex) -> Array:
    return np.stack([line.real, line.imag], axis=1)


def assigned(
    expected_m: Array, measured_m: Array, own: NDArray[np.intp], within_m: float
) -> NDArray[np.intp]:
    """(n,) which place each vehicle has: its own, or for who has none (-1) the nearest that is left.

    Places are compared as they lie by those who have one of their own; nobody's place is given twice.

    Args:
        expected_m: (m, 2) places.
        measured_m: (n, 2) where the vehicles stand.
        own: (n,) each one's place, -1 for none.
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
