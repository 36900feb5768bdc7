"""Record samples for tests: a fleet that stands or moves with given velocities."""

from collections.abc import Sequence

import numpy as np

from gcs.control import ControlSettings
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Formation, Plan
from gcs.model.state import Array, FleetState, Landed, Mode, Setpoints
from gcs.recording.sample import Colours, Sample
from gcs.service import SelectedShow, TickView
from gcs.service.alarms import Alarm, AlarmCause, AlarmSeverity

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
    position_m: Array | None = None,
    velocity_m_s: Array | None = None,
    phases: Sequence[Phase] | None = None,
    modes: Sequence[Mode] | None = None,
    armed: Sequence[bool] | None = None,
    homes: Sequence[Array | None] | None = None,
    show: ShowPhase = ShowPhase.RUNNING,
    plan: Plan = PLAN,
    selected: SelectedShow | None = None,
    reasons: Sequence[str] | None = None,
    uncertainty_m: float = 0.35,
    control: ControlSettings | None = None,
    colours: Colours | None = None,
) -> Sample:
    here_m = (
        np.array([[10.0 * row, 0.0, -20.0] for row in range(count)]) if position_m is None else position_m
    )
    moves_m_s = np.zeros((count, 3)) if velocity_m_s is None else velocity_m_s
    ids = ids_of(count)
    return Sample(
        unix_time_s=1.7e9 + time_s,
        fleet=FleetState(time_s, ids, here_m, moves_m_s, np.zeros(count), np.full(count, 0.05)),
        setpoints=Setpoints(time_s, ids[:1], np.array([[1.0, 0.0, -0.5]]), np.zeros(1)),
        uncertainty_m=np.full(count, uncertainty_m),
        heartbeat_age_s=np.full(count, 0.4),
        battery_remaining=np.full(count, 0.9),
        phases=tuple(phases or (Phase.FORMATION,) * count),
        reasons=tuple(reasons or ("flies",) * count),
        modes=tuple(modes or (Mode.OFFBOARD,) * count),
        armed=tuple(armed or (True,) * count),
        landed=(Landed.IN_AIR,) * count,
        ready=(True,) * count,
        homes=tuple(homes or (None,) * count),
        limited_by={"d2": "separation from d1"},
        show=show,
        reason="the sphere stands",
        plan=plan,
        selected=selected,
        start_unix_time_s=None,
        center_m=(0.0, 0.0, -20.0),
        center_velocity_m_s=(1.0, 0.0, 0.0),
        radius_m=10.0,
        minimum_separation_m=9.5,
        timing=TickView(20.0, 7, 0, 1.0, 2.0, 3.0),
        control_alive=True,
        setpoints_sent=42,
        alarms=(FULL,),
        control=control,
        colours=colours,
    )
