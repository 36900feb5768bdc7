"""Descending vehicles that were pushed off their places: which go back there, and which land where they are.

Close above the ground the way back leads past vehicles that have landed, and the pads are too near each other
for that. Pure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Target
from gcs.model.state import TINY, Array, Mask
from gcs.safety.fenced_areas import beyond_m
from gcs.safety.surroundings import SafetySettings
from gcs.safety.target_clearance import kept_clear_m

OFF_PLACE_M: Final = 2.0
"""A descending vehicle that others pushed farther from its place than this and its margin goes back there
above the least height, unless it lands where it is. One that does not know its position lands where it is.
"""

DOWN_S: Final = 5.0
"""From the height at which vehicles count to the ground; so long no moving box may come to the place."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """What is on the ground, and comes down to it. n rows, show frame."""

    position_m: Array  # (n, 3); NaN: not known
    goal_m: Array  # (n, 3) where each is led; NaN: nowhere
    uncertainty_m: Array  # (n,) standard deviations of the positions, sideways
    path_m: Array  # (m, 2, 3) that lost vehicles may take
    ellipses: Mapping[str, Ellipse]
    targets: Sequence[Target]
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Landing:
    """How descending vehicles come down. Rows as in `Ground`."""

    descending: Mask  # (n,) descends, onto its place or beside it
    low: Mask  # (n,) goes back to its place, and stays low until no other vehicle is beside it
    goal_m: Array  # (n, 3) where each is led: below it where it lands beside its place, level where it is low


def landing_beside(ground: Ground, descending: Mask, safety: SafetySettings) -> Landing:
    """Decide for each vehicle that descends to land (n,) how it does.

    Off its place it goes back, above the least height. Below the height at which pairs count it lands where
    it is instead, where the ground is clear. Where it is not, it climbs once no other vehicle is beside it.
    """
    off_m = _apart_m(ground.goal_m, ground.position_m)
    margin_m = safety.floor.deviations * ground.uncertainty_m
    off = descending & (off_m > OFF_PLACE_M + margin_m)  # False for NaN
    rows = np.flatnonzero(off & is_low(ground.position_m, safety))
    # on its way to another place, because its own was closed, a vehicle is led up first
    clear = is_low(ground.goal_m[rows], safety)
    clear &= np.array([is_clear(ground, row, safety) for row in rows.tolist()], np.bool_)
    comes_down, low = descending & ~off, np.zeros_like(descending)
    comes_down[rows[clear]] = True
    for row in rows[~clear].tolist():
        kept_m = safety.floor.horizontal_m + safety.floor.margin_m
        low[row] = _nearest_low_m(ground, row, safety) < kept_m
    goal_m = ground.goal_m
    if len(rows):
        goal_m = goal_m.copy()
        goal_m[rows[clear], :2] = ground.position_m[rows[clear], :2]
        goal_m[low, 2] = ground.position_m[low, 2]
    return Landing(comes_down, low, goal_m)


def is_low(place_m: Array, safety: SafetySettings) -> Mask:
    """(n,) Which of (n, 3) are below the height from which pairs of vehicles count; False for NaN."""
    return np.asarray(-place_m[:, 2] < safety.floor.pad_height_m)


def is_clear(ground: Ground, row: int, safety: SafetySettings) -> bool:
    """Whether the vehicle of that row can land where it is: on no other and no place of one."""
    here_m, floor = ground.position_m[row : row + 1], safety.floor
    own_m = ground.uncertainty_m[row]
    kept_m = floor.horizontal_m + floor.margin_m + floor.reserve_m(own_m, ground.uncertainty_m)
    others = np.arange(len(ground.position_m)) != row
    near = others & (_apart_m(ground.position_m, here_m) < kept_m)
    below = near & (ground.position_m[:, 2] > here_m[0, 2] - floor.vertical_m)
    taken = others & (_apart_m(ground.goal_m, here_m) < kept_m) & is_low(ground.goal_m, safety)
    if (below | taken).any() or _on_path(ground, here_m, float(kept_m.max())):
        return False
    areas = (*safety.fence.areas, *filter(None, [safety.fence.controlled_ground]))
    if float(beyond_m(areas, np.ascontiguousarray(here_m[:, :2]))[0]) > 0.0:
        return False
    return not (_under_box(ground, here_m) or _at_target(ground, here_m, float(own_m), safety))


def _nearest_low_m(ground: Ground, row: int, safety: SafetySettings) -> float:
    """How far, over the ground, the nearest other vehicle is that is low as well."""
    apart_m = _apart_m(ground.position_m, ground.position_m[row : row + 1])
    apart_m[row] = np.nan
    return float(np.nanmin(np.where(is_low(ground.position_m, safety), apart_m, np.nan), initial=np.inf))


def _on_path(ground: Ground, here_m: Array, kept_m: float) -> bool:
    first_m, along_m = ground.path_m[:, 0, :2], ground.path_m[:, 1, :2] - ground.path_m[:, 0, :2]
    offset_m = here_m[:, :2] - first_m
    share = (offset_m * along_m).sum(axis=1) / np.maximum((along_m**2).sum(axis=1), TINY)
    offset_m = offset_m - np.clip(share, 0.0, 1.0)[:, None] * along_m
    return bool((np.hypot(offset_m[:, 0], offset_m[:, 1]) < kept_m).any())


def _under_box(ground: Ground, here_m: Array) -> bool:
    """Whether a box is there with its margin, or comes there before the vehicle has landed."""
    for ellipse in ground.ellipses.values():
        place, moves_per_s = ellipse.normalised(here_m)[0], ellipse.velocity_m_s / ellipse.semi_m
        nearest_s = float(place @ moves_per_s) / max(float(moves_per_s @ moves_per_s), TINY)
        place = place - min(max(nearest_s, 0.0), DOWN_S) * moves_per_s
        if float(np.hypot(*place)) < 1.0:
            return True
    return False


def _at_target(ground: Ground, here_m: Array, own_m: float, safety: SafetySettings) -> bool:
    """Whether a target that vehicles keep clear of is there, at any height of it."""
    for target in ground.targets:
        if target.clearance_m:
            kept_m = float(kept_clear_m(target, safety.floor, np.array([own_m]))[0, 0])
            if float(np.hypot(*(here_m[0, :2] - target.position_m(ground.time_s)))) < kept_m:
                return True
    return False


def _apart_m(place_m: Array, other_m: Array) -> Array:
    """(n,) Distances over the ground between (n, 3) and (n, 3) or (1, 3)."""
    offset_m = place_m[:, :2] - other_m[:, :2]
    return np.asarray(np.hypot(offset_m[:, 0], offset_m[:, 1]))
