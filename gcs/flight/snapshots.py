"""Assembles what leaves a tick: the view for displays, clients and the record."""

from collections.abc import Sequence

import numpy as np
from prometheus_client import Histogram

from gcs.control import Tick
from gcs.estimation.fleet_state import tuple3
from gcs.estimation.time_estimates import Estimates
from gcs.flight.fleet import Fleet
from gcs.model.interrupted_flight import InterruptedFlight
from gcs.service import ActiveFailsafe, FleetView, FlightEnvelope, TickView
from gcs.service.alarms import Alarm
from gcs.service.vehicle_table import VehicleTable


def finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def fleet_view(
    flight: Fleet,
    tick: Tick,
    *,
    timing: TickView,
    histograms: tuple[Histogram, ...] = (),
    control_alive: bool,
    interventions: int,
    unix_time_s: float,
    start_unix_s: float | None = None,
    failsafes: Sequence[ActiveFailsafe] = (),
    interrupted: InterruptedFlight | None = None,
    alarms: Sequence[Alarm] = (),
    estimates: Estimates | None = None,
) -> FleetView:
    """Assemble one tick's view; the keywords are fields of `FleetView`.

    `flight` is as of that tick: a shallow copy, where commands may have changed it since.
    """
    center, fleet, show_run = tick.memory.center, flight.fleet, flight.show_run
    return FleetView(
        time_s=fleet.time_s,
        unix_time_s=unix_time_s,
        show=flight.show,
        reason=flight.reason,
        rows=_rows(flight, tick),
        plan=flight.plan,
        flight_envelope=FlightEnvelope.of(flight.control.safety),
        center_m=None if center is None else tuple3(center.position_m),
        center_velocity_m_s=None if center is None else tuple3(center.velocity_m_s),
        radius_m=None if center is None else tick.memory.radius_m,
        target_m=flight.plan.target.position_m(fleet.time_s),
        minimum_separation_m=finite(tick.minimum_separation_m),
        tick=timing,
        histograms=histograms,
        control_alive=control_alive,
        setpoints_sent=flight.setpoints_sent,
        interventions=interventions,
        selected=None if show_run is None else show_run.view(fleet.time_s),
        start_unix_time_s=start_unix_s,
        interrupted=interrupted,
        estimates=estimates,
        countdown_s=None if start_unix_s is None else max(0.0, start_unix_s - unix_time_s),
        failsafes=tuple(failsafes),
        alarms=tuple(alarms),
    )


def _rows(flight: Fleet, tick: Tick) -> VehicleTable:
    fleet, telemetry, show_run = flight.fleet, flight.telemetry, flight.show_run
    vehicles, known = flight.vehicles.values(), flight.known  # only those with all data can be ready
    setpoint_m_s = np.full((len(fleet.ids), 3), np.nan)
    if tick.setpoints.ids:
        row_of = {name: row for row, name in enumerate(fleet.ids)}
        setpoint_m_s[[row_of[name] for name in tick.setpoints.ids]] = tick.setpoints.velocity_m_s
    colour, lit = np.zeros((len(fleet.ids), 3), np.uint8), np.zeros(len(fleet.ids), np.bool_)
    if show_run is not None:
        colour, lit = show_run.colours(fleet.ids, fleet.time_s)
    return VehicleTable(
        ids=fleet.ids,
        system_ids=[vehicle.system_id for vehicle in vehicles],
        links=[vehicle.link for vehicle in vehicles],
        phases=[vehicle.phase for vehicle in vehicles],
        reasons=[vehicle.reason for vehicle in vehicles],
        modes=telemetry.mode,
        armed=telemetry.armed,
        landed=telemetry.landed,
        ready=[is_ready and name in known for name, is_ready in zip(fleet.ids, telemetry.ready, strict=True)],
        position_m=fleet.position_m,
        velocity_m_s=fleet.velocity_m_s,
        setpoint_m_s=setpoint_m_s,
        yaw_rad=fleet.yaw_rad,
        latitude_deg=telemetry.latitude_deg,
        longitude_deg=telemetry.longitude_deg,
        altitude_amsl_m=telemetry.altitude_amsl_m,
        battery_remaining=telemetry.battery_remaining,
        position_age_s=fleet.age_s,
        uncertainty_m=flight.traits.uncertainty_m,
        heartbeat_age_s=fleet.time_s - telemetry.heartbeat_time_s,
        link_quality=flight.link_quality.share,
        fix_type=telemetry.fix_type,
        limited_by=tick.limited_by,
        colour=colour,
        lit=lit,
        homes_m=[vehicle.home_m for vehicle in vehicles],
    )
