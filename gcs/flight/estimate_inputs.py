"""Collects the inputs of the time and battery estimates from the running flight, once a second."""

from dataclasses import replace
from typing import Final

import numpy as np

from gcs.control import ControlSettings
from gcs.estimation import time_estimates
from gcs.estimation.time_estimates import Estimates, Speeds
from gcs.flight.fleet import ASSEMBLED_M, ASSEMBLED_SHARE, Fleet
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask

EVERY_S: Final = 1.0

IN_THE_AIR: Final = frozenset(
    {Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION, Phase.RETURN, Phase.LANDING, Phase.PILOT}
)
OURS: Final = IN_THE_AIR - {Phase.PILOT}
FORMING: Final = frozenset({ShowPhase.ARMING, ShowPhase.ASSEMBLING})
COMES_DOWN: Final = frozenset({ShowPhase.RETURNING, ShowPhase.ABORTING})
SPEED_SHARE: Final = 0.95
"""Share of the speed limits that the collective return plans with."""


class Estimating:
    """Keeps the newest estimates of one flight. Used on the event loop only."""

    def __init__(self, flight: Fleet) -> None:
        self._flight = flight
        self._history = time_estimates.BatteryHistory(len(flight.vehicles))
        self._made_s = -np.inf
        self._phases: list[Phase] = []  # rows as in FleetState
        self.newest: Estimates = time_estimates.nothing(len(flight.vehicles))

    def refresh(self, waiting: int, left_s: float | None) -> None:
        """Recompute the estimates once they are a second old; called every tick.

        Args:
            waiting: vehicles on the ground that have yet to take off with this start.
            left_s: remaining time of a collective return; None: none has begun.
        """
        now_s = self._flight.fleet.time_s
        if now_s - self._made_s < EVERY_S - 1e-3:
            return
        self._made_s = now_s
        flight = self._flight
        self._phases = [vehicle.phase for vehicle in flight.vehicles.values()]
        remaining = flight.telemetry.battery_remaining
        received = flight.has_heartbeat
        flying = self._in(IN_THE_AIR) & received
        self._history.note(remaining, flying, now_s)
        below = flight.config.failsafes.low_battery.below
        known = time_estimates.batteries(self._history, remaining, flying, received, below, now_s)
        self.newest = replace(known, assembled_s=self._assembled_s(waiting), home_s=self._home_s(left_s))

    def _in(self, phases: frozenset[Phase]) -> Mask:
        return np.array([phase in phases for phase in self._phases], dtype=np.bool_)

    def _assembled_s(self, waiting: int) -> float | None:
        flight = self._flight
        if flight.show not in FORMING:
            return None
        control, operation, memory = flight.control, flight.config.operation, flight.memory
        position_m, formation = flight.fleet.position_m, flight.plan.formation
        within_m = ASSEMBLED_M + ASSEMBLED_SHARE * formation.radius_m
        speeds = speeds_of(control)
        formed = self._in(frozenset({Phase.FORMATION})) & np.isfinite(memory.place[:, 0])
        coming = self._in(frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION})) & ~formed
        known = position_m[np.isfinite(position_m).all(axis=1)]
        if memory.center is not None:
            center_m = memory.center.position_m
        elif len(known):
            center_m = np.array([*known[:, :2].mean(axis=0), -formation.height_m])  # it begins above them
        else:
            return None
        slot_m = center_m + formation.radius_m * memory.place[formed]
        on_way_s = max(
            time_estimates.to_slots_s(position_m[formed], slot_m, within_m, speeds),
            time_estimates.to_sphere_s(
                _raised(position_m, coming, operation.takeoff_height_m),
                center_m,
                formation.radius_m,
                within_m,
                speeds,
            ),
            abs(formation.radius_m - memory.radius_m) / speeds.radius_m_s if formed.any() else 0.0,
        )
        climbing = self._in(frozenset({Phase.TAKEOFF}))
        climbs_m = self._climbs_m(climbing)
        if waiting:
            climbs_m = np.append(climbs_m, operation.takeoff_height_m)
            ground_m = np.array([[center_m[0], center_m[1], -operation.takeoff_height_m]])
            on_way_s = max(
                on_way_s, time_estimates.to_sphere_s(ground_m, center_m, formation.radius_m, within_m, speeds)
            )
        up_s = (
            time_estimates.take_off_s(waiting, operation.takeoff_stagger_s, climbs_m)
            if flight.show is ShowPhase.ARMING
            else 0.0
        )
        total_s = on_way_s + up_s
        return total_s if np.isfinite(total_s) and (waiting or formed.any() or coming.any()) else None

    def _climbs_m(self, climbing: Mask) -> Array:
        """Return the heights that climbing vehicles still have to climb to their waiting height."""
        height_m = self._flight.config.operation.takeoff_height_m
        return np.array(
            [
                height_m - (vehicle.home_m[2] - self._flight.fleet.position_m[vehicle.row, 2])
                for vehicle, climbs in zip(self._flight.vehicles.values(), climbing, strict=True)
                if climbs and vehicle.home_m is not None
            ]
        )

    def _home_s(self, left_s: float | None) -> float | None:
        flight = self._flight
        ours = [vehicle for vehicle in flight.vehicles.values() if vehicle.phase in OURS]
        if not ours or any(vehicle.home_m is None for vehicle in ours):
            return None
        operation = flight.config.operation
        rows = [vehicle.row for vehicle in ours]
        position_m = flight.fleet.position_m[rows]
        aborting = flight.show is ShowPhase.ABORTING
        places = [
            vehicle.goal_m if aborting and vehicle.goal_m is not None else vehicle.home_m for vehicle in ours
        ]
        home_m = np.array([place if place is not None else np.full(3, np.nan) for place in places])
        pads_z_m = np.array([vehicle.home_m[2] if vehicle.home_m is not None else np.nan for vehicle in ours])
        home_m[:, 2] = pads_z_m
        found_s = time_estimates.home_s(
            position_m,
            home_m,
            operation.takeoff_height_m,
            operation.handover_height_m,
            speeds_of(flight.control),
            standing=flight.show in COMES_DOWN,
        )
        if found_s is None or left_s is None or flight.show is not ShowPhase.RETURNING:
            return found_s
        return max(found_s, left_s + time_estimates.SEEN_DOWN_S)


def speeds_of(control: ControlSettings) -> Speeds:
    law, limits = control.law, control.safety.limits
    return Speeds(
        level_m_s=SPEED_SHARE * min(law.speed_m_s, limits.horizontal_m_s),
        up_m_s=SPEED_SHARE * limits.up_m_s,
        down_m_s=SPEED_SHARE * limits.down_m_s,
        slot_m_s=law.speed_m_s,
        slot_rate_per_s=law.slot_rate_per_s,
        radius_m_s=control.radius_rate_m_s,
        climb_m_s=law.climb_max_m_s,
    )


def _raised(position_m: Array, coming: Mask, height_m: float) -> Array:
    """Return positions with joining vehicles raised at least to the take-off height of all."""
    raised_m = position_m[coming].copy()
    raised_m[:, 2] = np.minimum(raised_m[:, 2], -height_m)
    return raised_m[np.isfinite(raised_m).all(axis=1)]
