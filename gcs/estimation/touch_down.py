"""Estimates from which height down a descending vehicle may be near the ground, and when it has met it. Pure.

A barometer, and a receiver without corrections, drift by metres within a flight. A vehicle that is lower than
its estimate says meets the ground before its height shows it.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model.state import Array, Landed

SLOWLY_M_S: Final = 0.4
"""Speed of a descent that may meet the ground, about that of an autopilot's own landing."""

DEVIATIONS: Final = 2.0
"""Of the vertical accuracy that the receiver reports, one sigma."""

LEAST_M: Final = 3.0
"""Drift that is always allowed for: a receiver that is certain of itself may drift with the estimate."""

MOST_M: Final = 5.0
"""Larger errors count as this: nothing descends slowly for minutes."""

STANDS_SHARE: Final = 0.3
"""Of its setpoint: a vehicle that sinks more slowly stands on something."""

PUSHES_M_S: Final = 0.2
"""Slower setpoints show nothing."""

STANDS_S: Final = 0.8
"""So long, and a round trip of the link: vertical velocities follow their setpoints within half a second."""


def height_error_m(accuracy_m: Array, departed_m: Array) -> Array:
    """(n,) By how much each vehicle may be lower than it reports.

    Args:
        accuracy_m: (n,) up, as reported, one sigma; NaN unknown, inf without a fix.
        departed_m: (n,) by how much the estimate has risen above its receiver's height; NaN unknown.
    """
    error_m = np.fmax(DEVIATIONS * accuracy_m, departed_m)
    return np.asarray(np.minimum(np.fmax(error_m, LEAST_M), MOST_M))


@dataclass(slots=True)
class GroundContact:
    """Whether one vehicle that is to descend stands on something. It needs no height."""

    _since_s: float = np.inf

    def note(
        self, now_s: float, desired_m_s: float, sinks_m_s: float, delay_s: float, landed: Landed
    ) -> bool:
        """Take the state at one tick.

        Args:
            now_s: of the tick.
            desired_m_s: setpoint down; NaN: none.
            sinks_m_s: reported velocity down; NaN: not known, or old.
            delay_s: of the link, one way.
            landed: as the autopilot reports.

        Returns: whether it stands.
        """
        if landed is Landed.ON_GROUND:
            return True
        if not (desired_m_s >= PUSHES_M_S and sinks_m_s <= STANDS_SHARE * desired_m_s):
            self._since_s = np.inf
            return False
        self._since_s = min(self._since_s, now_s)
        return now_s - self._since_s >= STANDS_S + 2.0 * delay_s
