"""Vehicles that are flown elsewhere, and what follows for a flight: none, until a site puts its own in place.

`Flight.elsewhere` is the one door: vehicles, their part in returns and shows, what else happens in a tick.
The classes here are those of a flight alone; `gcs.site` has others, and nothing in `gcs.flight` knows them.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import nan
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from gcs.control import Tick
from gcs.control.inputs import FormationState
from gcs.control.others import Others
from gcs.flight.state.running_show import ShowFleet
from gcs.links.intake import Intake
from gcs.model.plan import Formation
from gcs.model.state import Array, Mask, VehicleId
from gcs.planning.return_paths.paths import ReturnPaths
from gcs.preflight.vehicles import Placed
from gcs.recording.sample import RecordedElsewhere
from gcs.service import CommandRecord, FleetView, ShowAction
from gcs.service.alarms import Condition
from gcs.shows import Flaw, Show


class Returning(NamedTuple):
    """j vehicles that return and are flown elsewhere, show frame."""

    rows: NDArray[np.intp]  # (j,) among the others
    position_m: Array  # (j, 3)
    home_m: Array  # (j, 3)
    uncertainty_m: Array  # (j,)

    @staticmethod
    def none() -> "Returning":
        return Returning(np.zeros(0, np.intp), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


class ReturnsElsewhere:
    """The collective return, as far as vehicles that are flown elsewhere take part in it."""

    @property
    def plans_returns(self) -> bool | None:
        """Whether this flight plans a return for all; False: another does; None: each for its own."""
        return None

    @property
    def lead_returns(self) -> bool:
        """Whether the leading flight's show is on its way home, so that it plans for all."""
        return False

    def stands(self, below_m_s: float) -> bool:  # noqa: ARG002
        """Whether all of them that return have stopped."""
        return True

    def returning(self) -> Returning:
        """Those that wait for a plan of the return."""
        return Returning.none()

    def under_way(self, rows: NDArray[np.intp]) -> tuple[Array, Mask]:
        """(j, 3) positions of these, and (j,) whether they follow a plan."""
        return np.zeros((len(rows), 3)), np.zeros(len(rows), np.bool_)

    def publish_paths(self, paths: ReturnPaths, rows: NDArray[np.intp], home_m: Array) -> None:
        """Send (j,) vehicles, the last of the plan, their paths home."""

    @property
    def newest(self) -> int:
        """Number of the newest return that was received; 0: none."""
        return 0

    def received_paths(self, after: int) -> tuple[ReturnPaths, NDArray[np.intp], Array] | None:  # noqa: ARG002
        """Paths of a later return for own vehicles: with their rows (m,) and landing places (m, 3)."""
        return None

    def led_s(self) -> float:
        """Time in the plan at the flight that planned the return; NaN: not known."""
        return nan

    def note_return(self, time_s: float) -> None:
        """Note the time in the plan of the return, for the other flights."""


class LedBegin(Protocol):
    """When the selected show begins, where another flight decides it."""

    @property
    def follows_clock(self) -> bool:
        """Whether an external clock says when."""

    @property
    def waits(self) -> bool:
        """Whether a show that could begin must not yet."""

    def due_s(self, now_s: float) -> float | None:
        """When a tick should come, on the loop's clock; None: any time is as good."""


class ShowsElsewhere:
    """The selected show, as far as vehicles that are flown elsewhere take part, or another flight leads."""

    why_begin_lost = "the service was restarted, give it again"
    """Why a show no longer waits for the time that was given before this service began."""

    @property
    def leads(self) -> bool:
        """Whether this flight decides how the show goes on."""
        return True

    @property
    def why_busy(self) -> str:
        """What else flies, so that nothing may change on the ground: "while ..."; empty: nothing."""
        return ""

    @property
    def count(self) -> int:
        """Number of vehicles that there are for a show beside those of this flight."""
        return 0

    @property
    def begin(self) -> LedBegin | None:
        """When the show begins; None: this flight decides."""
        return None

    def misfits(self, show: Show) -> list[Flaw]:  # noqa: ARG002
        """Reasons to refuse a show that only vehicles elsewhere give."""
        return []

    def follow(self) -> bool:
        """Keep the show with the flight that leads, once a tick. Returns: whether another leads."""
        return False

    def joined(self, own: ShowFleet) -> ShowFleet:
        """All vehicles among which the show is played: first the own."""
        return own

    def start_too(self, *, named: bool) -> int:  # noqa: ARG002
        """Number of vehicles that start with this flight's, of a start of all or of named vehicles."""
        return 0

    def starting(self, chosen: Sequence[VehicleId]) -> Sequence[VehicleId]:
        """All vehicles that start with these of this flight, in the show's order."""
        return chosen

    def rows(self, vehicle_ids: Sequence[VehicleId]) -> Mapping[VehicleId, int]:
        """Row of each of these own vehicles among all that there are for a show."""
        return {name: row for row, name in enumerate(vehicle_ids)}


