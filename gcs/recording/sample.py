"""One tick's sample for the record: what the service estimated, desired and sent."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.control import ControlSettings
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.plan import Obstacle, Plan, Yaw
from gcs.model.state import Array, FleetState, Landed, Mask, Mode, Setpoints, VehicleId
from gcs.service import SelectedShow, TickView
from gcs.service.alarms import Alarm

Reported: TypeAlias = Plan | tuple[str, str, str, tuple[Obstacle, ...], Yaw]
"""A plan, or name, hash and cue of the show that decides it, with the values that the show leaves open."""


Colours: TypeAlias = Callable[[], tuple[NDArray[np.uint8], Mask]]
"""Computed when written, on the record's thread: the tick does not need them."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One tick. n vehicles, rows as in `fleet`; show frame. Immutable."""

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
    limited_by: Mapping[str, str]  # only of limited vehicles
    show: ShowPhase
    reason: str
    plan: Plan
    selected: SelectedShow | None  # the written show that decides the plan
    start_unix_time_s: float | None  # scheduled, and not reached yet
    center_m: tuple[float, float, float] | None
    center_velocity_m_s: tuple[float, float, float] | None
    radius_m: float | None
    minimum_separation_m: float | None
    timing: TickView
    control_alive: bool
    setpoints_sent: int
    alarms: tuple[Alarm, ...]  # all at this time, most severe first
    parts: Mapping[VehicleId, int] = field(default_factory=dict)  # row of each vehicle's part in it
    control: ControlSettings | None = None  # limits that applied: the service's, or the selected show's
    number: int = 0  # of the samples passed to the record, from 1; counted by the record
    colours: Colours | None = None  # that the show sets; None: there are none

    def lights(self) -> tuple[NDArray[np.uint8], Mask]:
        """(n, 3) red, green, blue of each vehicle, and (n,) whether a light was set."""
        if self.colours is None:
            count = len(self.fleet.ids)
            return np.zeros((count, 3), np.uint8), np.zeros(count, np.bool_)
        return self.colours()

    @property
    def reported(self) -> Reported:
        """The plan without the changes that a written show makes in every tick, which are not recorded."""
        show = self.selected
        if show is None:
            return self.plan
        return show.name, show.hash, show.cue, self.plan.obstacles, self.plan.yaw
