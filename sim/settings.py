"""Settings of a fleet of fake vehicles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from gcs.sim.protocol.streams import RECORDED_HZ
from gcs.sim.vehicle.parameters import Value
from gcs.sim.vehicle.px4 import Quirks

MAX_SYSTEM_ID = 250

PAD_SPACING_M = 5.0
"""Distance of pads that the shipped configurations are made for, with what the simulators report."""

Autopilot: TypeAlias = Literal["px4", "ardupilot", "mixed"]
"""Which autopilot the vehicles have; mixed: PX4 those of even index, ArduPilot those of odd index."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the common NED frame starts: degrees, and metres above mean sea level."""

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_amsl_m: float = 488.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Settings of a fleet: `count` vehicles, each `every` index from `first` on.

    Vehicle i stands at row i // columns, column i % columns of a grid.

    Vehicle 0 stands at `grid_at_m` (north, east); rows lead towards `grid_heading_deg`, columns to its right.
    Its namespace is i // namespace_size, its system id there i % namespace_size + 1. Where a parameter
    has several values, vehicle i has the i-th. Receivers report what was recorded, and estimates are off by
    `noise_scale` times what was; with `ideal`, positions are exact and never reset, and the fix is RTK fixed.
    Without `drag_per_s` bodies have the drag of the recorded simulators: 1.0 with PX4, 0.65 with ArduPilot.
    `rates_hz` are those that PX4 sends without a request. `version` is one of sim.vehicle.versions, as
    "1.16", of a mixed fleet "1.16,4.5"; "" is as recorded. Parameters begin as in the autopilot's
    simulator, or `as_delivered` in its firmware. `clock_rate` is the rate of ArduPilot's clocks, which are
    its simulator's, over the wall clock. Streams of vehicles with PX4 have random phases, or with
    `together` the same ones, which takes less time. With `transponders` each vehicle has one for Remote ID.
    """

    autopilot: Autopilot = "px4"
    version: str = ""
    as_delivered: bool = False
    count: int = 1
    first: int = 0
    every: int = 1
    namespace_size: int = MAX_SYSTEM_ID
    seed: int = 0
    clock_rate: float = 1.0
    noise_scale: float = 1.0
    ideal: bool = False
    drag_per_s: float | None = None
    wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    origin: Origin = Origin()
    spacing_m: float = PAD_SPACING_M
    grid_columns: int = 1
    grid_at_m: tuple[float, float] = (0.0, 0.0)
    grid_heading_deg: float = 0.0
    heading_deg: float = 0.0
    endurance_s: float = 1200.0
    parameters: Mapping[str, Value | Sequence[Value]] = field(default_factory=dict)
    quirks: Quirks = Quirks()
    rates_hz: Mapping[int, float] = field(default_factory=lambda: RECORDED_HZ)
    together: bool = False
    transponders: bool = False

    def parameters_of(self, index: int) -> dict[str, Value]:
        """Those that are given for vehicle `index`, counted from 0."""
        return {
            name: value[index] if isinstance(value, Sequence) else value
            for name, value in self.parameters.items()
        }

    def system_id(self, index: int) -> int:
        """1 to 250, unique in its namespace."""
        return index % self.namespace_size + 1

    @property
    def indices(self) -> range:
        """The vehicles' numbers, from 0."""
        return range(self.first, self.first + self.count * self.every, self.every)
