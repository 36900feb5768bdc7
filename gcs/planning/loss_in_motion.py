"""Whether vehicles that fly each at its own velocity stay separated if they lose this station at once. Pure.

As `gcs.planning.setpoint_loss`, where all fly at one velocity. Each vehicle flies on straight at its own,
stops where it would be then, and executes its action from there.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gcs.model.setpoint_loss import FleetWithoutSetpoints
from gcs.model.state import TINY, Array
from gcs.planning.setpoint_loss import NOTICED_WITHIN_S, Action, Clash, clashes
from gcs.safety.floor import Floor


def clashes_in_motion(
    position_m: Array,
    velocity_m_s: Array,
    home_m: Array,
    actions: Sequence[Action],
    alone: FleetWithoutSetpoints,
    *,
    floor: Floor,
    return_height_m: Array,
) -> dict[Action, list[Clash]]:
    """Return for each action all pairs that would come below the floor, closest seen from above first.

    Args:
        position_m: (n, 3) positions at the loss, show frame.
        velocity_m_s: (n, 3) velocities then.
        home_m: (n, 3) each vehicle's own start.
        actions: each is executed by all vehicles, once they have stopped.
        alone: how long each flies on, and how it stops.
        floor: without its margin and uncertainty: positions are taken as they are.
        return_height_m: (n,) RTL_RETURN_ALT, above home.
    """
    count = len(position_m)
    drift_s = alone.flies_on_s + alone.stop_s(np.arange(count), velocity_m_s)
    stops_m = position_m + velocity_m_s * drift_s[:, None]
    stopping = _while_stopping(position_m, velocity_m_s, drift_s, floor)

    def found_by(action: Action) -> list[Clash]:
        then = clashes(
            stops_m,
            home_m,
            action,
            floor=floor,
            uncertainty_m=np.zeros(count),
            speed_m_s=0.0,
            return_height_m=return_height_m,
        )
        nearest: dict[tuple[int, int], Clash] = {}
        for clash in sorted([*stopping, *then], key=lambda clash: clash.sideways_m):
            nearest.setdefault((clash.first, clash.second), clash)
        return list(nearest.values())

    return {action: found_by(action) for action in actions}


def _while_stopping(position_m: Array, velocity_m_s: Array, drift_s: Array, floor: Floor) -> list[Clash]:
    """Return the pairs that meet until both have stopped, also if one stops `NOTICED_WITHIN_S` later."""
    first, second = np.triu_indices(len(position_m), 1)
    reach_m = np.linalg.norm(velocity_m_s, axis=1) * (drift_s.max(initial=0.0) + NOTICED_WITHIN_S)
    begin_m = position_m[first] - position_m[second]
    meet = (
        np.linalg.norm(begin_m * floor.scale, axis=1) < floor.horizontal_m + reach_m[first] + reach_m[second]
    )
    first, second, begin_m = first[meet], second[meet], begin_m[meet]
    together_s = np.minimum(drift_s[first], drift_s[second])
    part_m = begin_m + (velocity_m_s[first] - velocity_m_s[second]) * together_s[:, None]
    first_on_m = velocity_m_s[first] * (drift_s[first] - together_s + NOTICED_WITHIN_S)[:, None]
    second_on_m = velocity_m_s[second] * (drift_s[second] - together_s + NOTICED_WITHIN_S)[:, None]
    found: list[Clash] = []
    for path in ((begin_m, part_m, part_m + first_on_m), (part_m, part_m - second_on_m)):
        for from_m, to_m in pairwise(path):
            near_m = _nearest_m(from_m * floor.scale, to_m * floor.scale)
            inside = np.flatnonzero(np.linalg.norm(near_m, axis=1) < floor.horizontal_m)
            for at in inside.tolist():
                sideways_m = float(np.hypot(near_m[at, 0], near_m[at, 1]))
                found.append(Clash(int(first[at]), int(second[at]), sideways_m))
    return found


def _nearest_m(from_m: Array, to_m: Array) -> Array:
    """(k, 3) The point nearest to the origin on each straight way between (k, 3) points."""
    along_m = to_m - from_m
    share = -(from_m * along_m).sum(axis=1) / np.maximum((along_m**2).sum(axis=1), TINY)
    return np.asarray(from_m + np.clip(share, 0.0, 1.0)[:, None] * along_m)
