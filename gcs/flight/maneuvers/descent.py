"""The last metres of one vehicle's descent through the safety filter, until its autopilot touches down."""

import logging
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.estimation.link_delay import LinkDelay
from gcs.estimation.touch_down import MOST_M, SLOWLY_M_S, GroundContact
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.vehicle import Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Array
from gcs.planning.return_paths.paths import may_hand_over

log = logging.getLogger(__name__)

SLOW_S: Final = MOST_M / SLOWLY_M_S
"""At most so much longer a descent takes because the height may be wrong."""


class Descent:
    """One descent onto a place. The vehicle is above it."""

    def __init__(
        self,
        newest: Newest,
        in_force: InForce,
        config: Config,
        link_delay: LinkDelay,
        slow_from_m: Callable[[Sequence[Vehicle]], Array],
        vehicle: Vehicle,
        place_m: Array,
    ) -> None:
        """`place_m` is (3,), show frame."""
        self._newest, self._in_force, self._config = newest, in_force, config
        self._link_delay, self._slow_from_m = link_delay, slow_from_m
        self._vehicle, self._place_m = vehicle, place_m
        self._contact = GroundContact()
        vehicle.goal_m = place_m.copy()

    def advance(self) -> bool:
        """Move the goal in one tick. Returns: whether the vehicle is over its place and low, or down.

        Down: where the filter keeps it off its place, it stands beside it in the end; and where its height is
        wrong, it stands before it seems to be low.
        """
        vehicle = self._vehicle
        here_m = self._newest.position_m(vehicle)
        handover_m = self._config.operation.handover_height_m
        if vehicle.phase is Phase.STANDBY or may_hand_over(here_m[None], self._place_m[None], handover_m)[0]:
            return True
        if self._stands():
            height_m = float(self._place_m[2] - here_m[2])
            reported = {"vehicle": vehicle.id, "height_m": round(height_m, 2)}
            log.warning("ground_met", extra=reported)
            return True
        if self._place_m[2] - here_m[2] < self._slow_from_m([vehicle])[0]:
            law, tick_s = self._in_force.control.law, 1.0 / self._config.tick_rate_hz
            ahead_m = SLOWLY_M_S * (1.0 / law.goal_rate_per_s + tick_s)
            vehicle.goal_m = np.array([*self._place_m[:2], here_m[2] + ahead_m])
        return False

    def _stands(self) -> bool:
        row = self._vehicle.row
        fleet = self._newest.state
        fresh = fleet.age_s[row] <= self._in_force.control.telemetry_age_max_s
        return self._contact.note(
            fleet.time_s,
            float(self._newest.memory.desired_m_s[row, 2]),
            float(fleet.velocity_m_s[row, 2]) if fresh else np.nan,
            float(self._link_delay.late_s[row]),
            self._newest.telemetry.landed[row],
        )
