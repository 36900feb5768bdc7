"""How fast the clock of a show runs that follows another clock. Pure."""

from dataclasses import dataclass
from typing import Final

CHANGE_PER_S: Final = 0.5
"""Of the tempo, so that no velocity jumps; as for late vehicles (`gcs.shows.following`)."""

GAIN_PER_S: Final = 1.0
"""Share of the clock's error that is caught up in a second."""


@dataclass(frozen=True, slots=True)
class Tempo:
    """Rate of a show's clock; a step returns a new value."""

    rate: float = 1.0  # 0: the show stands still; never below
    rate_per_s: float = 0.0  # its change

    def step(self, desired: float, dt_s: float) -> "Tempo":
        """Return the tempo after `dt_s`, on the way to the desired rate."""
        if dt_s <= 0.0:
            return self
        most = CHANGE_PER_S * dt_s
        change = min(max(max(desired, 0.0) - self.rate, -most), most)
        return Tempo(self.rate + change, change / dt_s)


def desired_rate(behind_s: float, slope: float, catch_up: float) -> float:
    """Return the rate that takes the show's clock to the one that it follows.

    Args:
        behind_s: that one minus the show's clock.
        slope: how fast that one runs.
        catch_up: the share by which the show may run faster than drawn.
    """
    return min(max(slope + GAIN_PER_S * behind_s, 0.0), 1.0 + catch_up)
