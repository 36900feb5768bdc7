"""What one tick leaves for the record: what the service believed, wanted and sent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs.lifecycle import Phase, ShowPhase
from gcs.plan import Plan
from gcs.service import TickView
from gcs.state import Array, FleetState, Landed, Mode, Setpoints


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One tick. n vehicles, rows as in `fleet`; show frame. Nothing in it changes any more."""

    unix_time_s: float
    fleet: FleetState
    setpoints: Setpoints
    uncertainty_m: Array  # (n,) of the positions, sideways
    heartbeat_age_s: Array  # (n,)
    battery_remaining: Array  # (n,)
    phases: Sequence[Phase]
    reasons: Sequence[str]
    modes: Sequence[Mode]
    armed: Sequence[bool]
    landed: Sequence[Landed]
    ready: Sequence[bool]
    homes: Sequence[Array | None]  # (3,) each, where it took off
    restrained_by: Mapping[str, str]  # only of those who were
    show: ShowPhase
    reason: str
    plan: Plan
    center_m: tuple[float, float, float] | None
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None
    minimum_separation_m: float | None
    timing: TickView
    control_alive: bool
    setpoints_sent: int
    problems: tuple[str, ...]  # of links and record, in words
