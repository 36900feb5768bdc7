"""Vehicles that lose their links in a simulated flight: what they do, and what the flight knows of them."""

import numpy as np
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.model.state import Array, FleetState, Mask
from gcs.planning.landing_sites import STOP_S, swept_segments_m
from gcs.safety.separation import Floor
from gcs.simulation.scenario import Loss
from gcs.simulation.world import TrueWorld

SETPOINT_TIMEOUT_S = 0.2
"""`setpoint_timeout_s` of the service."""

FAR_M = 1e9


class Losses:
    """The vehicles that lose their links at one time, for good."""

    def __init__(self, loss: Loss, count: int, seed: int) -> None:
        """Draw the vehicles, by a random stream of their own."""
        self.loss, self._operation = loss, OperationSettings(setpoint_loss_action=loss.action)
        picked = np.random.default_rng([seed, 3]).choice(count, round(loss.share * count), replace=False)
        self.rows: Mask = np.isin(np.arange(count), picked)
        """(n,) the vehicles whose links end."""
        self.known: Mask = np.zeros(count, dtype=bool)
        """(n,) those that the flight takes for lost."""
        self.segments_m = np.zeros((0, 2, 3))
        """(m, 2, 3) paths that they may take, closed to the others."""
        self.segments_of: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        """(m,) the row of each."""

    def advance(self, world: TrueWorld, fleet: FleetState) -> bool:
        """Cut links, let the autopilots notice it, take the vehicles for lost: as in flight, at their times.

        Returns: whether vehicles were taken for lost now.
        """
        since_s, half_s = world.time_s - self.loss.at_s, world.tick_s / 2
        if since_s < -half_s or not self.rows.any():
            return False
        if since_s < half_s:
            world.cut_links(self.rows)
        if abs(since_s - self._operation.setpoint_loss_s) < half_s:
            world.fly_alone(self.rows, self.loss.action)
        if abs(since_s - self._operation.silence_s) >= half_s:
            return False
        self.known = self.rows.copy()
        swept_m = [self._swept_m(world, fleet, row) for row in np.flatnonzero(self.rows).tolist()]
        self.segments_m = np.concatenate(swept_m)
        self.segments_of = np.repeat(np.flatnonzero(self.rows), [len(own_m) for own_m in swept_m])
        return True

    def _swept_m(self, world: TrueWorld, fleet: FleetState, row: int) -> Array:
        operation = self._operation
        return swept_segments_m(
            fleet.position_m[row],
            world.received_m_s[row],
            world.home_m[row],
            operation.setpoint_loss_action,
            operation.return_height_m,
            drift_s=SETPOINT_TIMEOUT_S + operation.setpoint_loss_s + STOP_S,
        )

    def apart_m(self, place_m: Array, floor: Floor) -> Array:
        """(n,) distances of the places (n, 3) from the paths of lost vehicles, in the floor's metric."""
        least_m = np.full(len(place_m), FAR_M)
        for segment_m in self.segments_m:
            start_m, along_m = segment_m[0] * floor.scale, (segment_m[1] - segment_m[0]) * floor.scale
            offset_m = place_m * floor.scale - start_m
            share = np.clip(offset_m @ along_m / max(along_m @ along_m, 1e-9), 0.0, 1.0)
            away_m = np.linalg.norm(offset_m - share[:, None] * along_m, axis=1)
            least_m = np.minimum(least_m, away_m)
        return least_m
