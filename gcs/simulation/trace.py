"""Record of a simulated flight: true states and commanded values, tick by tick."""

from dataclasses import dataclass, field

import numpy as np

from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.simulation.scenario import Scenario

NOWHERE = np.full(3, np.nan)


@dataclass(slots=True, eq=False)
class Record:
    """A flight of n vehicles, with one entry per tick. The flight fills it, and the metrics read it."""

    scenario: Scenario
    seed: int
    start_m: Array  # (n, 3)
    goal_m: Array  # (n, 3), NaN without
    floor_m: float
    time_s: list[float] = field(default_factory=list)
    position_m: list[Array] = field(default_factory=list)  # (n, 3) true
    formed: list[Mask] = field(default_factory=list)  # (n,) in formation
    in_air: list[Mask] = field(default_factory=list)  # (n,)
    center_m: list[Array] = field(default_factory=list)  # (3,) commanded
    radius_m: list[float] = field(default_factory=list)
    target_m: list[Array] = field(default_factory=list)  # (2,)
    boxes: list[tuple[Obstacle, ...]] = field(default_factory=list)  # at their positions now
    closest_m: list[float] = field(default_factory=list)  # in the floor's metric, over the tick's steps
    limited: list[int] = field(default_factory=list)  # number of vehicles that the safety filter limited
    tick_s: list[float] = field(default_factory=list)  # processor time of each decision
    violating: set[tuple[int, int]] = field(default_factory=set)  # pairs
    charge: Array | None = None  # (n,), None: all alike
    orbit_radius_m: float = 0.0
    busy_s: float = 0.0  # processor time of the whole flight
    changed_s: float = 0.0  # start of settling: engagement, or the last event

    @property
    def count(self) -> int:
        """Number of vehicles."""
        return len(self.start_m)

    def charges(self, rows: Mask) -> tuple[float, ...]:
        """Charges of the vehicles in `rows` (n,)."""
        charge = np.ones(self.count) if self.charge is None else self.charge
        return tuple(charge[rows].tolist())

    @property
    def path_m(self) -> Array:
        """(ticks, n, 3) true positions."""
        return np.array(self.position_m, dtype=np.float64)
