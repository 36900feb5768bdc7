"""Frames that did not come from where their system is known, grouped, so that each group is judged once."""

from typing import Final, NamedTuple

import numpy as np

from gcs.mavlink.kernels import COMPONENT, DATAGRAM, SYSTEM, Whole
from gcs.model.jit import kernel
from gcs.model.state import Mask

JUDGED_MAX: Final = 64
STRANGERS_MAX: Final = 8
"""Groups of configured systems, and of others, that are judged of one read."""

_NONE: Final = -1


class OddFrames(NamedTuple):
    """Groups of one source, system and component, in order of their first frames."""

    group: Whole  # (k,) of each frame, _NONE: of none
    first: Whole  # (g,) place of the first frame of each group
    size: Whole  # (g,) its frames
    strangers: int  # frames of further groups, of systems that are not configured
    others: int  # and of configured ones


@kernel
def _grouped(frames: Whole, source: Whole, rows: Whole, taken: Mask) -> tuple[Whole, Whole, Whole, int, int]:
    """As `odd_frames`."""
    group, most = np.full(len(frames), _NONE), JUDGED_MAX + STRANGERS_MAX
    first, count = np.empty(most, np.int64), np.zeros(most, np.int64)
    groups, left, over = 0, np.array([STRANGERS_MAX, JUDGED_MAX]), np.zeros(2, np.int64)
    for k in range(len(frames)):
        if taken[k]:
            continue
        at = 0
        while at < groups and not (
            frames[k, SYSTEM] == frames[first[at], SYSTEM]
            and frames[k, COMPONENT] == frames[first[at], COMPONENT]
            and source[frames[k, DATAGRAM]] == source[frames[first[at], DATAGRAM]]
        ):
            at += 1
        is_configured = np.int64(rows[k] >= 0)
        if at == groups:
            if left[is_configured] == 0:
                over[is_configured] += 1
                continue
            left[is_configured] -= 1
            first[at] = k
            groups += 1
        group[k] = at
        count[at] += 1
    return group, first[:groups], count[:groups], over[0], over[1]


def odd_frames(frames: Whole, source: Whole, rows: Whole, taken: Mask) -> OddFrames:
    """Group the frames that are not taken yet.

    Args:
        frames: (k, FRAME_COLUMNS).
        source: (m,) of each datagram.
        rows: (k,) of each frame, negative: of a system that is not configured.
        taken: (k,)
    """
    return OddFrames(*_grouped(frames, source, rows, taken))
