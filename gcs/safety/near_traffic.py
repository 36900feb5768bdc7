"""Fast traffic: vehicles are out of the way of its cylinder in time, sideways. Pure.

A track is a vertical cylinder about a place that moves on as it did. What it sweeps until it has passed is a
corridor. A vehicle in it leaves sideways, as fast as needed to be out when the cylinder arrives; one beside,
above or below the corridor does not enter it.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError
from gcs.model.plan import Obstacle
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import NO_ROW, Constraints, stopping_speed_m_s

TRACKS_MAX: Final = 16
"""Most tracks that a tick evades."""

AHEAD_S: Final = 4.0
"""A corridor counts from so long, and the time of the way across it, before the cylinder arrives."""

EARLY_S: Final = 1.5
"""A vehicle is out of the corridor so long before the cylinder arrives."""

LEAST_S: Final = 0.5
"""In less time nothing is evaded: the fastest velocity then."""

WIDEST: Final = 3.0
"""A cylinder is widened to at most so many times its radius, and its height alike."""

FAR_M: Final = 50.0
"""Farther from a corridor no vehicle is too fast to stop before it."""

FENCED_M: Final = 1.0
"""A way out ends so far inside the fence."""


@dataclass(frozen=True, slots=True, eq=False)
class NearTraffic:
    """Traffic near the formation at one time, k of them. Show frame. Owns its arrays."""

    names: tuple[str, ...] = ()
    position_m: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (k, 3)
    velocity_m_s: Array = field(default_factory=lambda: np.zeros((0, 3)))  # (k, 3)
    radius_m: Array = field(default_factory=lambda: np.zeros(0))  # (k,) of the cylinder
    half_height_m: Array = field(default_factory=lambda: np.zeros(0))  # (k,) inf: its height is not known
    spread: Array = field(
        default_factory=lambda: np.zeros((0, 2, 3))
    )  # (k, 2, 3) sideways and up, along each
    # axis: variance of the position, its covariance with the velocity, variance of that
    deviations: float = 3.0  # by so many standard deviations the cylinder is widened
    boxes: tuple[Obstacle, ...] = ()  # other tracks, slow enough to be flown round as obstacles

    def __post_init__(self) -> None:
        k = len(self.names)
        shapes = tuple(len(part) for part in (self.position_m, self.velocity_m_s, self.radius_m, self.spread))
        if shapes != (k, k, k, k):
            raise ShapeError(f"tracks: {shapes} for {k} of them")

    def __len__(self) -> int:
        return len(self.names)

    def widened_m(self, after_s: Array) -> tuple[Array, Array]:
        """Radius and half height (..., k) of the cylinders `after_s` (..., k) from now, uncertainty included.

        A track counts as going straight on: its turn is seen when it is reported.
        """
        later_s, (place, both, moves) = after_s[..., None], np.moveaxis(self.spread, 2, 0)
        wider_m = self.deviations * np.sqrt(np.maximum(place + later_s * (2.0 * both + later_s * moves), 0.0))
        radius_m = np.minimum(self.radius_m + wider_m[..., 0], WIDEST * self.radius_m)
        half_m = np.minimum(self.half_height_m + wider_m[..., 1], WIDEST * self.half_height_m)
        return radius_m, half_m


@dataclass(frozen=True, slots=True, eq=False)
class Evading:
    """What evades: vehicles, or the formation as one. n rows, show frame."""

    position_m: Array  # (n, 3)
    commanded: Mask  # (n,)
    desired_m_s: Array  # (n, 3) a vehicle leaves a corridor on the side to which this leads
    extra_m: Array  # (n,) by so much more each keeps away, to every side
    speed_max_m_s: Array  # (n,) sideways
    each: Array  # (4, n) as of `Braking.of_each`
    reach_m: float  # greatest distance from the show's origin


def track_constraints(evading: Evading, near_traffic: NearTraffic | None) -> Constraints:
    """Have every vehicle leave the corridors of tracks in time, and enter none."""
    if near_traffic is None or not len(near_traffic) or not evading.commanded.any():
        return Constraints.none()
    rows = np.flatnonzero(evading.commanded & np.isfinite(evading.position_m).all(axis=1))
    place_m = evading.position_m[rows]
    speed_m_s = np.maximum(np.hypot(*near_traffic.velocity_m_s[:, :2].T), TINY)
    along = near_traffic.velocity_m_s[:, :2] / speed_m_s[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    off_m = place_m[:, None, :2] - near_traffic.position_m[:, :2]
    ahead_m, beside_m = (off_m * along).sum(axis=2), (off_m * aside).sum(axis=2)  # (r, k)
    extra_m = evading.extra_m[rows][:, None]
    radius_m, half_m = near_traffic.widened_m(np.maximum(ahead_m / speed_m_s, 0.0))
    radius_m, half_m = radius_m + extra_m, half_m + extra_m
    arrives_s, gone_s = (ahead_m - radius_m) / speed_m_s, (ahead_m + radius_m) / speed_m_s
    fastest_m_s = np.maximum(evading.speed_max_m_s[rows][:, None], TINY)
    near = (gone_s > 0.0) & (arrives_s < AHEAD_S + 2.0 * radius_m / fastest_m_s)
    level_m = np.abs(beside_m) - radius_m
    upright_m, upward = _above_or_below(place_m, near_traffic, half_m, arrives_s, gone_s)
    kept = np.flatnonzero((near & (np.maximum(level_m, upright_m) < FAR_M)).ravel())
    if not len(kept):
        return Constraints.none()
    which, track = np.divmod(kept, len(near_traffic))
    level_m, upright_m, upward = level_m.ravel()[kept], upright_m.ravel()[kept], upward.ravel()[kept]
    each, row = evading.each[:, rows[which]], rows[which]
    side, needed_m_s = _way_out(
        evading,
        row,
        aside[track],
        beside_m.ravel()[kept],
        radius_m.ravel()[kept],
        near_traffic.radius_m[track] + evading.extra_m[row],
        _led_m(evading.desired_m_s[rows, :2] @ aside.T, beside_m, arrives_s, radius_m).ravel()[kept],
        arrives_s.ravel()[kept],
    )
    upright = (upright_m > 0.0) & (upright_m >= level_m)
    normal = np.zeros((len(kept), 3))
    normal[~upright, :2] = (side[:, None] * aside[track])[~upright]
    normal[upright, 2] = -upward[upright]
    bound_m_s = np.where(level_m < 0.0, needed_m_s, -stopping_speed_m_s(level_m, each))
    bound_m_s[upright] = -stopping_speed_m_s(upright_m, each)[upright]
    reasons = np.array([f"traffic {name}" for name in near_traffic.names], dtype=object)
    return Constraints(row, np.full(len(row), NO_ROW), normal, bound_m_s, reasons[track])


def _above_or_below(
    place_m: Array, near_traffic: NearTraffic, half_m: Array, arrives_s: Array, gone_s: Array
) -> tuple[Array, Array]:
    """(r, k) gap up or down to each cylinder while it passes, negative: none; and 1 above, -1 below it."""
    first_m, last_m = (
        -near_traffic.position_m[:, 2] - near_traffic.velocity_m_s[:, 2] * np.maximum(then_s, 0.0)
        for then_s in (arrives_s, gone_s)
    )
    height_m = -place_m[:, 2][:, None]
    above_m = height_m - (np.maximum(first_m, last_m) + half_m)
    below_m = np.minimum(first_m, last_m) - half_m - height_m
    return np.maximum(above_m, below_m), np.where(above_m >= below_m, 1.0, -1.0)


def _led_m(desired_m_s: Array, beside_m: Array, arrives_s: Array, radius_m: Array) -> Array:
    """(r, k) where the desired velocities (r, k) lead by then; near each other all take one side."""
    then_m = beside_m + desired_m_s * np.maximum(arrives_s - EARLY_S, LEAST_S)
    whole_m = np.broadcast_to(then_m.mean(axis=0), then_m.shape)
    together = np.abs(beside_m - beside_m.mean(axis=0)) < radius_m
    led_m: Array = np.where(together, whole_m, then_m)
    return led_m


def _way_out(
    evading: Evading,
    row: NDArray[np.intp],
    aside: Array,
    beside_m: Array,
    radius_m: Array,
    least_m: Array,
    then_m: Array,
    arrives_s: Array,
) -> tuple[Array, Array]:
    """(c,) sides, 1 along `aside` (c, 2) or -1, and the speeds to be out on it in time.

    The side is that of `then_m` (c,), where the desired velocity leads; the other where only that can be
    reached in time, or within the fence. In time is out of `least_m` (c,), the cylinder without what is not
    known of it: else a sphere is split by tracks that are known badly.
    """
    left_s = np.maximum(arrives_s - EARLY_S, LEAST_S)
    desired = np.where(np.abs(beside_m) < radius_m, np.where(then_m >= 0.0, 1.0, -1.0), np.sign(beside_m))
    inside = np.abs(beside_m) < radius_m
    cost_m_s = []
    for side in (desired, -desired):
        way_m = np.maximum(radius_m - side * beside_m, 0.0)
        there_m = evading.position_m[row, :2] + (side * way_m)[:, None] * aside
        fenced = np.hypot(*there_m.T) > evading.reach_m - FENCED_M
        cost_m_s.append((way_m / left_s, (least_m - side * beside_m) / left_s, fenced))
    (first_m_s, soonest_m_s, first_fenced), (other_m_s, _, other_fenced) = cost_m_s
    most_m_s = evading.speed_max_m_s[row]
    late = (soonest_m_s > most_m_s) & (other_m_s < first_m_s)
    turned = inside & ((late & ~other_fenced) | (first_fenced & ~other_fenced))
    side = np.where(turned, -desired, desired)
    return side, np.minimum(np.where(turned, other_m_s, first_m_s), most_m_s)
