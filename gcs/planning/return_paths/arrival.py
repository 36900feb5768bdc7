"""When a returning vehicle comes down, and when its autopilot lands it: for flights and rehearsals alike."""

from typing import Final

import numpy as np

from gcs.model.state import Array, Mask

IN_PLACE_M: Final = 0.8
WELL_IN_PLACE_M: Final = 0.4
"""Where a slanting way ends: there is little height left to come nearer on the way down."""


def is_above(here_m: Array, place_m: Array, within_m: float = IN_PLACE_M) -> Mask:
    """(n,) whether each vehicle (n, 3) is within `within_m` of its place (n, 3) over the ground."""
    return np.asarray(np.hypot(here_m[:, 0] - place_m[:, 0], here_m[:, 1] - place_m[:, 1]) < within_m)


def may_hand_over(here_m: Array, place_m: Array, handover_m: float) -> Mask:
    """(n,) whether each vehicle is above its place and lower than `handover_m`: its autopilot may land it."""
    return is_above(here_m, place_m) & (place_m[:, 2] - here_m[:, 2] < handover_m)
