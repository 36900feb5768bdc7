"""Record samples for tests: a fleet that stands or moves with given velocities."""

from dataclasses import replace
from typing import Any

import numpy as np

from gcs.control import ControlSettings
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Plan
from gcs.model.state import Landed, Mode
from gcs.model.vehicle_columns import unknown
from gcs.recording.sample import Sample
from gcs.service import FleetView, FlightEnvelope, SelectedShow, TickView
from gcs.service.alarms import Alarm, AlarmCause, AlarmSeverity
from gcs.service.vehicle_table import VehicleTable

FULL = Alarm(
    "record-fails-1",
    AlarmSeverity.CAUTION,
    AlarmCause.RECORD_FAILS,
    "Not recorded: the disk is full.",
    "Free the disk.",
    (),
    1.7e9,
    1.7e9,
)
PLAN = Plan(Formation(radius_m=10.0, height_m=20.0))


def ids_of(count: int) -> tuple[str, ...]:
    return tuple(f"d{row + 1}" for row in range(count))


def sample(
    count: int = 2,
    *,
    time_s: float = 100.0,
    show: ShowPhase = ShowPhase.RUNNING,
    plan: Plan = PLAN,
    selected: SelectedShow | None = None,
    control: ControlSettings | None = None,
    number: int = 0,
    **columns: Any,
) -> Sample:
    """One tick; `columns` are those of `VehicleTable` that differ."""
    here_m = np.array([[10.0 * row, 0.0, -20.0] for row in range(count)])
    setpoint_m_s = np.full((count, 3), np.nan)
    setpoint_m_s[0] = 1.0, 0.0, -0.5
    rows = VehicleTable(
        **{
            "ids": ids_of(count),
            "system_ids": range(1, count + 1),
            "links": ["radio"] * count,
            "autopilots": ["px4"] * count,
            "phases": [Phase.FORMATION] * count,
            "reasons": ["flies"] * count,
            "modes": [Mode.OFFBOARD] * count,
            "armed": [True] * count,
            "landed": [Landed.IN_AIR] * count,
            "ready": [True] * count,
            "position_m": here_m,
            "velocity_m_s": np.zeros((count, 3)),
            "setpoint_m_s": setpoint_m_s,
            **unknown(count),
            "yaw_rad": np.zeros(count),
            "battery_remaining": np.full(count, 0.9),
            "position_age_s": np.full(count, 0.05),
            "uncertainty_m": np.full(count, 0.35),
            "heartbeat_age_s": np.full(count, 0.4),
            "link_quality": np.ones(count),
            "fix_type": np.full(count, 3.0),
            "limited_by": ["separation from d1" if row == 1 else "" for row in range(count)],
            "colour": np.zeros((count, 3), np.uint8),
            "lit": np.zeros(count, np.bool_),
            "homes_m": [None] * count,
            **columns,
        }
    )
    view = FleetView(
        time_s=time_s,
        unix_time_s=1.7e9 + time_s,
        show=show,
        reason="the sphere stands",
        rows=rows,
        plan=plan,
        flight_envelope=FlightEnvelope(3.0, 100.0, 300.0, 2.0, 3.0, 0.3),
        center_m=(0.0, 0.0, -20.0),
        center_velocity_m_s=(1.0, 0.0, 0.0),
        radius_m=10.0,
        target_m=plan.target.position_m(time_s),
        minimum_separation_m=9.5,
        tick=TickView(20.0, 7, 0, 1.0, 2.0, 3.0),
        control_alive=True,
        setpoints_sent=42,
        interventions=0,
        alarms=(FULL,),
        selected=selected,
    )
    return Sample(view, control=control, number=number)


def changed(made: Sample, **changes: Any) -> Sample:
    """The sample with other values in its view, or of its columns."""
    columns = {
        name: changes.pop(name) for name in tuple(changes) if name in VehicleTable.__dataclass_fields__
    }
    return replace(made, view=replace(made.view, rows=replace(made.view.rows, **columns), **changes))
