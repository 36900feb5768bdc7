"""What one tick leaves for the record: what the service believed, wanted and sent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from gcs.lifecycle import Phase, ShowPhase
from gcs.plan import Obstacle, Plan, Yaw
from gcs.service import SelectedShow, TickView
from gcs.state import Array, FleetState, Landed, Mode, Setpoints, VehicleId

Told: TypeAlias = Plan | tuple[str, str, str, tuple[Obstacle, ...], Yaw]
"""A plan, or the name, hash and cue of the show that leads it, with what that leaves to others."""


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
    selected: SelectedShow | None  # the written show that leads the plan
    start_unix_time_s: float | None  # ordered, and not reached yet
    center_m: tuple[float, float, float] | None
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None
    minimum_separation_m: float | None
    timing: TickView
    control_alive: bool
    setpoints_sent: int
    problems: tuple[str, ...]  # of the show, links and record, in words
    parts: Mapping[VehicleId, int] = field(default_factory=dict)  # who plays which part in it

    @property
    def told(self) -> Told:
        """What was told: a written show moves the plan in every tick, and that is no news."""
        show = self.selected
        if show is None:
            return self.plan
        return show.name, show.hash, show.cue, self.plan.obstacles, self.plan.yaw
