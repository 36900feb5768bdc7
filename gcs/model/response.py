"""How vehicles answer velocity setpoints, in what their autopilots differ. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import inf
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError

Column: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Response:
    """One vehicle's answer, relative to that for which the gains in `control` were found.

    The defaults change none of them.
    """

    acceleration_m_s2: float = inf  # its autopilot changes the velocity no faster; inf: without such a limit
    swings_s: float = 0.0  # it stops within v^2 / (2 a) + this v, a being that acceleration
    loop_share: float = 1.0  # of the inner loop's gains
    lead_share: float = 1.0  # of the lead for accelerations that are known beforehand
    trim_share: float = 1.0  # of the rate at which setpoints are trimmed; 0: its autopilot leaves no error


@dataclass(frozen=True, slots=True, eq=False)
class FleetResponse:
    """The same of n vehicles, as columns, read-only: shared by control, safety and simulation."""

    acceleration_m_s2: Column  # (n,), as of `Response`
    swings_s: Column
    loop_share: Column
    lead_share: Column
    trim_share: Column

    def __post_init__(self) -> None:
        """Raises: ShapeError when the columns have different lengths."""
        for field in fields(self):
            column = getattr(self, field.name)
            if column.shape != self.acceleration_m_s2.shape or column.ndim != 1:
                raise ShapeError(f"{field.name}: {column.shape} for {len(self)} vehicles")
            column.setflags(write=False)

    def __len__(self) -> int:
        return len(self.acceleration_m_s2)

    @staticmethod
    def of(vehicles: Sequence[Response]) -> "FleetResponse":
        """The columns of these vehicles."""
        names = [field.name for field in fields(Response)]
        return FleetResponse(
            *(np.array([getattr(vehicle, name) for vehicle in vehicles], float) for name in names)
        )

    @staticmethod
    def alike(count: int) -> "FleetResponse":
        """`count` vehicles for which `control` is set."""
        return FleetResponse(*(np.full(count, getattr(Response(), field.name)) for field in fields(Response)))

    def rows(self, rows: NDArray[np.intp] | slice) -> "FleetResponse":
        """Those in rows (m,)."""
        return FleetResponse(*(getattr(self, field.name)[rows] for field in fields(self)))

    def joined(self, others: "FleetResponse") -> "FleetResponse":
        """These, then others."""
        both = [(getattr(self, field.name), getattr(others, field.name)) for field in fields(self)]
        return FleetResponse(*map(np.concatenate, both))

    def over_link(self, delay_s: float) -> "FleetResponse":
        """The same when telemetry and setpoints each take `delay_s`: a stop begins a round trip later."""
        return self if delay_s == 0.0 else replace(self, swings_s=self.swings_s + 2.0 * delay_s)
