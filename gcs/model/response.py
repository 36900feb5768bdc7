"""How vehicles answer velocity setpoints, in what their autopilots differ. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import inf
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.model.errors import ShapeError

Column: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]

FLIES_ON_S: Final = 1.0
"""For so long a vehicle may fly on without setpoints: the safety filter's margins allow for it."""

BLIND_SHARE: Final = 2.0
"""So many seconds earlier a vehicle brakes for each second that it may fly on longer. The inner loop sends up
to 2.5 times a change of velocity, and a vehicle that flies on for long reaches that.
"""


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
    blind_s: float = 0.0  # so much longer than `FLIES_ON_S` it may fly on when its setpoints end


@dataclass(frozen=True, slots=True, eq=False)
class FleetResponse:
    """The same of n vehicles, as columns, read-only: shared by control, safety and simulation."""

    acceleration_m_s2: Column  # (n,), as of `Response`
    swings_s: Column
    loop_share: Column
    lead_share: Column
    trim_share: Column
    blind_s: Column

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
        if isinstance(rows, slice) and rows == slice(len(self)):
            return self
        return FleetResponse(*(getattr(self, field.name)[rows] for field in fields(self)))

    def joined(self, others: "FleetResponse") -> "FleetResponse":
        """These, then others."""
        both = [(getattr(self, field.name), getattr(others, field.name)) for field in fields(self)]
        return FleetResponse(*map(np.concatenate, both))

    def over_link(self, delay_s: float) -> "FleetResponse":
        """The same when telemetry and setpoints each take `delay_s`: a stop begins a round trip later."""
        return self if delay_s == 0.0 else _over_link(self, delay_s)

    def without_setpoints(self, reaction_s: float, besides: Mask | None = None) -> "FleetResponse":
        """The same where setpoints may end at any time: a stop begins when the vehicle notices it.

        Args:
            reaction_s: least one of these vehicles, as of `gcs.safety.constraints.Braking`.
            besides: (n,) vehicles that stay as they are; None: none.
        """
        if not np.count_nonzero(self.blind_s):
            return self
        longer = self.blind_s > 0.0 if besides is None else (self.blind_s > 0.0) & ~besides
        begins_s = np.maximum(self.swings_s, reaction_s) + BLIND_SHARE * self.blind_s
        return replace(self, swings_s=np.where(longer, begins_s, self.swings_s))


@lru_cache(maxsize=16)
def _over_link(response: FleetResponse, delay_s: float) -> FleetResponse:
    """As `FleetResponse.over_link`; kept, because a tick asks several times, and so does the next."""
    return replace(response, swings_s=response.swings_s + 2.0 * delay_s)
