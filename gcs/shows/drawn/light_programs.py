"""Light programs of a drawn show: constant colours and linear fades, for the whole fleet at once. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError
from gcs.model.state import Array
from gcs.shows.drawn.piece_index import PieceIndex, Rows


@dataclass(frozen=True, slots=True, eq=False)
class LightProgram:
    """One vehicle's colours: k pieces, each from one colour to another. The last colour stays."""

    times_s: Array  # (k + 1,) increasing, the first 0
    before: NDArray[np.uint8]  # (k, 3) red, green, blue at the beginning of each piece
    after: NDArray[np.uint8]  # (k, 3) at its end; the same for a constant colour

    def __post_init__(self) -> None:
        """Raises: ShapeError when the shapes do not fit."""
        if not (self.before.shape == self.after.shape == (len(self.times_s) - 1, 3)) or not len(self.before):
            raise ShapeError(f"{self.before.shape} colours for {len(self.times_s)} times")


def constant(red: int, green: int, blue: int) -> LightProgram:
    """Return one colour all along."""
    colour = np.array([[red, green, blue]], np.uint8)
    return LightProgram(np.array([0.0, 1.0]), colour, colour)


WHITE = constant(255, 255, 255)
"""Of a drawing without lights, as viewers show it."""


@dataclass(frozen=True, slots=True, eq=False)
class LightPrograms:
    """The light programs of n vehicles, m pieces in all; row i belongs to the show's vehicle i."""

    index: PieceIndex
    durations_s: Array  # (m,)
    before: NDArray[np.uint8]  # (m, 3)
    after: NDArray[np.uint8]  # (m, 3)

    @staticmethod
    def joined(programs: Sequence[LightProgram]) -> "LightPrograms":
        """Lay out the programs of all vehicles, at least one."""
        if not programs:
            raise ShapeError("a light program is needed")
        index = PieceIndex.of([program.times_s[:-1] for program in programs])
        durations_s = np.concatenate([np.diff(program.times_s) for program in programs])
        before = np.concatenate([program.before for program in programs])
        after = np.concatenate([program.after for program in programs])
        return LightPrograms(index, durations_s, before, after)

    def __len__(self) -> int:
        """Return the number of vehicles."""
        return len(self.index)

    @property
    def end_s(self) -> float:
        """Time at which the last program ends."""
        last = self.index.first[1:] - 1
        starts_s = [float(self.index.starts_s(row)[-1]) for row in range(len(self))]
        return float(np.max(starts_s + self.durations_s[last]))

    def at(self, time_s: float | Array, vehicles: Rows | None = None) -> Array:
        """(n, 3) Red, green and blue, 0 to 255, fades not rounded; arguments as of `Trajectories.at`."""
        rows, since_s = self.index.at(time_s, vehicles)
        share = np.minimum(since_s / self.durations_s[rows], 1.0)[:, None]
        before = self.before[rows].astype(np.float64)
        return np.asarray(before + share * (self.after[rows] - before))

    def colours_at(self, time_s: float | Array, vehicles: Rows | None = None) -> NDArray[np.uint8]:
        """(n, 3) Red, green and blue, rounded; arguments as of `Trajectories.at`."""
        return np.asarray(np.rint(self.at(time_s, vehicles)).astype(np.uint8))

    def of_vehicle(self, row: int) -> LightProgram:
        """Return one vehicle's program."""
        pieces = self.index.pieces(row)
        starts_s = self.index.starts_s(row)
        times_s = np.append(starts_s, starts_s[-1] + self.durations_s[pieces][-1])
        return LightProgram(times_s, self.before[pieces], self.after[pieces])

    def of_vehicles(self, rows: Sequence[int]) -> "LightPrograms":
        """Return the programs of some vehicles, in that order."""
        return LightPrograms.joined([self.of_vehicle(row) for row in rows])
