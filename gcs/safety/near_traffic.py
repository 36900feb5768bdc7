"""Fast traffic: vehicles are out of the way of its cylinder in time, sideways. Pure.

A track is a vertical cylinder about a place that moves on as it did. What it sweeps until it has passed is a
corridor. A vehicle in it leaves sideways, as fast as needed to be out when the cylinder arrives; one beside,
above or below the corridor does not enter it.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gcs.model.errors import ShapeError
from gcs.model.plan import Obstacle
from gcs.model.state import TINY, Array, Mask
from gcs.safety.constraints import NO_ROW, Constraints, stopping_speed_m_s
from gcs.safety.neighbours import Rows

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

KEPT: Final = 0.5
BEGUN_M_S: Final = 1.0
"""A side that is flown to, so fast, is kept against this share of what is not known of the track."""

FAR_M: Final = 50.0
"""Farther from a corridor no vehicle is too fast to stop before it."""

SOONEST: Final = 5
"""A vehicle keeps clear of so many ways of tracks at a time, the first to arrive: each is a row."""

HEADINGS: Final = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)
"""Directions of the ways out of several corridors that are compared."""

LACKS: Final = 4.0
TURNED: Final = 0.2
"""Weights of what is missing of a cylinder, and of a turn from the desired velocity."""

ALIKE_M: Final = 7.0
"""Vehicles nearer to each other choose alike: ways of neighbours that cross would contradict each other.

