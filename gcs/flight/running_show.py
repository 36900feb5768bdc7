"""The selected show: its clock, the vehicles' parts, and its live target."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Obstacle, Plan, Target
from gcs.model.state import VehicleId
from gcs.service import CueMark, SelectedShow, ShowFigures
from gcs.shows import ShowClock, Timeline
from gcs.shows.timeline import Live

OVER = frozenset({ShowPhase.IDLE, ShowPhase.LANDED})


@dataclass(slots=True, eq=False)
class ShowRun:
    """Runtime state of one show. Changed on the event loop only; every `now_s` is the tick's own time."""

    name: str
    timeline: Timeline
    clock: ShowClock = ShowClock()
    live: Target | None = None  # the newest update, since the target became live
    started: bool = False  # by a command that named its hash; False again once all vehicles are down
    parts: dict[VehicleId, int] = field(default_factory=dict)  # rows of the lights
    figures: ShowFigures | None = None  # results of its check; None: not known
    received: bool = False  # from another station, which has its file and its check
    cue_times: tuple[CueMark, ...] = field(init=False)  # of every cue as played

    def __post_init__(self) -> None:
        self.cue_times = tuple(CueMark(one.cue.cue, one.at_s) for one in self.timeline.played)

    @property
    def hash(self) -> str:
        """Hash of everything that is flown."""
        return self.timeline.show.digest

    @property
    def obstacle_ids(self) -> frozenset[str]:
        return frozenset(box.id for box in self.obstacles)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        return tuple({box: None for _, standing in self.timeline.obstacles for box in standing})

    def follow(self, phase: ShowPhase, now_s: float) -> None:
        """Run the clock while the show runs; a pause stops it, and the end resets it."""
        if phase is ShowPhase.RUNNING:
            self.clock = self.clock.run(now_s)
        else:
            self.clock = self.clock.stop(now_s)
        if phase in OVER and self.started:
            self.clock, self.started, self.live = ShowClock(), False, None

    def is_live(self, now_s: float) -> bool:
        return isinstance(self.timeline.leg_at(self._within(now_s)), Live)

    def is_over(self, now_s: float) -> bool:
        return self.clock.ended(self.timeline, now_s)

    def cue(self, now_s: float) -> str:
        return self.timeline.cue_at(self._within(now_s)).cue.cue

    def desired(self, now_s: float) -> Plan:
        """Return the show's plan at this time, with all its obstacles. Target times are the tick's."""
        if not self.is_live(now_s):
            self.live = None  # an update does not apply to the next live target
        return self.timeline.plan_at(
            self.clock.show_s(now_s), clock_s=now_s, runs=self.clock.runs, live=self.live
        )

    def colours(
        self, vehicle_ids: Sequence[VehicleId], now_s: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """(n, 3) red, green, blue of each vehicle, and (n,) which play a part; other rows mean nothing."""
        part = np.array([self.parts.get(name, -1) for name in vehicle_ids], dtype=np.intp)
        lit = part >= 0
        colour = np.zeros((len(vehicle_ids), 3), np.uint8)
        colour[lit] = self.timeline.colours_at(self._within(now_s))[part[lit]]
        return colour, lit

    def view(self, now_s: float) -> SelectedShow:
        return SelectedShow(
            name=self.name,
            hash=self.hash,
            cue=self.cue(now_s),
            cues=tuple(dict.fromkeys(one.cue.cue for one in self.timeline.played)),
            clock_s=self._within(now_s),
            duration_s=self.timeline.duration_s,
            runs=self.clock.runs,
            target_is_live=self.is_live(now_s),
            timeline=self.cue_times,
        )

    def _within(self, now_s: float) -> float:
        return min(max(self.clock.show_s(now_s), 0.0), self.timeline.duration_s)
