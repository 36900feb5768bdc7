"""The way down of a vehicle that its autopilot lands where it is, while wind carries it off. Pure."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.model.plan import Obstacle
from gcs.model.state import TINY, Array

FAST_M_S: Final = 1.5
SLOW_M_S: Final = 0.5
SLOW_BELOW_M: Final = 10.0
"""Descents of an autopilot's LAND above and below this height: ArduPilot's as delivered, the slowest."""

SINKS_M_S: Final = 0.2
"""A vehicle that sinks faster comes to the ground by itself."""

STEP_M: Final = 1.0
POINTS: Final = (8, 400)
"""Least and greatest number of points of a way."""


@dataclass(frozen=True, slots=True, eq=False)
class WayDown:
    """Where a vehicle is expected from now until it has landed: k points, in order.

    Over the ground they lie on a straight line, and it goes along that evenly.
    """

    place_m: Array  # (k, 3) show frame
    after_s: Array  # (k,) from now on

    @property
    def end_m(self) -> Array:
        """(3,) where it comes down."""
        return np.asarray(self.place_m[-1])


def way_down(here_m: Array, drift_m_s: Array, ground_z_m: float = 0.0) -> WayDown:
    """The way from (3,) to the ground, straight down but for a drift (2,) that its autopilot cannot hold.

    Args:
        here_m: show frame, finite.
        drift_m_s: over the ground.
        ground_z_m: of the ground below, show frame.
    """
    height_m = max(ground_z_m - float(here_m[2]), 0.0)
    fast_s, slow_s = max(height_m - SLOW_BELOW_M, 0.0) / FAST_M_S, min(height_m, SLOW_BELOW_M) / SLOW_M_S
    least, most = POINTS
    apart_m = float(np.hypot(*drift_m_s)) * (fast_s + slow_s)
    after_s = np.linspace(0.0, fast_s + slow_s, min(max(int(apart_m / STEP_M), least), most))
    sunk_m = np.minimum(after_s, fast_s) * FAST_M_S + np.maximum(after_s - fast_s, 0.0) * SLOW_M_S
    level_m = here_m[:2] + after_s[:, None] * drift_m_s
    return WayDown(np.column_stack([level_m, here_m[2] + sunk_m]), after_s)


def nearest_m(way: WayDown, place_m: Array, velocity_m_s: Array, ground_z_m: float = 0.0) -> Array:
    """(n,) least distances, over the ground, of vehicles (n, 3) that go on with (n, 3); NaN: not known.

    The least distance of three assumptions about a vehicle that sinks: it goes on, it lies on the ground from
    when its present descent ends there, or from when an autopilot's slow descent below `SLOW_BELOW_M` does.
    """
    level_m_s, sinks_m_s = velocity_m_s[:, :2], velocity_m_s[:, 2]
    above_m = np.maximum(ground_z_m - place_m[:, 2], 0.0)
    sinks = sinks_m_s > SINKS_M_S
    soon_s = above_m / np.where(sinks, sinks_m_s, 1.0)
    late_s = np.maximum(soon_s, np.minimum(above_m, SLOW_BELOW_M) / SLOW_M_S)
    apart_m = np.full(len(place_m), np.inf)
    ends_s = np.full(len(place_m), way.after_s[-1])
    drift_m_s = (way.end_m - way.place_m[0])[:2] / max(way.after_s[-1], TINY)
    for at_s in (ends_s, np.where(sinks, soon_s, np.inf), np.where(sinks, late_s, np.inf)):
        stops_s = np.minimum(at_s, ends_s)
        begins_m, rest_s = way.place_m[0, :2] - place_m[:, :2], (ends_s - stops_s)[:, None]
        stopped_m = begins_m + stops_s[:, None] * (drift_m_s - level_m_s)
        offset_m = np.stack([begins_m, stopped_m, stopped_m + rest_s * drift_m_s])
        apart_m = np.minimum(apart_m, least_m(offset_m))
    return apart_m


def least_m(offset_m: Array) -> Array:
    """(n,) least lengths of offsets (k, n, 2) that change evenly from each to the next; NaN: not known.

    A vehicle that crosses the way between two of its points is near it only there.
    """
    from_m, along_m = offset_m[:-1], np.diff(offset_m, axis=0)
    share = -(from_m * along_m).sum(axis=-1) / np.maximum((along_m**2).sum(axis=-1), TINY)
    near_m = from_m + np.clip(share, 0.0, 1.0)[..., None] * along_m
    return np.asarray(np.hypot(near_m[..., 0], near_m[..., 1]).min(axis=0))


def nearest_to_paths_m(way: WayDown, segment_m: Array) -> Array:
    """(m,) least distances, over the ground, of a way from paths (m, 2, 3) that lost vehicles may take."""
    first_m, along_m = segment_m[:, 0, :2], segment_m[:, 1, :2] - segment_m[:, 0, :2]
    offset_m = way.place_m[:, None, :2] - first_m
    share = (offset_m * along_m).sum(axis=2) / np.maximum((along_m**2).sum(axis=1), TINY)
    offset_m = offset_m - np.clip(share, 0.0, 1.0)[..., None] * along_m
    return np.asarray(np.hypot(offset_m[..., 0], offset_m[..., 1]).min(axis=0))


def meets(way: WayDown, box: Obstacle, now_s: float, margin_m: float) -> bool:
    """Whether the way leads into a box, or `margin_m` beside or above it."""
    times_s = now_s + way.after_s
    center_m = np.array([box.position_m(time_s) for time_s in times_s.tolist()])
    half_m = np.array([box.half_length_x_m, box.half_length_y_m, box.height_m]) + margin_m
    offset_m = np.column_stack([way.place_m[:, :2] - center_m, np.minimum(way.place_m[:, 2], 0.0)])
    from_m, along_m = offset_m[:-1], np.diff(offset_m, axis=0)
    still = np.abs(along_m) < TINY
    one, other = ((side * half_m - from_m) / np.where(still, 1.0, along_m) for side in (-1.0, 1.0))
    within = np.abs(from_m) < half_m  # all the time, or never
    enters = np.where(still, np.where(within, 0.0, np.inf), np.minimum(one, other)).max(axis=1)
    leaves = np.where(still, 1.0, np.maximum(one, other)).min(axis=1)
    return bool((np.maximum(enters, 0.0) < np.minimum(leaves, 1.0)).any())
