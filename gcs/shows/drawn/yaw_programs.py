"""Yaw of a drawn show: set points with linear changes between them, for the whole fleet at once. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs.model.errors import ShapeError
from gcs.model.state import Array
from gcs.shows.drawn.piece_index import PieceIndex, Rows


@dataclass(frozen=True, slots=True, eq=False)
class YawProgram:
    """One vehicle's yaw set points: k times, and the yaw then. None are needed: the drawing has no yaw."""

    times_s: Array  # (k,) increasing
    yaw_rad: Array  # (k,) clockwise from the show's x axis; not wrapped: 3 pi turns on from 2 pi

    def __post_init__(self) -> None:
        """Raises: ShapeError when the shapes do not fit."""
        if self.times_s.shape != self.yaw_rad.shape or self.times_s.ndim != 1:
            raise ShapeError(f"{self.yaw_rad.shape} yaws for {self.times_s.shape} times")


NO_YAW = YawProgram(np.empty(0), np.empty(0))


@dataclass(frozen=True, slots=True, eq=False)
class YawPrograms:
    """The yaw of n vehicles, m set points in all; row i belongs to the show's vehicle i."""

    index: PieceIndex
    yaw_rad: Array  # (m,) at the set point; NaN for a vehicle without yaw
    rate_rad_s: Array  # (m,) from it to the next one; 0 after the last

    @staticmethod
    def joined(programs: Sequence[YawProgram]) -> "YawPrograms":
        """Lay out the set points of all vehicles, at least one vehicle."""
        if not programs:
            raise ShapeError("a yaw program is needed")
        starts_s = [program.times_s if len(program.times_s) else np.zeros(1) for program in programs]
        yaws_rad = [program.yaw_rad if len(program.yaw_rad) else np.full(1, np.nan) for program in programs]
        rates_rad_s = [
            np.append(np.diff(yaw_rad) / np.diff(times_s), 0.0)
            for times_s, yaw_rad in zip(starts_s, yaws_rad, strict=True)
        ]
        index = PieceIndex.of(starts_s)
        return YawPrograms(index, np.concatenate(yaws_rad), np.concatenate(rates_rad_s))

    def __len__(self) -> int:
        """Return the number of vehicles."""
        return len(self.index)

    def at(self, time_s: float | Array, vehicles: Rows | None = None) -> Array:
        """(n,) Yaw in rad, clockwise from the show's x axis, not wrapped; NaN where the drawing has none.

        Arguments as of `Trajectories.at`.
        """
        rows, since_s = self.index.at(time_s, vehicles)
        return np.asarray(self.yaw_rad[rows] + self.rate_rad_s[rows] * since_s)

    @property
    def turns(self) -> bool:
        """Whether a vehicle has a yaw other than 0."""
        return bool((np.nan_to_num(self.yaw_rad) != 0.0).any())

    def of_vehicle(self, row: int) -> YawProgram:
        """Return one vehicle's set points."""
        yaw_rad = self.yaw_rad[self.index.pieces(row)]
        return NO_YAW if np.isnan(yaw_rad).any() else YawProgram(self.index.starts_s(row), yaw_rad)

    def of_vehicles(self, rows: Sequence[int]) -> "YawPrograms":
        """Return the yaw of some vehicles, in that order."""
        return YawPrograms.joined([self.of_vehicle(row) for row in rows])
