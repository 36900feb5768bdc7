"""What a flight needs to know of the vehicles that other stations fly; `SiteMember` implements it."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.links.intake import Intake
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.return_paths.paths import ReturnPaths
from gcs.preflight.vehicles import Placed


class Returning(NamedTuple):
    """j vehicles of other stations that return, show frame."""

    rows: NDArray[np.intp]  # (j,) among the others
    position_m: Array  # (j, 3)
    home_m: Array  # (j, 3)
    uncertainty_m: Array  # (j,)


class ReturnsElsewhere(Protocol):
    """The collective return, as far as other stations' vehicles take part in it."""

    @property
    def plans_returns(self) -> bool | None:
        """Whether this station plans a return for all; False: another does; None: each for its own."""

    @property
    def lead_returns(self) -> bool:
        """Whether the lead's show is on its way home, so that it plans for all."""

    def stands(self, below_m_s: float) -> bool:
        """Whether all of them that return have stopped."""

    def returning(self) -> Returning:
        """Those that wait for a plan of the return."""

    def under_way(self, rows: NDArray[np.intp]) -> tuple[Array, Mask]:
        """(j, 3) positions of these, and (j,) whether they follow a plan."""

    def publish_paths(self, paths: ReturnPaths, rows: NDArray[np.intp], home_m: Array) -> None:
        """Send (j,) vehicles their paths home."""

    @property
    def number(self) -> int:
        """Number of the newest return that was received; 0: none."""

    def received_paths(self, after: int) -> tuple[ReturnPaths, NDArray[np.intp], Array] | None:
        """Paths of a later return for own vehicles: with their rows (m,) and landing places (m, 3)."""

    def led_s(self) -> float:
        """Time in the plan at the station that planned the return; NaN: not known."""

    def note_return(self, time_s: float) -> None:
        """Note the time in the plan of the return, for the other stations; NaN: none."""


class Elsewhere(Protocol):
    """The vehicles that other stations fly."""

    @property
    def returns(self) -> ReturnsElsewhere:
        """Their part in the collective return."""

    @property
    def owned(self) -> Mask:
        """(n,) own rows that this station flies; the others are another station's, unless that is lost."""

    @property
    def intakes(self) -> Sequence[Intake]:
        """What bounds strangers at the bus."""

    @property
    def delay_s(self) -> float:
        """One-way delay of the bus."""

    @property
    def all_up(self) -> bool:
        """Whether none of them climbs, or waits for its turn to take off."""

    def formed_m(self) -> tuple[Array, Array]:
        """(j, 3) positions, show frame, and (j,) charges of those in formation."""

    def uncertainty_m(self) -> Array:
        """(j,) of those that fly with the formation, or on the ground are to fly."""

    def closed(self) -> tuple[Array, Array]:
        """(m, 2, 3) paths of those that are lost, and (m,) the uncertainty of each."""

    def closing(self) -> frozenset[VehicleId]:
        """Those that are lost."""

    def landing_m(self) -> Array:
        """(j, 2) where they stand on the ground, or come down."""

    def taken_m(self, besides: Returning | None = None) -> Array:
        """(j, 2) places where another vehicle must not land: pads and stands of all but `besides`."""

    def airborne_m(self) -> dict[VehicleId, tuple[Array, Array]]:
        """(3,) position and velocity of those in the air, show frame."""

    def placed(self) -> Placed:
        """Those that only other stations receive, for the distances between pads."""

    @property
    def lead_runs(self) -> bool:
        """Whether another station leads, and has seen the whole formation assembled."""
