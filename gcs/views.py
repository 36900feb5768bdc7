"""The newest state of everything, as people and programs may see it."""

from collections.abc import Mapping, Sequence

import numpy as np

from gcs.control import Tick
from gcs.lifecycle import ShowPhase
from gcs.plan import Plan
from gcs.service import FleetView, TickView, VehicleView
from gcs.state import Array, FleetState, Telemetry, VehicleId
from gcs.table import tuple3
from gcs.vehicle import Vehicle


def known(value: float) -> float | None:
    """None in place of a value that is not known."""
    return float(value) if np.isfinite(value) else None


def fleet_view(
    *,
    fleet: FleetState,
    tick: Tick,
    vehicles: Sequence[Vehicle],
    telemetry: Mapping[VehicleId, tuple[Telemetry, int]],
    show: ShowPhase,
    reason: str,
    plan: Plan,
    timing: TickView,
    control_alive: bool,
    setpoints_sent: int,
    unix_time_s: float,
) -> FleetView:
    """Put one tick's state together; rows of `fleet` and `vehicles` correspond."""
    sent = dict(zip(tick.setpoints.ids, tick.setpoints.velocity_m_s, strict=True))
    center = tick.memory.center
    return FleetView(
        time_s=fleet.time_s,
        unix_time_s=unix_time_s,
        show=show,
        reason=reason,
        vehicles=tuple(
            _vehicle_view(vehicle, fleet, tick, telemetry[vehicle.id], sent.get(vehicle.id))
            for vehicle in vehicles
        ),
        plan=plan,
        center_m=None if center is None else tuple3(center.position_m),
        center_velocity_m_s=None if center is None else tuple3(center.velocity_m_s),
        radius_m=None if center is None else tick.memory.radius_m,
        target_m=plan.target.position_m(fleet.time_s),
        minimum_separation_m=known(tick.minimum_separation_m),
        tick=timing,
        control_alive=control_alive,
        setpoints_sent=setpoints_sent,
    )


def _vehicle_view(
    vehicle: Vehicle,
    fleet: FleetState,
    tick: Tick,
    heard: tuple[Telemetry, int],
    setpoint_m_s: Array | None,
) -> VehicleView:
    telemetry, at = heard
    row = vehicle.row
    return VehicleView(
        id=vehicle.id,
        system_id=vehicle.system_id,
        link=vehicle.link,
        phase=vehicle.phase,
        reason=vehicle.reason,
        mode=telemetry.mode[at],
        armed=telemetry.armed[at],
        landed=telemetry.landed[at],
        ready=telemetry.ready[at],
        position_m=tuple3(fleet.position_m[row]),
        velocity_m_s=tuple3(fleet.velocity_m_s[row]),
        yaw_rad=known(fleet.yaw_rad[row]),
        latitude_deg=known(telemetry.latitude_deg[at]),
        longitude_deg=known(telemetry.longitude_deg[at]),
        altitude_amsl_m=known(telemetry.altitude_amsl_m[at]),
        battery_remaining=known(telemetry.battery_remaining[at]),
        position_age_s=known(fleet.age_s[row]),
        heartbeat_age_s=known(fleet.time_s - telemetry.heartbeat_time_s[at]),
        setpoint_m_s=None if setpoint_m_s is None else tuple3(setpoint_m_s),
        restrained_by=tick.restrained_by[row],
    )
