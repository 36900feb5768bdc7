"""Decides when a returning vehicle descends and when its autopilot lands it, in flights and rehearsals."""

from typing import Final

import numpy as np

from gcs.model.state import Array, Mask

IN_PLACE_M: Final = 0.8
WELL_IN_PLACE_M: Final = 0.4
"""Tolerance at the end of a slanting path: little height is left to come nearer during the descent."""


def is_above(here_m: Array, place_m: Array, within_m: float = IN_PLACE_M) -> Mask:
    """(n,) Whether each vehicle (n, 3) is within `within_m` of its place (n, 3) over the ground."""
    return np.asarray(np.hypot(here_m[:, 0] - place_m[:, 0], here_m[:, 1] - place_m[:, 1]) < within_m)


def may_hand_over(here_m: Array, place_m: Array, handover_m: float) -> Mask:
    """(n,) Whether each vehicle is above its place and lower than `handover_m`: its autopilot may land it."""
    return is_above(here_m, place_m) & (place_m[:, 2] - here_m[:, 2] < handover_m)
