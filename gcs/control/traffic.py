"""Which traffic counts for a formation: what it keeps clear of, and what operators are to know."""

from dataclasses import dataclass, replace
from math import isfinite
from typing import Final, NamedTuple

import numpy as np

from gcs.estimation.traffic import TracksNow, turned
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.model.traffic import Cylinder
from gcs.safety.near_traffic import TRACKS_MAX, WIDEST, NearTraffic
from gcs.safety.neighbours import Rows

BOXES_MAX: Final = 8
"""Most slow tracks that are flown round, beside the plan's obstacles."""

SOON_S: Final = 20.0
"""Tracks that cannot be near the formation within this time do not count yet."""

ABOVE_M: Final = 10.0
"""A slow track so far above the formation is no obstacle; one so far above or below it is not announced."""

ANNOUNCED_S, BESIDE_M = 60.0, 20.0
"""A track is announced if its cylinder will be so near to the formation, within this time."""

ARCS_S: Final = np.arange(0.0, 9.0, 2.0)
"""Times at which the arc of a track that turns is one of the straight ways that stand for it."""

WAYS_MAX: Final = 24
"""Most straight ways of all tracks: the arcs of the soonest that turn, a tangent of each other."""

UP_TO_M: Final = 10_000.0
"""Height of an obstacle with a height that is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class Sphere:
    """Where the formation is, as one."""

    center_m: Array  # (3,) show frame
    velocity_m_s: Array  # (3,)
    radius_m: float


class Approaches(NamedTuple):
    """When each track is nearest to the formation, if both go straight on, k rows."""

    after_s: Array  # (k,) 0: it is, or was
    apart_m: Array  # (k,) between the sphere and the cylinder then, sideways; negative: they overlap
    below_m: (
        Array  # (k,) of the cylinder under the sphere or above it then, in m; 0: at its height, or not known
    )
    now_m: Array  # (k,) between both now, sideways


def approaches(traffic: TracksNow, cylinder: Cylinder, sphere: Sphere) -> Approaches:
    """How near each track comes to the formation."""
    off_m = traffic.position_m[:, :2] - sphere.center_m[:2]
    moves_m_s = traffic.velocity_m_s[:, :2] - sphere.velocity_m_s[:2]
    speed2 = np.maximum((moves_m_s**2).sum(axis=1), 1e-6)
    after_s = np.maximum(-(off_m * moves_m_s).sum(axis=1) / speed2, 0.0)
    kept_m = cylinder.radius_m + sphere.radius_m
    then_m = np.hypot(*(off_m + after_s[:, None] * moves_m_s).T)
    height_m = -traffic.position_m[:, 2] - traffic.velocity_m_s[:, 2] * after_s + sphere.center_m[2]
    beyond_m = np.maximum(np.abs(height_m) - cylinder.half_height_m - sphere.radius_m, 0.0)
    return Approaches(after_s, then_m - kept_m, np.nan_to_num(beyond_m), np.hypot(*off_m.T) - kept_m)


def announced(traffic: TracksNow, cylinder: Cylinder, sphere: Sphere) -> list[int]:
    """Rows of tracks with a cylinder that comes to the formation within `ANNOUNCED_S`, the next first.

    Whether it flies on or stays: one that evades a track is to say so until that has passed. One that turns
    counts along its arc as well.
    """
    sideways_m, up_m = cylinder.deviations * np.sqrt(traffic.spread[:, :, 0].T)
    wider_m = np.minimum(sideways_m, (WIDEST - 1.0) * cylinder.radius_m)
    soonest_s = np.full(len(traffic.ids), np.inf)
    for each in (sphere, replace(sphere, velocity_m_s=np.zeros(3))):
        near = approaches(traffic, cylinder, each)
        close = (near.apart_m < wider_m + BESIDE_M) & (near.below_m < np.nan_to_num(up_m) + ABOVE_M)
        close &= near.after_s <= ANNOUNCED_S
        soonest_s[close] = np.minimum(soonest_s, near.after_s)[close]
    kept_m = cylinder.radius_m + sphere.radius_m + wider_m + BESIDE_M
    up_m = cylinder.half_height_m + sphere.radius_m + np.nan_to_num(up_m) + ABOVE_M
    after_s = np.arange(0.0, ARCS_S[-1] + 1.0)
    rows = np.repeat(np.flatnonzero(traffic.turn_rad_s), len(after_s))
    later_s = np.tile(after_s, len(rows) // len(after_s))
    moves = traffic.position_m[rows], traffic.velocity_m_s[rows], traffic.turn_rad_s[rows]
    off_m = turned(*moves, later_s)[0] - sphere.center_m - later_s[:, None] * sphere.velocity_m_s
    close = np.hypot(off_m[:, 0], off_m[:, 1]) < kept_m[rows]
    close &= ~(np.abs(off_m[:, 2]) > up_m[rows])  # a height that is not known is any
    np.minimum.at(soonest_s, rows[close], later_s[close])
    return sorted(np.flatnonzero(np.isfinite(soonest_s)).tolist(), key=lambda row: soonest_s[row])


def tracks_near(
    traffic: TracksNow, cylinder: Cylinder, sphere: Sphere, time_s: float
) -> tuple[NearTraffic | None, int]:
    """What vehicles keep clear of at `time_s`, the next to arrive first, and how many that leaves out."""
    if not traffic.ids:
        return None, 0
    speed_m_s = np.hypot(traffic.velocity_m_s[:, 0], traffic.velocity_m_s[:, 1])
    near = approaches(traffic, cylinder, sphere)
    reach_m = SOON_S * speed_m_s + 2.0 * (WIDEST * cylinder.radius_m + sphere.radius_m)
    low_m = -traffic.position_m[:, 2] - cylinder.half_height_m
    over = low_m > sphere.radius_m - sphere.center_m[2] + ABOVE_M  # False where the height is not known
    counts = near.now_m < reach_m
    soonest = np.argsort(near.now_m / np.maximum(speed_m_s, 1.0), kind="stable")
    fast = [row for row in soonest.tolist() if counts[row] and not traffic.slow[row]]
    slow = [row for row in soonest.tolist() if counts[row] and traffic.slow[row] and not over[row]]
    boxes = tuple(_box(traffic, row, cylinder, time_s) for row in slow[:BOXES_MAX])
    left_out = max(len(fast) - TRACKS_MAX, 0) + max(len(slow) - BOXES_MAX, 0)
    if not fast and not boxes:
        return None, 0
    rows = np.array(fast[:TRACKS_MAX], np.intp)
    turns, position_m, velocity_m_s, counts_s = _arcs(traffic, rows)
    rows, spread = rows[turns], traffic.spread[rows[turns]].copy()
    unknown = np.isnan(position_m[:, 2])
    half_m = np.where(unknown, np.inf, cylinder.half_height_m)
    position_m[unknown, 2], spread[unknown, 1] = 0.0, 0.0
    near_traffic = NearTraffic(
        tuple(traffic.ids[row] for row in rows),
        position_m,
        velocity_m_s,
        np.full(len(rows), cylinder.radius_m),
        half_m,
        spread,
        cylinder.deviations,
        boxes,
        counts_s,
    )
    return near_traffic, left_out


def _arcs(traffic: TracksNow, rows: Rows) -> tuple[Rows, Array, Array, tuple[Array, Array]]:
    """Straight ways in place of each track: one that turns has some, each for the time in which it is near.

    Returns: (m,) of which of the `rows` each is; (m, 3) places now and velocities; (m,) from when until when.
    """
    turn_rad_s = traffic.turn_rad_s[rows]
    turn_rad_s[np.flatnonzero(turn_rad_s)[max(WAYS_MAX - len(rows), 0) // (len(ARCS_S) - 1) :]] = 0.0
    after_s = np.where(turn_rad_s[:, None] != 0.0, ARCS_S, np.where(ARCS_S > 0.0, np.nan, 0.0))
    of, at = np.nonzero(np.isfinite(after_s))
    then_s, turns = ARCS_S[at], turn_rad_s[of]
    place_m, velocity_m_s = turned(
        traffic.position_m[rows[of]], traffic.velocity_m_s[rows[of]], turns, then_s
    )
    half_s = 0.5 * ARCS_S[1]
    last = (then_s == ARCS_S[-1]) | (turns == 0.0)
    counts_s = np.where(at == 0, 0.0, then_s - half_s), np.where(last, np.inf, then_s + half_s)
    return of, place_m - then_s[:, None] * velocity_m_s, velocity_m_s, counts_s


def _box(traffic: TracksNow, row: int, cylinder: Cylinder, time_s: float) -> Obstacle:
    """A slow track as a box from the ground up to the top of its cylinder."""
    x_m, y_m, z_m = traffic.position_m[row].tolist()
    x_m_s, y_m_s, _ = traffic.velocity_m_s[row].tolist()
    sideways_m, up_m = (cylinder.deviations * np.sqrt(traffic.spread[row, :, 0])).tolist()
    half_m = min(cylinder.radius_m + sideways_m, WIDEST * cylinder.radius_m)
    top_m = -z_m + min(cylinder.half_height_m + up_m, WIDEST * cylinder.half_height_m)
    top_m = top_m if isfinite(top_m) else UP_TO_M
    return Obstacle(
        f"traffic {traffic.ids[row]}", x_m, y_m, half_m, half_m, max(top_m, 0.1), x_m_s, y_m_s, time_s
    )
