"""The newest state of everything, as people and programs may see it."""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from gcs.checks import listed
from gcs.control import Tick
from gcs.interrupted import Interrupted
from gcs.lifecycle import ShowPhase, not_ours
from gcs.performance import Performance
from gcs.plan import Plan
from gcs.service import FleetView, Reaction, TickView, VehicleView
from gcs.state import Array, FleetState, Telemetry, Traits, VehicleId
from gcs.table import tuple3
from gcs.vehicle import Vehicle


def finite(value: float) -> float | None:
    """None in place of a value that is not known."""
    return float(value) if np.isfinite(value) else None


def fleet_view(
    *,
    fleet: FleetState,
    tick: Tick,
    vehicles: Sequence[Vehicle],
    telemetry: Mapping[VehicleId, tuple[Telemetry, int]],
    known: Collection[VehicleId],
    traits: Traits,
    show: ShowPhase,
    reason: str,
    plan: Plan,
    timing: TickView,
    control_alive: bool,
    setpoints_sent: int,
    interventions: int,
    link_quality: Array,
    problems: Sequence[str],
    unix_time_s: float,
    performance: Performance | None = None,
    waits: Sequence[str] = (),
    start_unix_s: float | None = None,
    reactions: Sequence[Reaction] = (),
    not_flying: Mapping[VehicleId, str] = MappingProxyType({}),
    interrupted: Interrupted | None = None,
) -> FleetView:
    """Put one tick's state together; rows of `fleet` and `vehicles` correspond.

    `known` are those of whom all is known that a start asks for: only they are ready. `problems` are the
    links', `waits` say which obstacles of the selected show do not stand yet, `start_unix_s` is that of a
    countdown, `not_flying` says who stays on the ground, and why, `interrupted` is a flight that was cut off.
    """
    cut_off = () if interrupted is None else (interrupted.notice,)
    lights = {} if performance is None else performance.lights(fleet.ids, fleet.time_s)
    sent = dict(zip(tick.setpoints.ids, tick.setpoints.velocity_m_s, strict=True))
    center = tick.memory.center
    return FleetView(
        time_s=fleet.time_s,
        unix_time_s=unix_time_s,
        show=show,
        reason=reason,
        vehicles=tuple(
            _vehicle_view(
                vehicle,
                fleet,
                tick,
                telemetry[vehicle.id],
                sent.get(vehicle.id),
                is_known=vehicle.id in known,
                uncertainty_m=float(traits.uncertainty_m[vehicle.row]),
                light=lights.get(vehicle.id),
                link_quality=float(link_quality[vehicle.row]),
            )
            for vehicle in vehicles
        ),
        plan=plan,
        center_m=None if center is None else tuple3(center.position_m),
        center_velocity_m_s=None if center is None else tuple3(center.velocity_m_s),
        radius_m=None if center is None else tick.memory.radius_m,
        target_m=plan.target.position_m(fleet.time_s),
        minimum_separation_m=finite(tick.minimum_separation_m),
        tick=timing,
        control_alive=control_alive,
        setpoints_sent=setpoints_sent,
        interventions=interventions,
        notices=(
            *cut_off,
            *not_ours((vehicle.id, vehicle.phase) for vehicle in vehicles),
            *grounded(not_flying),
            *waits,
            *problems,
        ),
        selected=None if performance is None else performance.view(fleet.time_s),
        start_unix_time_s=start_unix_s,
        interrupted=interrupted,
        countdown_s=None if start_unix_s is None else max(0.0, start_unix_s - unix_time_s),
        reactions=tuple(reactions),
    )


def grounded(not_flying: Mapping[VehicleId, str]) -> list[str]:
    """Who does not fly, and why, in words; what several share is said once."""
    whose: dict[str, list[VehicleId]] = {}
    for vehicle_id, reason in not_flying.items():
        whose.setdefault(reason, []).append(vehicle_id)
    return [f"{listed(names)}: not flying: {reason}" for reason, names in whose.items()]


def _vehicle_view(
    vehicle: Vehicle,
    fleet: FleetState,
    tick: Tick,
    heard: tuple[Telemetry, int],
    setpoint_m_s: Array | None,
    *,
    is_known: bool,
    uncertainty_m: float,
    light: str | None,
    link_quality: float,
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
        ready=telemetry.ready[at] and is_known,
        position_m=tuple3(fleet.position_m[row]),
        velocity_m_s=tuple3(fleet.velocity_m_s[row]),
        yaw_rad=finite(fleet.yaw_rad[row]),
        latitude_deg=finite(telemetry.latitude_deg[at]),
        longitude_deg=finite(telemetry.longitude_deg[at]),
        altitude_amsl_m=finite(telemetry.altitude_amsl_m[at]),
        battery_remaining=finite(telemetry.battery_remaining[at]),
        position_age_s=finite(fleet.age_s[row]),
        position_uncertainty_m=uncertainty_m,
        heartbeat_age_s=finite(fleet.time_s - telemetry.heartbeat_time_s[at]),
        setpoint_m_s=None if setpoint_m_s is None else tuple3(setpoint_m_s),
        link_quality=link_quality,
        restrained_by=tick.restrained_by[row],
        light=light,
    )
