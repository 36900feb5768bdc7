"""What the safety filter is given: its settings, and the vehicles and the space around their velocities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot

from gcs.formation.obstacles import Ellipse
from gcs.model.plan import Target
from gcs.model.response import FleetResponse
from gcs.model.settings import NotNegative, Positive, Settings
from gcs.model.state import Array, Mask
from gcs.safety.authority import AuthoritySettings
from gcs.safety.constraints import (
    Braking,
)
from gcs.safety.floor import Floor
from gcs.safety.impact import ImpactSettings
from gcs.safety.near_traffic import NearTraffic
from gcs.safety.neighbours import Rows
from gcs.safety.traffic import Traffic
from gcs.safety.walls import Fence


class Limits(Settings):
    """Limits of every setpoint. A longer vector is scaled; its direction is kept."""

    horizontal_m_s: Positive = 8.0
    """Fastest setpoint sideways, in m/s."""
    up_m_s: Positive = 2.5
    """Fastest setpoint upwards, in m/s."""
    down_m_s: Positive = 1.4
    """Fastest setpoint downwards, in m/s."""

    @property
    def each_m_s(self) -> tuple[float, float, float]:
        """Sideways, of climbing, of descending."""
        return self.horizontal_m_s, self.up_m_s, self.down_m_s

    @property
    def fastest_m_s(self) -> float:
        """In any direction."""
        return hypot(self.horizontal_m_s, max(self.up_m_s, self.down_m_s))


class SafetySettings(Settings):
    """All settings of the safety filter."""

    limits: Limits = Limits()
    """Limits of every setpoint."""
    floor: Floor = Floor()
    """The space around each vehicle that no other may enter, and its margins."""
    fence: Fence = Fence()
    """The volume that no vehicle may leave."""
    impact: ImpactSettings = ImpactSettings()
    """Where vehicles would fall; the fence says where they may (`controlled_ground`)."""
    braking: Braking = Braking()
    """How a vehicle stops."""
    traffic: Traffic = Traffic()
    """How vehicles on their way to a goal pass each other."""
    authority: AuthoritySettings = AuthoritySettings()
    """When a vehicle counts as not reaching its velocity, and what follows."""
    link_delay_s: NotNegative = 0.0
    """Known delay of the links, one way, in s; where a longer one is measured, that one counts."""


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """The fleet and the space around the velocities to be filtered. n rows, show frame."""

    position_m: Array  # (n, 3)
    velocity_m_s: Array  # (n, 3) measured
    commanded: Mask  # (n,)
    airborne: Mask  # (n,) in the air, or possibly so
    descending: Mask  # (n,) descending to land
    segments_m: Array  # (m, 2, 3) paths that lost vehicles may take
    ellipses: Mapping[str, Ellipse]
    names: Sequence[str]
    uncertainty_m: Array  # (n,) standard deviations of the positions, sideways
    speed_max_m_s: Array  # (n,) of each vehicle, in any direction
    lack_m_s: Array  # (n, 3) what the velocities lack of those commanded, lasting
    wander_m: Array  # (n,) standard deviations of where velocities that are not commanded lead
    segments_of: Rows | None = None  # (m,) row of each path's lost vehicle; None: not known
    drift: tuple[Array, Array] | None = None  # (n, 3) positions and velocities of lost ones that still move
    passage: Mask | None = None  # (n,) that keep no margin from `segments_m`, as they would else be enclosed
    response: FleetResponse | None = None  # (n,) in what their stops differ from `braking`; None: in nothing
    drawn: Mask | None = None  # (n,) on trajectories that were drawn for the fleet; None: none of them
    near_traffic: NearTraffic | None = None  # traffic; None: there is none
    shared_m_s: Array | None = None  # (n, 3) what other stations' filters allowed last; NaN, None: not shared
    targets: tuple[Target, ...] = ()  # those with a clearance are kept clear of
    time_s: float = 0.0  # of all these
    goes: Mask | None = None  # (n,) on the way to goals of their own; None: none of them
    low: Mask | None = None  # (n,) do not descend, and may stay below the least height; None: none of them
    pressed: Mask | None = None  # (n,) not held off `segments_m`, as a box comes on; None: none of them
    eased: Mask | None = None  # (n,) that need not part from others beyond the floor; None: none of them

    def over_link(self, delay_s: float) -> "Surroundings":
        """The same when stops begin a round trip of 2 `delay_s` later."""
        if self.response is None or delay_s == 0.0:
            return self
        return replace(self, response=self.response.over_link(delay_s))
