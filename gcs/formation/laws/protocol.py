"""The protocol of a law: what it is given in every tick, what it returns, and what it says of itself.

A law proposes velocities; limits, obstacles, traffic and the safety filter come after it, and no law can go
past them. How to write one: docs/how-to/fly-your-own-law.md.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from gcs.formation.neighbours import Sight
from gcs.model.settings import Settings
from gcs.model.state import Array, VehicleId

RATES_S: Final = 0.2
"""Greatest delay that the law's rates tolerate: beyond it they become slower as the delay grows."""


class GoalShape(StrEnum):
    """The shape that a law ends in, around the centre; metrics and the end of the assembly count with it."""

    SPHERE = "sphere"  # evenly spread, `radius_m` from the centre
    RING = "ring"  # level, `radius_m` from the centre, or farther where the vehicles need it
    GRID = "grid"
    HELIX = "helix"
    NONE = "none"


Stations: TypeAlias = Literal["local", "led"]
"""Which station of several computes a law: each for its own vehicles, or the lead for all."""


class NoSettings(Settings):
    """The settings of a law without any."""


@dataclass(frozen=True, slots=True, eq=False)
class SlotsState:
    """Slots as one tick passes them to the next. Rows as in FleetState. Owns its arrays."""

    place: Array  # (all,) (3,) unit vectors from the centre, NaN outside the formation
    change: Array  # (all, 3) of the slots in the last sweep
    unfollowed_s: Array | None  # (all,) how long each vehicle did not move as expected; negative: its slot
    # stays with it; None: not known

    @staticmethod
    def of(place: Array) -> "SlotsState":
        """Slots that another station computes, of vehicles that this one does not have in formation."""
        return SlotsState(place, np.zeros_like(place), None)


class ClosedSpace(Protocol):
    """The space of lost vehicles, which slots leave."""

    def move_out(self, place: Array) -> bool:
        """Move slots (n, 3) out of it along the sphere, in place. Returns: whether one was in it."""


def any_speed(distance_m: Array) -> Array:
    """(n,) no limit at any distance (n,)."""
    return np.full(len(distance_m), np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class LawInputs:
    """What a law is given in a tick: n vehicles in formation, and what they form. It changes no array.

    Show frame: x along the show's heading, y to its right, z down. Vehicles join and leave: `ids` say which
    rows are which.
    """

    ids: tuple[VehicleId, ...]  # n
    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3) over the ground
    charge: Array  # (n,) weight in the repulsion: 1.0 unless configured
    speed_max_m_s: Array  # (n,) of the vehicles over the ground
    engaged_s: Array  # (n,) since it joined the formation; NaN: another station flies it
    center_m: Array  # (3,)
    center_velocity_m_s: Array  # (3,)
    radius_m: float
    spin_rad_s: float  # of the formation about the vertical, clockwise from above
    target_m: Array  # (2,)
    target_velocity_m_s: Array  # (2,)
    apart_m: float  # the filter keeps two vehicles so far from each other, sideways
    own_speed_max_m_s: float  # of the velocities that the law returns
    link_delay_s: float  # one way
    dt_s: float  # since the previous tick
    time_s: float
    settings: Settings  # of the law's own model
    state: object = None  # as the law returned it; None: the formation is new, or the law was chosen anew

    # For laws that are shipped, which run within the tick.
    fleet_ids: Sequence[VehicleId] = ()  # of the whole fleet
    rows: NDArray[np.intp] | None = None  # (n,) of the vehicles in the fleet; None: the fleet is these n
    number: int = 0  # of the tick
    stopping_speed_m_s: Callable[[Array], Array] = any_speed  # (n,) distances from places: the greatest
    # speeds (n,) from which the vehicles still stop there
    fleet_velocity_m_s: Array | None = None  # (all, 3) over the ground
    expected_m_s: Array | None = None  # (own, 3) velocities relative to the centre that the vehicles of this
    # station should have, NaN: not commanded; None: not known
    closed: ClosedSpace | None = None
    led_place: Array | None = None  # (all, 3) slots of a station that leads
    sight: Sight | None = None  # what the vehicles received from each other; None: all that is in range

    @property
    def rate_share(self) -> float:
        """Share of its rates with which a law is flown: links are late."""
        return min(1.0, RATES_S / self.link_delay_s) if self.link_delay_s else 1.0

    def of_fleet(self, values: Array) -> Array:
        """A copy of the rows (n,) or (n, 3) of these vehicles."""
        return values.copy() if self.rows is None or len(self.rows) == len(values) else values[self.rows]

    def for_fleet(self, values: Array, others: float) -> Array:
        """(all, 3) with `values` (n, 3) in the rows of these vehicles, and `others` in all other rows."""
        count = len(self.fleet_ids) or len(self.ids)
        if self.rows is None or len(self.rows) == count:
            return values
        all_rows = np.full((count, 3), others)
        all_rows[self.rows] = values
        return all_rows


@dataclass(frozen=True, slots=True, eq=False)
class LawAnswer:
    """What a law returns: velocities relative to the centre, and what it wants to have in the next tick."""

    velocity_m_s: Array  # (n, 3) show frame; the station adds the centre's velocity, and the spin
    state: object = None
    later: Callable[[], object] | None = None  # computes `state` after the setpoints have left
    place: Array | None = None  # (all, 3) unit vectors to the slots now, of a law with slots
    knows_center: bool = True  # False: the vehicles do not know the centre's motion beforehand
    holds: bool = False  # every vehicle stops instead: the law is not relied on

    def next_state(self) -> object:
        return self.state if self.later is None else self.later()


def waits(count: int) -> LawAnswer:
    """The answer by which `count` vehicles stop where they are."""
    return LawAnswer(np.zeros((count, 3)), holds=True)


class FormationLaw(ABC):
    """A law of the formation: one velocity for each vehicle. An object of it keeps nothing between calls."""

    settings: type[Settings] = NoSettings
    goal_shape: GoalShape = GoalShape.NONE
    stations: Stations = "local"  # of several stations each computes the velocities of its own vehicles
    # among all; `led`: the lead computes those of all, or the slots, and sends them
    has_slots: bool = False  # each vehicle has one, and the others make room where it is held
    adds_spin: bool = False  # its velocities contain the formation's spin
    takes_sight: bool = False  # can be computed from what vehicles receive from their neighbours
    turns_alike: bool = False  # inputs that are turned about the vertical turn its velocities

    @abstractmethod
    def velocity(self, inputs: LawInputs) -> LawAnswer:
        """The velocities of this tick. It reads no clock, and is the same for the same inputs."""
