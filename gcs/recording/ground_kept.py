"""Whether vehicles stayed within areas, and would have fallen on controlled ground, by the record. Pure."""

from collections.abc import Callable, Sequence

import numpy as np

from gcs.model.state import Array
from gcs.recording.mcap_reader import Standard
from gcs.recording.trajectories import FlownTrajectories
from gcs.safety.controlled_ground import ground_margins
from gcs.safety.fenced_areas import beyond_m
from gcs.service.snapshots import GroundKept


def beyond_areas_m(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> Array | None:
    """(k, n) by how much each vehicle was beyond an area of the fence; None: there was none."""
    if not any(standard.safety.fence.areas for standard in standards):
        return None

    def over_m(standard: Standard, place_m: Array, _: Array) -> Array:
        return beyond_m(standard.safety.fence.areas, place_m)

    return _each(trajectories, standards, over_m)


def ground_kept(trajectories: FlownTrajectories, standards: Sequence[Standard]) -> GroundKept | None:
    """Least margin of the impacts of vehicles in the air, contacts of the hard line, and the greatest energy.

    None: no ground was controlled, or no vehicle was in the air.
    """
    if not any(standard.safety.fence.controlled_ground for standard in standards):
        return None

    def margin_m(standard: Standard, place_m: Array, velocity_m_s: Array) -> Array:
        ground, impact = standard.safety.fence.controlled_ground, standard.safety.impact
        if ground is None:
            return np.full(len(place_m), np.nan)
        return ground_margins(place_m, velocity_m_s, ground, impact).margin_m - impact.hard_m

    def energy_j(standard: Standard, place_m: Array, velocity_m_s: Array) -> Array:
        ground, impact = standard.safety.fence.controlled_ground, standard.safety.impact
        if ground is None:
            return np.full(len(place_m), np.nan)
        return ground_margins(place_m, velocity_m_s, ground, impact).impacts.energy_j

    flies = trajectories.airborne
    inside_m = np.where(flies, _each(trajectories, standards, margin_m), np.nan)
    energies_j = np.where(flies, _each(trajectories, standards, energy_j), np.nan)
    if not np.isfinite(inside_m).any():
        return None
    at, row = np.unravel_index(int(np.nanargmin(inside_m)), inside_m.shape)
    near = inside_m < 0.0
    begins = near & ~np.vstack([np.zeros_like(near[:1]), near[:-1]])
    hard_m = _standard(trajectories, standards, int(at)).safety.impact.hard_m
    return GroundKept(
        int(begins.sum()),
        int(near.any(axis=0).sum()),
        round(float(inside_m[at, row]) + hard_m, 2),
        trajectories.ids[row],
        trajectories.elapsed_s(at),
        round(float(np.nanmax(energies_j)), 1),
    )


def _standard(trajectories: FlownTrajectories, standards: Sequence[Standard], sample: int) -> Standard:
    return standards[0 if trajectories.held_at is None else int(trajectories.held_at[sample])]


def _each(
    trajectories: FlownTrajectories,
    standards: Sequence[Standard],
    of: Callable[[Standard, Array, Array], Array],
) -> Array:
    """(k, n) a value of every vehicle at every sample, by the standard that applied then."""
    shape = trajectories.airborne.shape
    values = np.full(shape, np.nan)
    at = np.zeros(shape[0], np.intp) if trajectories.held_at is None else trajectories.held_at
    for number, standard in enumerate(standards):
        samples = np.flatnonzero(at == number)
        place_m = np.asarray(trajectories.position_m[samples], np.float64).reshape(-1, 3)
        velocity_m_s = np.asarray(trajectories.velocity_m_s[samples], np.float64).reshape(-1, 3)
        values[samples] = of(standard, place_m, velocity_m_s).reshape(len(samples), shape[1])
    return values
