"""How vehicles follow a drawn part: which trajectory each flies, when the clock waits, which lag. Pure."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy  # its parts are loaded on first use: 30 MB, which most flights do not need
from numpy.typing import NDArray

from gcs.control.inputs import DrawnGoals
from gcs.model.state import TINY, Array
from gcs.shows.drawn import Motion
from gcs.shows.format import Drawing

THERE_M: Final = 0.5
"""A part begins once all vehicles are this near to where it begins."""

APPROACH_MAX_S: Final = 60.0
"""A part begins after this time, also without a vehicle that cannot reach its place."""

WAITS_MAX_S: Final = 30.0
"""The clock waits no longer than this in a row: a vehicle that cannot catch up must not stop the show."""

RATE_CHANGE_PER_S: Final = 0.5
"""Of the clock's rate when it stops and starts, so that no velocity jumps."""

AT_REST_M_S: Final = 0.5
"""A part in which no vehicle begins faster than this begins at once with the clock's full rate."""


def load_assignment() -> None:
    """Load what `assigned` needs: 0.3 s, or seconds on a busy machine, for which no tick waits."""
    assigned(np.zeros((1, 3)), np.zeros((1, 3)))


def assigned(start_m: Array, first_m: Array) -> NDArray[np.intp]:
    """(k,) Row of the trajectory for each vehicle: least sum of squared distances over the ground.

    Squared distances leave no two straight ways that cross.

    Args:
        start_m: (k, 3) where the vehicles start.
        first_m: (n, 3) where the trajectories begin, n >= k.
    """
    away_m = start_m[:, None, :2] - first_m[None, :, :2]
    rows, columns = scipy.optimize.linear_sum_assignment((away_m**2).sum(axis=2))
    goals = np.zeros(len(start_m), dtype=np.intp)
    goals[rows] = columns
    return goals


@dataclass(frozen=True, slots=True)
class DrawnPace:
    """How the show's clock runs in a drawn part; a step returns a new value."""

    approaches: bool = True  # vehicles are on their way to where the part begins; the clock stands
    rate: float = 0.0  # of the clock, from 0 to 1
    rate_per_s: float = 0.0  # change of the rate
    for_s: float = 0.0  # how long they have approached, or the clock has waited

    def step(self, motion: Motion, off_m: Array, dt_s: float, drawing: Drawing) -> "DrawnPace":
        """Return the pace after `dt_s`.

        Args:
            motion: of the k vehicles that take part, at the clock's time and full rate.
            off_m: (k,) distance of each from its trajectory; NaN: its position is not known.
            dt_s: since the step before.
            drawing: says whether the clock waits, and from which distance.
        """
        farthest_m = float(np.nanmax(off_m, initial=0.0))
        if self.approaches:
            there = bool(np.isfinite(off_m).any()) and farthest_m <= THERE_M
            if not there and self.for_s < APPROACH_MAX_S:
                return replace(self, for_s=self.for_s + dt_s)
            fastest_m_s = float(np.linalg.norm(motion.velocity_m_s, axis=1).max(initial=0.0))
            return DrawnPace(approaches=False, rate=1.0 if fastest_m_s < AT_REST_M_S else 0.0)
        waits_m = drawing.waits_from_m * (0.5 if self.rate_per_s < 0.0 or self.rate == 0.0 else 1.0)
        late = drawing.late == "wait" and farthest_m > waits_m
        waits = late and self.for_s < WAITS_MAX_S
        change = min(
            max((0.0 if waits else 1.0) - self.rate, -RATE_CHANGE_PER_S * dt_s), RATE_CHANGE_PER_S * dt_s
        )
        for_s = self.for_s + dt_s if late else 0.0
        return DrawnPace(False, self.rate + change, change / dt_s, for_s)

    def goals(
        self, motion: Motion, rows: NDArray[np.intp], count: int, yaw_rad: Array | None = None
    ) -> DrawnGoals:
        """Return what the tick follows.

        Args:
            motion: of k vehicles, at the clock's time and full rate.
            rows: (k,) of these vehicles among the `count` of the fleet.
            count: n.
            yaw_rad: (k,) from the show's x axis, NaN: the drawing has none; None: it is not flown.
        """
        goals = [np.full((count, 3), np.nan) for _ in range(3)]
        goals[0][rows] = motion.position_m
        goals[1][rows] = self.rate * motion.velocity_m_s
        goals[2][rows] = self.rate**2 * motion.acceleration_m_s2 + self.rate_per_s * motion.velocity_m_s
        turned_rad = None
        if yaw_rad is not None:
            turned_rad = np.full(count, np.nan)
            turned_rad[rows] = yaw_rad
        return DrawnGoals(goals[0], goals[1], goals[2], turned_rad)


@dataclass(frozen=True, slots=True, eq=False)
class TrackErrors:
    """Distances of k vehicles from their trajectories while a drawn part ran."""

    square_m2_s: Array  # (k,) squared distance, integrated over time
    time_s: Array  # (k,)
    max_m: Array  # (k,)

    @staticmethod
    def none(count: int) -> "TrackErrors":
        """Nothing was flown yet."""
        return TrackErrors(*np.zeros((3, count)))

    def noted(self, off_m: Array, dt_s: float) -> "TrackErrors":
        """Return them with (k,) distances that lasted `dt_s`; NaN: not flown, or not known."""
        located = np.isfinite(off_m)
        square_m2_s = self.square_m2_s + np.where(located, off_m**2, 0.0) * dt_s
        return TrackErrors(
            square_m2_s, self.time_s + located * dt_s, np.fmax(self.max_m, np.where(located, off_m, 0.0))
        )

    @property
    def rms_m(self) -> Array:
        """(k,) Root mean square over time; 0 where nothing was flown."""
        return np.asarray(np.sqrt(self.square_m2_s / np.maximum(self.time_s, TINY)))

    @property
    def fleet_rms_m(self) -> float:
        """Root mean square over time and vehicles."""
        return float(np.sqrt(self.square_m2_s.sum() / max(float(self.time_s.sum()), TINY)))
