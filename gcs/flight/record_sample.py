"""Assembles one tick's sample for the record, from values that the tick has computed anyway."""

from functools import partial

import numpy as np

from gcs.control import Tick
from gcs.estimation.fleet_state import tuple3
from gcs.flight.fleet import Fleet
from gcs.flight.running_show import lights
from gcs.recording.sample import Sample
from gcs.service import TickView
from gcs.service.alarms import Alarm


def record_sample(
    flight: Fleet,
    tick: Tick,
    *,
    timing: TickView,
    control_alive: bool,
    alarms: tuple[Alarm, ...],
    unix_time_s: float,
    start_unix_time_s: float | None,
) -> Sample:
    """Return what one tick estimated, desired and sent; rows as in `flight.fleet`."""
    fleet, newest, vehicles = flight.fleet, flight.newest(), flight.vehicles.values()
    parts = flight.telemetry.parts
    center = tick.memory.center
    separation_m = tick.minimum_separation_m
    show_run = flight.show_run
    selected = None if show_run is None else show_run.view(fleet.time_s)
    colours = None
    if show_run is not None and selected is not None:
        # the parts are replaced, never changed
        colours = partial(lights, show_run.timeline, show_run.parts, fleet.ids, selected.clock_s)
    return Sample(
        unix_time_s=unix_time_s,
        fleet=fleet,
        setpoints=tick.setpoints,
        uncertainty_m=flight.traits.uncertainty_m,
        heartbeat_age_s=fleet.time_s - newest.beat_s,
        battery_remaining=flight.in_rows([part.battery_remaining for part in parts]),
        phases=[vehicle.phase for vehicle in vehicles],
        reasons=[vehicle.reason for vehicle in vehicles],
        modes=newest.mode,
        armed=newest.armed,
        landed=newest.landed,
        ready=flight.ordered([part.ready for part in parts]),
        homes=[vehicle.home_m for vehicle in vehicles],
        limited_by={fleet.ids[row]: why for row, why in enumerate(tick.limited_by) if why},
        show=flight.show,
        reason=flight.reason,
        plan=flight.plan,
        selected=selected,
        start_unix_time_s=start_unix_time_s,
        center_m=None if center is None else tuple3(center.position_m),
        center_velocity_m_s=None if center is None else tuple3(center.velocity_m_s),
        radius_m=None if center is None else tick.memory.radius_m,
        minimum_separation_m=float(separation_m) if np.isfinite(separation_m) else None,
        timing=timing,
        control_alive=control_alive,
        setpoints_sent=sum(link.setpoints_sent for link in flight.links),
        alarms=alarms,
        parts={} if show_run is None else show_run.parts,
        control=flight.control,
        colours=colours,
    )
