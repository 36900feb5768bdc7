"""One tick's sample for the record: what the service estimated, desired and sent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.control import ControlSettings
from gcs.model.lifecycle import ShowPhase
from gcs.model.plan import Obstacle, Plan, Target, Yaw
from gcs.model.state import VehicleId
from gcs.service import FleetView

Reported: TypeAlias = Plan | tuple[str, str, str, tuple[Obstacle, ...], Yaw]
"""A plan, or name, hash and cue of the show that decides it, with the values that the show leaves open."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedElsewhere:
    """The k vehicles of other stations in the same tick, or shortly before. Owns its arrays."""

    ids: Sequence[VehicleId]
    rows: NDArray[np.void]  # (k,) of `mcap_layout.VEHICLE`
    reasons: Sequence[str]  # of their phases
    shown: NDArray[np.intp] | None  # each vehicle once: rows of the n own, and of these k; None: all of them
    show: ShowPhase  # of the whole site


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """The state that one tick published, and what only the record needs. Immutable."""

    view: FleetView
    parts: Mapping[VehicleId, int] = field(default_factory=dict)  # row of each vehicle's part in the show
    control: ControlSettings | None = None  # limits that applied: the service's, or the selected show's
    number: int = 0  # of the samples passed to the record, from 1; counted by the record
    elsewhere: RecordedElsewhere | None = None  # None: the view has all vehicles

    @property
    def followed(self) -> str:
        """Name of the selected target; empty: none is."""
        targets = self.view.features.targets
        return "" if targets is None else targets.selected

    @property
    def reported(self) -> Reported:
        """The plan without the changes that a written show or a target makes in every tick."""
        plan, show = self.view.plan, self.view.selected
        if show is not None:
            return show.name, show.hash, show.cue, plan.obstacles, plan.yaw
        return replace(plan, target=Target(followed=True)) if self.followed else plan