class TickHooks:
    """What else happens in a tick: nothing."""

    def before(self, now_s: float) -> None:
        """Take what has arrived: after the telemetry, before anything is decided."""

    @property
    def may_send(self) -> bool:
        """Whether setpoints may leave."""
        return True

    def sent(self, result: Tick, *, all_up: bool) -> None:
        """Publish the tick, after its setpoints. `all_up`: no vehicle climbs, or waits for its turn."""

    def after(self) -> None:
        """Execute what was received, after the flight has advanced."""

    def spread(self, record: CommandRecord, action: ShowAction, reason: str) -> CommandRecord:  # noqa: ARG002
        """Have the other flights execute a failsafe of this one as well. Returns: the record with theirs."""
        return record

    def lower(self, formation: Formation) -> str:  # noqa: ARG002
        """Have the leading flight lower the formation as well. Returns: why it does not; empty: it does."""
        return ""

    def conditions(self) -> Iterable[Condition]:
        """What operators must know about the other flights."""
        return ()

    def whole(self, own: Callable[[], FleetView], result: Tick) -> FleetView:  # noqa: ARG002
        """The view with the vehicles of all flights; `own` returns that of this one."""
        return own()

    def recorded(self) -> RecordedElsewhere | None:
        """The other vehicles for the record; None: there are none."""
        return None


class Elsewhere:
    """The vehicles that are flown elsewhere: none."""

    def __init__(self, vehicles: int) -> None:
        """`vehicles`: number of those of this flight."""
        self._all = np.ones(vehicles, np.bool_)
        self.returns = ReturnsElsewhere()
        self.shows = ShowsElsewhere()
        self.hooks = TickHooks()

    @property
    def alone(self) -> bool:
        """Whether this flight has all vehicles."""
        return True

    @property
    def count(self) -> int:
        """Number of other vehicles."""
        return 0

    @property
    def owned(self) -> Mask:
        """(n,) own rows that this flight commands; the others are another's, unless that is lost."""
        return self._all

    @property
    def intakes(self) -> Sequence[Intake]:
        """What bounds strangers on the way to the other flights."""
        return ()

    @property
    def delay_s(self) -> float:
        """One-way delay to the other flights."""
        return 0.0

    @property
    def parameters_hash(self) -> str:
        """Of the parameters of the other vehicles, as read where they are flown; empty: none were."""
        return ""

    def why_no_start(self) -> str:
        """Why a start with the other flights would be refused now; empty: it would not."""
        return ""

    def why_apart(self) -> str:
        """Why the flights must not take off together at a time that has come; empty: they may.

        Unlike `why_no_start` while another one takes off already.
        """
        return ""

    @property
    def all_up(self) -> bool:
        """Whether none of them climbs, or waits for its turn to take off."""
        return True

    @property
    def lead_runs(self) -> bool:
        """Whether another flight leads, and has seen the whole formation assembled."""
        return False

    @property
    def others(self) -> Others | None:
        """The other vehicles at the time of this tick; None: there are none."""
        return None

    def shared(self) -> FormationState | None:
        """The leading flight's formation at this tick; None: this flight computes it."""
        return None

    def formed_m(self) -> tuple[Array, Array]:
        """(j, 3) positions, show frame, and (j,) charges of those in formation."""
        return np.zeros((0, 3)), np.zeros(0)

    def uncertainty_m(self) -> Array:
        """(j,) of those that fly with the formation, or on the ground are to fly."""
        return np.zeros(0)

    def closed(self) -> tuple[Array, Array]:
        """(m, 2, 3) paths of those that are lost, and (m,) the uncertainty of each."""
        return np.zeros((0, 2, 3)), np.zeros(0)

    def closing(self) -> frozenset[VehicleId]:
        """Those that are lost."""
        return frozenset()

    def landing_m(self) -> Array:
        """(j, 2) where they stand on the ground, or come down."""
        return np.zeros((0, 2))

    def beside_pads_m(self, least_m: float) -> Array:  # noqa: ARG002
        """(j, 2) where they stand on the ground, farther than `least_m` from their pads."""
        return np.zeros((0, 2))

    def taken_m(self, besides: Returning) -> Array:  # noqa: ARG002
        """(j, 2) places where another vehicle must not land: pads and stands of all but `besides`."""
        return np.zeros((0, 2))

    def airborne_m(self) -> dict[VehicleId, tuple[Array, Array]]:
        """(3,) position and velocity of those in the air, show frame."""
        return {}

    def placed(self) -> Placed | None:
        """Those that only other flights receive, for the distances between pads; None: there are none."""
        return None
