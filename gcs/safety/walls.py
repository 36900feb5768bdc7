"""Walls that do not move: obstacles, lowest and greatest height, greatest distance."""

from collections.abc import Mapping

import numpy as np

from gcs.formation.obstacles import Ellipse
from gcs.safety.constraints import NOBODY, Braking, Constraints
from gcs.settings import Positive, Settings
from gcs.state import Array, Mask


class Fence(Settings):
    """Where vehicles may be: heights above the show's origin, and distance from it over the ground."""

    height_min_m: Positive = 3.0
    height_max_m: Positive = 100.0
    distance_max_m: Positive = 300.0


def fence_constraints(
    position_m: Array, commanded: Mask, descending: Mask, fence: Fence, braking: Braking
) -> Constraints:
    """Bound the speed towards the fence by what can still be braked.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        descending: (n,) True where a vehicle is on its way to the ground and may go below the least height.
        fence: where they may be.
        braking: how surely they stop.
    """
    height_m = -position_m[:, 2]
    up = np.broadcast_to(np.array([0.0, 0.0, -1.0]), position_m.shape)
    distance_m = np.hypot(position_m[:, 0], position_m[:, 1])
    inward = np.zeros_like(position_m)
    inward[:, :2] = -position_m[:, :2] / np.maximum(distance_m, 1e-9)[:, None]
    return Constraints.joined(
        _wall(commanded & ~descending, up, height_m - fence.height_min_m, "least height", braking),
        _wall(commanded, -up, fence.height_max_m - height_m, "greatest height", braking),
        _wall(commanded, inward, fence.distance_max_m - distance_m, "greatest distance", braking),
    )


def obstacle_constraints(
    position_m: Array,
    commanded: Mask,
    ellipses: Mapping[str, Ellipse],
    braking: Braking,
    *,
    fastest_m_s: float = np.inf,
) -> Constraints:
    """Bound the speed towards each obstacle: sideways below its top, downwards within it.

    Args:
        position_m: (n, 3), show frame.
        commanded: (n,).
        ellipses: by obstacle id; margin and headroom included.
        braking: how surely vehicles stop.
        fastest_m_s: nobody may fly faster, in any direction. Where twice that could still be braked, there
            is no constraint: no velocity within the limits breaks it.
    """
    height_m = -position_m[:, 2]
    parts = [Constraints.none()]
    for name, ellipse in ellipses.items():
        sideways_m = ellipse.distance_m(position_m)
        matters = commanded & (braking.speed_m_s(sideways_m) <= 2.0 * fastest_m_s)
        if not matters.any():
            continue
        above_m = height_m - ellipse.top_height_m
        outward = np.zeros_like(position_m)
        outward[:, :2] = ellipse.outward(position_m)
        over = sideways_m < 0.0  # also below the top, where one is led out sideways: no sinking meanwhile
        up = np.broadcast_to(np.array([0.0, 0.0, -1.0]), position_m.shape)
        parts.append(_wall(matters & (above_m < 0.0), outward, sideways_m, f"obstacle {name}", braking))
        sinking_m = np.maximum(above_m, 0.0)
        parts.append(_wall(commanded & over, up, sinking_m, f"obstacle {name} below", braking))
    return Constraints.joined(*parts)


def _wall(rows: Mask, inward: Array, gap_m: Array, reason: str, braking: Braking) -> Constraints:
    """Bound the speed against `inward` (n, 3) of those in `rows` by their gap (n,)."""
    index = np.flatnonzero(rows)
    return Constraints(
        index,
        np.full(len(index), NOBODY),
        np.array(inward[index]),
        -braking.speed_m_s(gap_m[index]),
        (reason,) * len(index),
    )
