"""Trajectories of a drawn show: polynomials, piece by piece, evaluated for the whole fleet at once. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, cos, radians, sin
from typing import Final

import numpy as np

from gcs.model.errors import ShapeError
from gcs.model.state import Array, freeze
from gcs.shows.drawn.piece_index import TIME_MAX_S, PieceIndex, Rows

DEGREE_MAX: Final = 7
"""Of a piece: Skybrush's Bezier curves and Crazyswarm's polynomials go up to it."""


def power_of_bezier(points_m: Array) -> Array:
    """Convert Bezier control points (..., d + 1, 3) to coefficients (..., d + 1, 3) of u^0 to u^d.

    Source: the binomial expansion of the Bernstein polynomials over u in [0, 1].
    """
    degree = points_m.shape[-2] - 1
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        for point in range(power + 1):
            sign = -1.0 if (power - point) % 2 else 1.0
            matrix[power, point] = sign * comb(degree, power) * comb(power, point)
    return np.asarray(matrix @ points_m)


def bezier_of_power(coefficients_m: Array) -> Array:
    """Convert coefficients (..., d + 1, 3) of u^0 to u^d to Bezier control points (..., d + 1, 3)."""
    degree = coefficients_m.shape[-2] - 1
    matrix = np.zeros((degree + 1, degree + 1))
    for point in range(degree + 1):
        for power in range(point + 1):
            matrix[point, power] = comb(point, power) / comb(degree, power)
    return np.asarray(matrix @ coefficients_m)


def turned(turn_deg: float) -> Array:
    """(3, 3) Matrix M: a row vector v of the show frame, turned clockwise from above, is ``v @ M``."""
    c, s = cos(radians(turn_deg)), sin(radians(turn_deg))
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Where n vehicles are to be at one time, and how they move there; show frame."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3)
    acceleration_m_s2: Array  # (n, 3)

    def of(self, rows: Rows) -> "Motion":
        """Return the motion of some vehicles, (k,) rows in any order."""
        return Motion(self.position_m[rows], self.velocity_m_s[rows], self.acceleration_m_s2[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """One vehicle's trajectory of k pieces, show frame. At rest before its first and after its last time.

    With k = 0 the vehicle stays at one place: one time, and `coefficients_m` is (1, 1, 3).
    """

    times_s: Array  # (k + 1,) increasing, from 0 to TIME_MAX_S
    coefficients_m: Array  # (max(k, 1), d + 1, 3) of u^0 to u^d; u goes from 0 to 1 over a piece

    def __post_init__(self) -> None:
        """Raises: ShapeError when shapes, degree, order of times or values are not as they must be."""
        pieces, terms = max(len(self.times_s) - 1, 1), self.coefficients_m.shape[1]
        freeze(self.coefficients_m, (pieces, terms, 3), "coefficients_m")
        freeze(self.times_s, (len(self.times_s),), "times_s")
        if not 1 <= terms <= DEGREE_MAX + 1:
            raise ShapeError(f"degree {terms - 1}: 0 to {DEGREE_MAX} is needed")
        if not (len(self.times_s) and self.times_s[0] >= 0.0 and self.times_s[-1] <= TIME_MAX_S):
            raise ShapeError(f"times from 0 to {TIME_MAX_S:g} s are needed")
        if not (bool((np.diff(self.times_s) > 0.0).all()) and bool(np.isfinite(self.coefficients_m).all())):
            raise ShapeError("increasing times and finite coefficients are needed")


@dataclass(frozen=True, slots=True, eq=False)
class Trajectories:
    """The trajectories of n vehicles, m pieces in all; row i belongs to the show's vehicle i.

    Units are metres and seconds of the show's clock, in the show frame: x along the show's heading, y to its
    right, z down. The pieces of a vehicle follow each other without gaps in time, and meet within 5 cm;
    velocity and acceleration may change at once where they meet.
    """

    index: PieceIndex
    durations_s: Array  # (m,)
    coefficients_m: Array  # (m, d + 1, 3) of u^0 to u^d; u goes from 0 to 1 over a piece
    begin_s: Array  # (n,) first time of each vehicle
    end_s: Array  # (n,) last time of each vehicle

    @staticmethod
    def joined(trajectories: Sequence[Trajectory]) -> "Trajectories":
        """Lay out the trajectories of all vehicles, at least one."""
        if not trajectories:
            raise ShapeError("a trajectory is needed")
        terms = max(trajectory.coefficients_m.shape[1] for trajectory in trajectories)
        count = sum(len(trajectory.coefficients_m) for trajectory in trajectories)
        coefficients_m, durations_s = np.zeros((count, terms, 3)), np.ones(count)
        at = 0
        for trajectory in trajectories:
            pieces, own_terms = trajectory.coefficients_m.shape[:2]
            coefficients_m[at : at + pieces, :own_terms] = trajectory.coefficients_m
            if len(trajectory.times_s) > 1:
                durations_s[at : at + pieces] = np.diff(trajectory.times_s)
            at += pieces
        starts_s = [trajectory.times_s[: len(trajectory.coefficients_m)] for trajectory in trajectories]
        begin_s = np.array([trajectory.times_s[0] for trajectory in trajectories])
        end_s = np.array([trajectory.times_s[-1] for trajectory in trajectories])
        for array in (coefficients_m, durations_s, begin_s, end_s):
            array.setflags(write=False)
        return Trajectories(PieceIndex.of(starts_s), durations_s, coefficients_m, begin_s, end_s)

    def __len__(self) -> int:
        """Return the number of vehicles."""
        return len(self.begin_s)

    def at(self, time_s: float | Array, vehicles: Rows | None = None) -> Motion:
        """Return what all vehicles do at a time of the show, as (n, 3) arrays.

        At the time at which two pieces meet, the later one counts. Before its first time a vehicle rests
        where it begins, from its last time on where it ends.

        Args:
            time_s: one time for all vehicles, or (n,) one for each: a vehicle that lags has its own.
            vehicles: (k,) rows to return in place of all n, in any order, also repeated; then `time_s` is one
                time or (k,).
        """
        begin_s, end_s = (self.begin_s, self.end_s) if vehicles is None else self._span_s(vehicles)
        rows, since_s = self.index.at(np.minimum(time_s, end_s), vehicles)
        duration_s = self.durations_s[rows]
        u = np.minimum(since_s / duration_s, 1.0)[:, None]
        coefficients_m = self.coefficients_m[rows]
        position_m = coefficients_m[:, -1]
        velocity_m = acceleration_m = np.zeros_like(position_m)
        for power in range(coefficients_m.shape[1] - 2, -1, -1):  # Horner, with both derivatives
            acceleration_m = acceleration_m * u + velocity_m
            velocity_m = velocity_m * u + position_m
            position_m = position_m * u + coefficients_m[:, power]
        moves = ((time_s >= begin_s) & (time_s < end_s)) / duration_s
        rate = moves[:, None]
        return Motion(position_m, velocity_m * rate, 2.0 * acceleration_m * rate**2)

    def _span_s(self, vehicles: Rows) -> tuple[Array, Array]:
        return self.begin_s[vehicles], self.end_s[vehicles]

    def positions_m(self, times_s: Array) -> Array:
        """(k, n, 3) Positions at k times, show frame."""
        return np.stack([self.at(time_s).position_m for time_s in times_s.tolist()])

    def of_vehicle(self, row: int) -> Trajectory:
        """Return one vehicle's trajectory."""
        pieces = self.index.pieces(row)
        times_s = np.append(self.index.starts_s(row), self.end_s[row])
        if times_s[-1] == times_s[0]:
            times_s = times_s[:1]
        return Trajectory(times_s, self.coefficients_m[pieces].copy())

    def of_vehicles(self, rows: Sequence[int]) -> "Trajectories":
        """Return the trajectories of some vehicles, in that order."""
        return Trajectories.joined([self.of_vehicle(row) for row in rows])

    def placed(self, turn_deg: float, offset_m: Array) -> "Trajectories":
        """Return them turned about the show's origin, clockwise from above, then moved by `offset_m` (3,)."""
        placed_m = self.coefficients_m @ turned(turn_deg)
        placed_m[:, 0] += offset_m
        placed_m.setflags(write=False)
        return Trajectories(self.index, self.durations_s, placed_m, self.begin_s, self.end_s)

    def hull_m(self) -> Array:
        """(2, 3) Least and greatest x, y, z of all Bezier control points: a box that no vehicle leaves."""
        points_m = bezier_of_power(self.coefficients_m)
        return np.stack([points_m.min(axis=(0, 1)), points_m.max(axis=(0, 1))])
