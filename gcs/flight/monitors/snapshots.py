"""Assembles what leaves a tick for displays, clients and the record: the view and, each second, estimates."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.control import ControlSettings, Tick
from gcs.estimation import time_estimates
from gcs.estimation.fleet_state import tuple3
from gcs.estimation.link_health import LinkQuality
from gcs.estimation.time_estimates import Estimates, Speeds
from gcs.failsafe.policy import Action
from gcs.flight.state.flight import ASSEMBLED_M, ASSEMBLED_SHARE, FLIES, Flight
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import FlightVehicles, Vehicle
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Landed, Mask
from gcs.service import ActiveFailsafe, FleetView, FlightEnvelope, TickView
from gcs.service.alarms import Alarm
from gcs.service.features import Features
from gcs.service.histograms import TickHistogram
from gcs.service.vehicle_table import VehicleTable


def finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def fleet_view(
    flight: Flight,
    tick: Tick,
    *,
    timing: TickView,
    histograms: tuple[TickHistogram, ...] = (),
    control_alive: bool,
    interventions: int,
    unix_time_s: float,
    start_refused: str,
    start_unix_s: float | None = None,
    failsafes: Sequence[ActiveFailsafe] = (),
    interrupted: InterruptedFlight | None = None,
    alarms: Sequence[Alarm] = (),
    estimates: Estimates | None = None,
) -> FleetView:
    """Assemble one tick's view; the keywords are fields of `FleetView`.

    `flight` is as of that tick: a shallow copy, where commands may have changed it since.
    """
    center, fleet, show_run = tick.memory.center, flight.newest.state, flight.show.run
    instant = flight.instant
    return FleetView(
        time_s=fleet.time_s,
        unix_time_s=unix_time_s,
        show=flight.show.phase,
        reason=_reason(flight.show.reason, failsafes),
        rows=_rows(flight, tick),
        plan=flight.in_force.plan,
        flight_envelope=FlightEnvelope.of(flight.in_force.control.safety),
        center_m=None if center is None else tuple3(center.position_m),
        center_velocity_m_s=None if center is None else tuple3(center.velocity_m_s),
        radius_m=None if center is None else tick.memory.radius_m,
        target_m=flight.in_force.plan.target.position_m(fleet.time_s),
        minimum_separation_m=finite(tick.own_separation_m),
        tick=timing,
        histograms=histograms,
        control_alive=control_alive,
        setpoints_sent=flight.setpoints_sent,
        late_samples=flight.late_samples,
        interventions=interventions,
        start_refused=start_refused,
        selected=None if show_run is None else show_run.view(fleet.time_s),
        start_unix_time_s=start_unix_s,
        interrupted=interrupted,
        estimates=estimates,
        countdown_s=None if start_unix_s is None else max(0.0, start_unix_s - unix_time_s),
        failsafes=tuple(failsafes),
        alarms=tuple(alarms),
        features=Features(**{each.name: each.view(instant) for each in flight.features if each.name}),  # type: ignore[arg-type]
    )


def _reason(reason: str, failsafes: Sequence[ActiveFailsafe]) -> str:
    """Why the show is in its phase; first that the formation flies lower, which is no phase of its own."""
    lower = next((each for each in failsafes if each.action == Action.DESCEND), None)
    return reason if lower is None else f"flies lower: {lower.reason}; {reason}"


def _arrived(newest_s: Array, values: Array) -> Array:
    """A copy of (n,) values, NaN where nothing has arrived until now: at -inf."""
    values = values.copy()
    values[newest_s == -np.inf] = np.nan
    return values


def measured(newest: Newest, link_quality: LinkQuality) -> dict[str, Array]:
    """(n,) each: the numbers of `gcs.model.vehicle_columns`, as of the newest tick."""
    fleet, telemetry = newest.state, newest.telemetry
    return {
        "yaw_rad": fleet.yaw_rad,
        "roll_rad": telemetry.attitude_rad[:, 0],
        "pitch_rad": telemetry.attitude_rad[:, 1],
        "latitude_deg": telemetry.latitude_deg,
        "longitude_deg": telemetry.longitude_deg,
        "altitude_amsl_m": telemetry.altitude_amsl_m,
        "battery_remaining": telemetry.battery_remaining,
        "position_age_s": fleet.age_s,
        "heartbeat_age_s": fleet.time_s - telemetry.heartbeat_time_s,
        "uncertainty_m": _arrived(telemetry.position_time_s, newest.traits.uncertainty_m),
        "link_quality": _arrived(telemetry.life_time_s, link_quality.share),
        "fix_type": telemetry.fix_type,
    }


def _rows(flight: Flight, tick: Tick) -> VehicleTable:
    fleet, telemetry, show_run = flight.newest.state, flight.newest.telemetry, flight.show.run
    vehicles, complete = flight.vehicles, flight.known  # only those with all data can be ready
    setpoint_m_s = tick.setpoints.velocity_m_s
    if tick.setpoints.ids != fleet.ids:
        rows = [vehicles[name].row for name in tick.setpoints.ids]
        setpoint_m_s = np.full((len(fleet.ids), 3), np.nan)
        setpoint_m_s[rows] = tick.setpoints.velocity_m_s
    colour, lit = np.zeros((len(fleet.ids), 3), np.uint8), np.zeros(len(fleet.ids), np.bool_)
    if show_run is not None:
        colour, lit = show_run.colours(fleet.ids, fleet.time_s)
    return VehicleTable(
        ids=fleet.ids,
        system_ids=vehicles.system_ids,
        links=vehicles.links,
        autopilots=vehicles.autopilots,
        phases=vehicles.states.phases,
        reasons=vehicles.states.reasons,
        modes=telemetry.mode,
        armed=telemetry.armed,
        landed=telemetry.landed,
        ready=[
            is_ready and name in complete for name, is_ready in zip(fleet.ids, telemetry.ready, strict=True)
        ],
        position_m=fleet.position_m,
        velocity_m_s=fleet.velocity_m_s,
        setpoint_m_s=setpoint_m_s,
        **measured(flight.newest, flight.link_quality),
        limited_by=tick.limited_by[: len(fleet.ids)],
        colour=colour,
        lit=lit,
        homes_m=vehicles.states.homes_m,
        stations=(),
    )


EVERY_S: Final = 1.0

FORMING: Final = frozenset({ShowPhase.ARMING, ShowPhase.ASSEMBLING})
COMES_DOWN: Final = frozenset({ShowPhase.RETURNING, ShowPhase.ABORTING})
SPEED_SHARE: Final = 0.95
"""Share of the speed limits that the collective return plans with."""


class Estimating:
    """Keeps the newest estimates of one flight. Used on the event loop only."""

    def __init__(
        self,
        state: Newest,
        vehicles: FlightVehicles,
        show: ShowState,
        in_force: InForce,
        config: Config,
        slow_from_m: Callable[[Sequence[Vehicle]], Array],
    ) -> None:
        self._newest, self._vehicles, self._show, self._in_force = state, vehicles, show, in_force
        self._config, self._slow_from_m = config, slow_from_m
        self._history = time_estimates.BatteryHistory(len(vehicles))
        self._made_s = -np.inf
        self._phases: list[Phase] = []  # rows as in FleetState
        self.newest: Estimates = time_estimates.nothing(len(vehicles))

    def refresh(self, waiting: int, left_s: float | None) -> None:
        """Recompute the estimates once they are a second old; called every tick.

        Args:
            waiting: vehicles on the ground that have yet to take off with this start.
            left_s: remaining time of a collective return; None: none has begun.
        """
        now_s = self._newest.state.time_s
        if now_s - self._made_s < EVERY_S - 1e-3:
            return
        self._made_s = now_s
        self._phases = [vehicle.phase for vehicle in self._vehicles.values()]
        remaining = self._newest.telemetry.battery_remaining
        received = self._newest.has_heartbeat
        flying = self._in(FLIES) & received
        self._history.note(remaining, flying, now_s)
        below = self._config.failsafes.low_battery.below
        estimates = time_estimates.batteries(self._history, remaining, flying, received, below, now_s)
        self.newest = replace(estimates, assembled_s=self._assembled_s(waiting), home_s=self._home_s(left_s))

    def _in(self, phases: frozenset[Phase]) -> Mask:
        return np.array([phase in phases for phase in self._phases], dtype=np.bool_)

    def _assembled_s(self, waiting: int) -> float | None:
        if self._show.phase not in FORMING:
            return None
        control, operation, memory = self._in_force.control, self._config.operation, self._newest.memory
        position_m, formation = self._newest.state.position_m, self._in_force.plan.formation
        within_m = ASSEMBLED_M + ASSEMBLED_SHARE * formation.radius_m
        speeds = speeds_of(control)
        place = memory.place[: len(position_m)]
        formed = self._in(frozenset({Phase.FORMATION})) & np.isfinite(place[:, 0])
        coming = self._in(frozenset({Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION})) & ~formed
        located_m = position_m[np.isfinite(position_m).all(axis=1)]
        if memory.center is not None:
            center_m = memory.center.position_m
        elif len(located_m):
            center_m = np.array([*located_m[:, :2].mean(axis=0), -formation.height_m])  # it begins above them
        else:
            return None
        slot_m = center_m + formation.radius_m * place[formed]
        waits_m = operation.takeoff_height_m
        joining_m = _raised(position_m, coming, waits_m)
        climbs_m = [
            waits_m - (vehicle.home_m[2] - self._newest.position_m(vehicle)[2])
            for vehicle in self._vehicles.in_phase(Phase.TAKEOFF)
            if vehicle.home_m is not None
        ]
        if waiting:
            climbs_m.append(waits_m)
            joining_m = np.vstack([joining_m, (center_m[0], center_m[1], -waits_m)])
        on_way_s = max(
            time_estimates.to_slots_s(position_m[formed], slot_m, within_m, speeds),
            time_estimates.to_sphere_s(joining_m, center_m, formation.radius_m, within_m, speeds),
            abs(formation.radius_m - memory.radius_m) / speeds.radius_m_s if formed.any() else 0.0,
        )
        if self._show.phase is ShowPhase.ARMING:
            stagger_s = operation.takeoff_stagger_s
            on_way_s += time_estimates.take_off_s(waiting, stagger_s, np.array(climbs_m))
        return on_way_s if np.isfinite(on_way_s) and (waiting or formed.any() or coming.any()) else None

    def _home_s(self, left_s: float | None) -> float | None:
        operation = self._config.operation
        ours = self._vehicles.airborne
        homes = [(vehicle, vehicle.home_m) for vehicle in ours if vehicle.home_m is not None]
        if not ours or len(homes) < len(ours):
            return None
        position_m = self._newest.state.position_m[[vehicle.row for vehicle in ours]]
        aborting = self._show.phase is ShowPhase.ABORTING
        goals_m = [v.goal_m if aborting and v.goal_m is not None else pad_m for v, pad_m in homes]
        home_m = np.array(goals_m)
        home_m[:, 2] = [pad_m[2] for _, pad_m in homes]
        stands = [self._newest.telemetry.landed[vehicle.row] is Landed.ON_GROUND for vehicle in ours]
        position_m[stands, 2] = home_m[stands, 2]  # whatever its height says
        heights_m = operation.takeoff_height_m, operation.handover_height_m
        standing, speeds = self._show.phase in COMES_DOWN, speeds_of(self._in_force.control)
        slow_from_m = self._slow_from_m(ours)
        found_s = time_estimates.home_s(
            position_m, home_m, *heights_m, speeds, standing=standing, slow_from_m=slow_from_m
        )
        if found_s is None or left_s is None or self._show.phase is not ShowPhase.RETURNING:
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
