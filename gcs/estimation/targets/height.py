"""How high a target is, and how it climbs: a Kalman filter of constant velocity. Plain numbers, m and m/s."""

from dataclasses import dataclass
from math import sqrt
from typing import Final

AGILITY: Final = 0.3
"""Power of the random acceleration up and down, in m^2/s^3."""

CLIMB_M_S: Final = 1.0
"""Standard deviation of the climb of a target that was reported once."""

BELIEVED: Final = 3.0
"""A report that is farther off, in standard deviations, counts as this far: one that jumps moves little."""


@dataclass(frozen=True, slots=True)
class HeightBelief:
    """What is believed of a target's height at a time."""

    time_s: float
    height_m: float
    climb_m_s: float
    variance: tuple[float, float, float]  # of the height, of both together, of the climb

    @staticmethod
    def begun(time_s: float, height_m: float, deviation_m: float) -> "HeightBelief":
        """After a first report with this standard deviation."""
        return HeightBelief(time_s, height_m, 0.0, (deviation_m**2, 0.0, CLIMB_M_S**2))

    @property
    def deviation_m(self) -> float:
        """Standard deviation of the height."""
        return sqrt(self.variance[0])

    def foreseen(self, time_s: float) -> "HeightBelief":
        """What is believed of a later time; an earlier one counts as its own."""
        dt_s = max(time_s - self.time_s, 0.0)
        height, both, climb = self.variance
        grown = (
            height + dt_s * (2.0 * both + dt_s * climb) + AGILITY * dt_s**3 / 3.0,
            both + dt_s * climb + AGILITY * dt_s**2 / 2.0,
            climb + AGILITY * dt_s,
        )
        return HeightBelief(self.time_s + dt_s, self.height_m + dt_s * self.climb_m_s, self.climb_m_s, grown)

    def corrected(self, time_s: float, height_m: float, deviation_m: float) -> "HeightBelief":
        """With one more report; one that is older than the belief changes nothing."""
        if time_s < self.time_s:
            return self
        then = self.foreseen(time_s)
        height, both, climb = then.variance
        seen = height + deviation_m**2
        most_m = BELIEVED * sqrt(seen)
        off_m = min(max(height_m - then.height_m, -most_m), most_m)
        left = deviation_m**2 / seen
        return HeightBelief(
            then.time_s,
            then.height_m + off_m * height / seen,
            then.climb_m_s + off_m * both / seen,
            (height * left, both * left, climb - both * both / seen),
        )