Much farther, many at one side would keep a vehicle at the other from leaving by its own, shorter way.
"""

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
    counts_s: tuple[Array, Array] | None = None  # (k,) from when until when each counts; None: always

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


@dataclass(frozen=True, slots=True, eq=False)
class _Corridors:
    """What the k ways of tracks sweep, as r vehicles see it."""

    names: tuple[str, ...]  # (k,)
    aside: Array  # (k, 2) to the left of each
    beside_m: Array  # (r, k) to the left of its middle, as the others
    radius_m: Array  # with what is not known
    least_m: Array  # without it
    arrives_s: Array  # the cylinder
    gone_s: Array

    @property
    def left_s(self) -> Array:
        """(r, k) time to be out."""
        return np.maximum(self.arrives_s - EARLY_S, LEAST_S)

    def seen_by(self, rows: Mask) -> "_Corridors":
        parts = self.beside_m, self.radius_m, self.least_m, self.arrives_s, self.gone_s
        return _Corridors(self.names, self.aside, *(part[rows] for part in parts))


def _corridors(near_traffic: NearTraffic, place_m: Array, extra_m: Array) -> tuple[_Corridors, Array]:
    """Those that vehicles at (r, 3) see, which keep (r, 1) farther away; and (r, k) half their heights."""
    speed_m_s = np.maximum(np.hypot(*near_traffic.velocity_m_s[:, :2].T), TINY)
    along = near_traffic.velocity_m_s[:, :2] / speed_m_s[:, None]
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    off_m = place_m[:, None, :2] - near_traffic.position_m[:, :2]
    ahead_m, beside_m = (off_m * along).sum(axis=2), (off_m * aside).sum(axis=2)
    radius_m, half_m = near_traffic.widened_m(np.maximum(ahead_m / speed_m_s, 0.0))
    radius_m, half_m = radius_m + extra_m, half_m + extra_m
    least_m = np.broadcast_to(near_traffic.radius_m + extra_m, beside_m.shape)
    arrives_s, gone_s = (ahead_m - radius_m) / speed_m_s, (ahead_m + radius_m) / speed_m_s
    return _Corridors(near_traffic.names, aside, beside_m, radius_m, least_m, arrives_s, gone_s), half_m


def track_constraints(evading: Evading, near_traffic: NearTraffic | None) -> Constraints:
    """Have every vehicle leave the corridors of tracks in time, and enter none."""
    if near_traffic is None or not len(near_traffic) or not evading.commanded.any():
        return Constraints.none()
    rows = np.flatnonzero(evading.commanded & np.isfinite(evading.position_m).all(axis=1))
    place_m = evading.position_m[rows]
    ways, half_m = _corridors(near_traffic, place_m, evading.extra_m[rows][:, None])
    fastest_m_s = np.maximum(evading.speed_max_m_s[rows][:, None], TINY)
    near = (ways.gone_s > 0.0) & (ways.arrives_s < AHEAD_S + 2.0 * ways.radius_m / fastest_m_s)
    if near_traffic.counts_s is not None:
        from_s, until_s = near_traffic.counts_s
        near &= (ways.gone_s > from_s) & (ways.arrives_s < until_s)
    level_m = np.abs(ways.beside_m) - ways.radius_m
    upright_m, upward = _above_or_below(place_m, near_traffic, half_m, ways.arrives_s, ways.gone_s)
    near &= np.maximum(level_m, upright_m) < FAR_M
    near &= np.where(near, ways.arrives_s, np.inf).argsort(axis=1).argsort(axis=1) < SOONEST
    kept = np.flatnonzero(near.ravel())
    if not len(kept):
        return Constraints.none()
    which, track = np.divmod(kept, len(near_traffic))
    row = rows[which]
    led_m = _led_m(evading.desired_m_s[rows, :2] @ ways.aside.T, ways.beside_m, ways.arrives_s, ways.radius_m)
    parts = (ways.beside_m, ways.radius_m, ways.least_m, led_m, ways.arrives_s)
    side, needed_m_s = _way_out(evading, row, ways.aside[track], *(part.ravel()[kept] for part in parts))
    by_height = (upright_m > 0.0) & (upright_m >= level_m)
    counts, upright = near & ~by_height, by_height.ravel()[kept]
    side, needed_m_s = _out_of_several(evading, rows, ways, counts, which, track, side, needed_m_s)
    level_m, upright_m, upward = (part.ravel()[kept] for part in (level_m, upright_m, upward))
    each, normal = evading.each[:, row], np.zeros((len(kept), 3))
    normal[~upright, :2] = (side[:, None] * ways.aside[track])[~upright]
    normal[upright, 2] = -upward[upright]
    bound_m_s = np.where(level_m < 0.0, needed_m_s, -stopping_speed_m_s(level_m, each))
    bound_m_s[upright] = -stopping_speed_m_s(upright_m, each)[upright]
    reasons = np.array([f"traffic {name}" for name in near_traffic.names], dtype=object)
    return Constraints(row, np.full(len(row), NO_ROW), normal, bound_m_s, reasons[track])


def _out_of_several(
    evading: Evading,
    rows: Rows,
    ways: _Corridors,
    counts: Mask,
    which: Rows,
    track: Rows,
    side: Array,
    needed_m_s: Array,
) -> tuple[Array, Array]:
    """Sides (c,) and speeds with which a vehicle in several corridors leaves all of them by one velocity."""
    way_m = (side * needed_m_s * ways.left_s[which, track])[:, None] * ways.aside[track]
    several = _in_several(ways, counts, which, track, way_m)
    if not several.any():
        return side, needed_m_s
    own = rows[several]
    fastest_m_s = np.maximum(evading.speed_max_m_s[own], TINY)
    leaving = _Leaving(
        evading.position_m[own, :2],
        evading.desired_m_s[own, :2],
        fastest_m_s,
        ways.seen_by(several),
        counts[several],
    )
    sides, most_m_s = leaving.chosen(evading.reach_m)
    both, at = several[which], np.cumsum(several) - 1
    return (
        np.where(both, sides[at[which], track], side),
        np.where(both, np.minimum(needed_m_s, most_m_s[at[which], track]), needed_m_s),
    )


def _in_several(ways: _Corridors, counts: Mask, which: Rows, track: Rows, way_m: Array) -> Mask:
    """(r,) which are in the corridors of two tracks, or leave one by a way (c, 2) into another."""
    inside = counts & (np.abs(ways.beside_m) < ways.radius_m)
    several: Mask = ((inside @ _of_tracks(ways.names)) > 0).sum(axis=1) > 1
    alone = np.flatnonzero(inside[which, track] & ~several[which])
    of, number = which[alone], np.unique(np.array(ways.names), return_inverse=True)[1]
    then_m = np.sign(ways.beside_m[of]) * (ways.beside_m[of] + way_m[alone] @ ways.aside.T)
    enters = counts[of] & (then_m < ways.radius_m[of]) & (number != number[track[alone]][:, None])
    several[of[enters.any(axis=1)]] = True
    return several


def _of_tracks(names: tuple[str, ...]) -> Array:
    """(k, t) 1 where a way is of a track."""
    of: Array = np.equal.outer(np.array(names), np.unique(np.array(names))).astype(float)
    return of


@dataclass(frozen=True, slots=True, eq=False)
class _Leaving:
    """Vehicles (r,) in several corridors (k,): one velocity of each is to lead out of all of them."""

    position_m: Array  # (r, 2)
    desired_m_s: Array  # (r, 2)
    fastest_m_s: Array  # (r,)
    ways: _Corridors
    counts: Mask  # (r, k)

    def chosen(self, reach_m: float) -> tuple[Array, Array]:
        """(r, k) sides to which the best ways lead, and how fast.

        Best is the least that is missing of the worst cylinder, then of the corridors as wide as they are
        with what is not known, then what is near the desired velocity; in the mean of a vehicle and those
        around it.
        """
        fastest_m_s = self.fastest_m_s[:, None, None]
        slower = np.minimum(1.0, fastest_m_s[:, 0] / np.maximum(np.hypot(*self.desired_m_s.T), TINY)[:, None])
        desired_m_s = (self.desired_m_s * slower)[:, None]
        ways_m_s = np.concatenate([desired_m_s, fastest_m_s * HEADINGS], axis=1)  # (r, w, 2)
        aside_m_s = ways_m_s @ self.ways.aside.T  # (r, w, k)
        then_m = self.ways.beside_m[:, None] + aside_m_s * self.ways.left_s[:, None]
        outside = (np.abs(self.ways.beside_m) >= self.ways.radius_m)[:, None]
        side = np.where(outside, np.sign(self.ways.beside_m)[:, None], np.where(then_m >= 0.0, 1.0, -1.0))
        lacks, less = (
            np.where(self.counts[:, None], np.maximum(1.0 - side * then_m / kept_m[:, None], 0.0), 0.0)
            for kept_m in (self.ways.least_m, self.ways.radius_m)
        )
        ends_m = (
            self.position_m[:, None]
            + ways_m_s * np.where(self.counts, self.ways.left_s, 0.0).max(axis=1)[:, None, None]
        )
        fenced = np.hypot(ends_m[..., 0], ends_m[..., 1]) > reach_m - FENCED_M
        turned = np.hypot(*np.moveaxis(ways_m_s - desired_m_s, 2, 0)) / self.fastest_m_s[:, None]
        cost = LACKS * lacks.max(axis=2) + (less @ self._weights())[..., 0] + fenced + TURNED * turned
        off_m = self.position_m[:, None] - self.position_m
        alike = np.exp(-(off_m**2).sum(axis=2) / ALIKE_M**2)
        best = (alike @ cost / alike.sum(axis=1, keepdims=True)).argmin(axis=1)
        of = np.arange(len(best))
        return side[of, best], (side * aside_m_s)[of, best]

    def _weights(self) -> Array:
        """(r, k, 1) weights of the ways that count: those of one track weigh as much as those of another."""
        of = _of_tracks(self.ways.names)
        shares = self.counts / np.maximum((self.counts @ of) @ of.T, 1.0)
        weights: Array = (shares / shares.sum(axis=1, keepdims=True))[..., None]
        return weights


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
    row: Rows,
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
    begun = np.clip((evading.desired_m_s[row, :2] * aside).sum(axis=1) / BEGUN_M_S, -1.0, 1.0)
    kept_m = KEPT * (radius_m - least_m) * begun
    desired = np.where(
        np.abs(beside_m) < radius_m, np.where(then_m + kept_m >= 0.0, 1.0, -1.0), np.sign(beside_m)
    )
    inside = np.abs(beside_m) < radius_m
    cost_m_s = []
    for side in (desired, -desired):
        way_m = np.maximum(radius_m - side * beside_m, 0.0)
        least_way_m = np.maximum(least_m - side * beside_m, 0.0)
        there_m = evading.position_m[row, :2] + (side * least_way_m)[:, None] * aside
        fenced = np.hypot(*there_m.T) > evading.reach_m - FENCED_M
        cost_m_s.append((way_m / left_s, (least_m - side * beside_m) / left_s, fenced))
    (first_m_s, soonest_m_s, first_fenced), (other_m_s, other_soonest_m_s, other_fenced) = cost_m_s
    most_m_s = evading.speed_max_m_s[row]
    spare_m_s = np.abs(kept_m) / left_s
    better = other_soonest_m_s + 2.0 * spare_m_s < soonest_m_s
    late = (soonest_m_s > most_m_s) & (better | (other_soonest_m_s + spare_m_s <= most_m_s))
    turned = inside & ((late & ~other_fenced) | (first_fenced & ~other_fenced))
    side = np.where(turned, -desired, desired)
    return side, np.minimum(np.where(turned, other_m_s, first_m_s), most_m_s)
