"""What a flight within a site shows: vehicles outside, where they would have fallen, contacts of the lines.

Inside and outside, and the falls, are deliberately computed without the code that flies.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gcs.model.state import Array, Mask
from gcs.safety.controlled_ground import ground_margins
from gcs.safety.fenced_areas import FencedArea
from gcs.safety.surroundings import SafetySettings
from gcs.simulation.falls import fallen
from gcs.simulation.record import FlightRecord

IMPACTS: Final = 250
"""Moments at which the motors of a vehicle stop, of one flight; a quarter of them where it was nearest."""

SETTLES_S: Final = 5.0
"""A vehicle that began outside counts as soon as it has been inside for so long."""


@dataclass(frozen=True, slots=True)
class SiteFigures:
    """Vehicles within areas and over controlled ground."""

    outside: int  # vehicles that left an area, or entered closed space
    impacts: int  # falls that were computed
    impacts_outside: int  # of these, the ones that end outside the controlled ground
    contacts: int | None = None  # vehicles of which the impact came inside the hard line
    least_margin_m: float | None = None  # of an impact's disc to the edge
    energy_max_j: float | None = None  # greatest of an impact


def is_within(ring: Array, place_m: Array) -> Mask:
    """(k,) Which places (k, 2) are inside a ring (m, 2): the angles to its corners sum up to a whole turn."""
    from_m = ring[None] - place_m[:, None]
    after_m = np.roll(from_m, -1, axis=1)
    across = from_m[..., 0] * after_m[..., 1] - from_m[..., 1] * after_m[..., 0]
    turned_rad = np.arctan2(across, (from_m * after_m).sum(axis=2)).sum(axis=1)
    return np.asarray(np.abs(turned_rad) > np.pi)


def is_out(area: FencedArea, place_m: Array) -> Mask:
    """(k,) Which places (k, 3) are on the wrong side of an area."""
    within, height_m = is_within(np.array(area.corners_m), place_m[:, :2]), -place_m[:, 2]
    low_m, high_m = area.heights_m
    if area.inside:
        return ~within | (height_m > high_m)
    return within & (height_m > low_m) & (height_m < high_m)


def figures(record: FlightRecord) -> SiteFigures | None:
    """The figures of a flight. None: it has no site."""
    if record.within_m_s is None:
        return None
    safety = record.scenario.control.safety
    path_m, flies = record.path_m, np.array(record.in_air)
    pace_m_s = np.array(record.within_m_s)
    ticks, count = flies.shape
    out = np.zeros((ticks, count), np.bool_)
    for area in safety.fence.areas:
        out |= is_out(area, path_m.reshape(-1, 3)).reshape(ticks, count)
    counts = flies & _has_been_in(~out, round(SETTLES_S * record.scenario.world.tick_rate_hz))
    outside = int((out & counts).any(axis=0).sum())
    ground = safety.fence.controlled_ground
    if ground is None:
        return SiteFigures(outside, 0, 0)
    ring = np.array(ground.corners_m)
    margins = ground_margins(path_m.reshape(-1, 3), pace_m_s.reshape(-1, 3), ground, safety.impact)
    margin_m = margins.margin_m.reshape(ticks, count)
    settled = flies & _has_been_in(
        margin_m >= safety.impact.hard_m, round(SETTLES_S * record.scenario.world.tick_rate_hz)
    )
    random = np.random.default_rng([record.seed, 6])
    chosen = _moments(settled, margin_m, random)
    hit_m = _fallen(path_m.reshape(-1, 3)[chosen], pace_m_s.reshape(-1, 3)[chosen], safety, random, ring)
    nearest_m = margin_m[settled]
    return SiteFigures(
        outside,
        len(hit_m),
        int((~is_within(ring, hit_m)).sum()),
        int((settled & (margin_m < safety.impact.hard_m)).any(axis=0).sum()),
        round(float(nearest_m.min()), 3) if len(nearest_m) else None,
        round(float(margins.impacts.energy_j.reshape(ticks, count)[flies].max(initial=0.0)), 1),
    )


def _has_been_in(inside: Mask, ticks: int) -> Mask:
    """(t, n) When each vehicle counts: always if it began inside, else after so many ticks inside."""
    began = inside[0]
    run = np.zeros(inside.shape[1], np.intp)
    counts, counting = np.zeros_like(inside), began.copy()
    for tick in range(len(inside)):
        run = np.where(inside[tick], run + 1, 0)
        counting = counting | (run >= ticks)
        counts[tick] = counting
    return counts


def _moments(settled: Mask, margin_m: Array, random: np.random.Generator) -> NDArray[np.intp]:
    """(k,) Indices into (ticks * n) of the moments at which motors stop."""
    moments = np.flatnonzero(settled)
    if len(moments) <= IMPACTS:
        return moments
    nearest = moments[np.argsort(margin_m.ravel()[moments], kind="stable")[: IMPACTS // 4]]
    return np.concatenate([nearest, random.choice(moments, IMPACTS - len(nearest), replace=False)])


def _fallen(
    place_m: Array, pace_m_s: Array, safety: SafetySettings, random: np.random.Generator, ring: Array
) -> Array:
    """(2 k, 2) Where these fall: in a random wind up to the limit, and in the greatest one towards the edge.

    Each motor stops at once, or within the reaction that counts.
    """
    impact, count = safety.impact, len(place_m)
    turn_rad, share = random.uniform(0.0, 2.0 * np.pi, count), np.sqrt(random.uniform(0.0, 1.0, count))
    blown = share[:, None] * np.column_stack([np.cos(turn_rad), np.sin(turn_rad)])
    outward = _towards_edge(ring, place_m[:, :2])
    wind_m_s = np.zeros((2 * count, 3))
    wind_m_s[:, :2] = impact.wind_max_m_s * np.concatenate([blown, outward])
    late_s = impact.reaction_s * np.concatenate([random.uniform(0.0, 1.0, count), np.ones(count)])
    both_m, both_m_s = np.concatenate([place_m] * 2), np.concatenate([pace_m_s] * 2)
    hit_m, _, _ = fallen(
        both_m, both_m_s, wind_m_s, impact.falling, ground_m=impact.ground_m, reaction_s=late_s
    )
    return hit_m


def _towards_edge(ring: Array, place_m: Array) -> Array:
    """(k, 2) Unit vectors to the nearest points of the ring, found among many points of it."""
    after = np.roll(ring, -1, axis=0)
    points = np.concatenate([ring + share * (after - ring) for share in np.linspace(0.0, 1.0, 60)])
    away_m = points[None] - place_m[:, None]
    distance_m = np.linalg.norm(away_m, axis=2)
    nearest = away_m[np.arange(len(place_m)), distance_m.argmin(axis=1)]
    return np.asarray(nearest / np.maximum(distance_m.min(axis=1), 1e-9)[:, None])
