"""Vehicles that lose their links in a simulated flight, and the service's failsafes, which act on it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.control.memory import Memory
from gcs.estimation.contradictions import Doubts
from gcs.failsafe.arbitration import Failsafes, Standing
from gcs.failsafe.policy import FLIES_ON, SEVERITY, Action, Cause, FailsafePolicy
from gcs.failsafe.triggers import FailsafeRequest, Known, Roles, Seen
from gcs.model.setpoint_loss import STOP_S
from gcs.model.state import Array, FleetState, Mask
from gcs.planning.lost_space import KeptSetpoints, expected_drift, swept_segments_m
from gcs.planning.silent_space import silent_segments_m
from gcs.safety.floor import Floor
from gcs.safety.walls import Fence
from gcs.simulation.scenario import ScenarioLoss
from gcs.simulation.world import TrueWorld

SETPOINT_TIMEOUT_S = 0.2
"""`setpoint_timeout_s` of the service."""

FAR_M = 1e9


class Losses:
    """The vehicles that lose their links at one time, for good."""

    def __init__(self, loss: ScenarioLoss, count: int, seed: int, *, joining: int = 0) -> None:
        """Draw the vehicles, by a random stream of their own; none of the last `joining` of all `count`."""
        self.loss, self._operation = loss, OperationSettings(setpoint_loss_action=loss.action)
        among = count - joining
        picked = np.random.default_rng([seed, 3]).choice(among, round(loss.share * among), replace=False)
        self.rows: Mask = np.isin(np.arange(count), picked)
        """(n,) the vehicles that lose their links."""
        self.known: Mask = np.zeros(count, dtype=bool)
        """(n,) those that the flight takes for lost."""
        self.segments_m = np.zeros((0, 2, 3))
        """(m, 2, 3) paths that they may take, closed to the others."""
        self.segments_of: NDArray[np.intp] = np.zeros(0, dtype=np.intp)
        """(m,) the row of each."""
        self.silent_segments = 0
        """That many, the last, are of vehicles that are silent and not taken for lost yet."""
        self.drift: tuple[Array, Array] | None = None
        """As of `Tasks`."""
        self._kept = KeptSetpoints(count)

    def advance(self, world: TrueWorld, fleet: FleetState, memory: Memory, age_max_s: float) -> bool:
        """Cut links, let the autopilots notice it, take the vehicles for lost: as in flight, at their times.

        Vehicles with telemetry older than `age_max_s` are silent, which closes the space about them.
        `memory` is of the last tick.

        Returns: whether vehicles were taken for lost now.
        """
        since_s, half_s = world.time_s - self.loss.at_s, world.tick_s / 2
        if not self.rows.any():
            return False
        self._kept.note(memory.desired_m_s, memory.setpoint_m_s, fleet.age_s, world.time_s)
        if since_s < -half_s:
            return False
        if since_s < half_s:
            world.cut_links(self.rows)
        if abs(since_s - self._operation.setpoint_loss_s) < half_s:
            world.fly_alone(self.rows, self.loss.action)
        loss_s, silent = self._operation.setpoint_loss_s, self.rows & (fleet.age_s > age_max_s)
        keeps_m_s = self._kept.expected_m_s(world.received_m_s)
        self.drift = expected_drift(fleet.position_m, keeps_m_s, fleet.age_s, silent, noticed_s=loss_s)
        if self.known.any():
            return False
        lost_now = abs(since_s - self._operation.silence_s) < half_s
        if lost_now:
            self.known = self.rows.copy()
        rows = np.flatnonzero(self.rows if lost_now else silent)
        closed = self._swept if lost_now else self._near
        self.segments_m, self.segments_of = closed(world, fleet, rows)
        self.silent_segments = 0 if lost_now else len(self.segments_m)
        return lost_now

    def _swept(
        self, world: TrueWorld, fleet: FleetState, rows: NDArray[np.intp], action: str | None = None
    ) -> tuple[Array, NDArray[np.intp]]:
        """(m, 2, 3) paths of vehicles that do that, None: as without links; and (m,) the row of each."""
        of, keeps_m_s = self._kept.possible_m_s(rows, world.received_m_s)
        swept_m = [
            swept_segments_m(
                fleet.position_m[row],
                each_m_s,
                world.home_m[row],
                action or self._operation.setpoint_loss_action,
                float(world.return_height_m[row]),
                drift_s=self._drift_s,
            )
            for row, each_m_s in zip(of.tolist(), keeps_m_s, strict=True)
        ]
        return (
            np.concatenate([np.zeros((0, 2, 3)), *swept_m]),
            np.repeat(of, [len(each_m) for each_m in swept_m]),
        )

    def _near(
        self, world: TrueWorld, fleet: FleetState, rows: NDArray[np.intp], stopped: Mask | None = None
    ) -> tuple[Array, NDArray[np.intp]]:
        """The same of silent vehicles, and only what they can reach soon; (n,) `stopped` by a command."""
        of, keeps_m_s = self._kept.possible_m_s(rows, world.received_m_s)
        halts = np.zeros(len(self.rows), dtype=bool) if stopped is None else stopped
        segments_m, segment_of = silent_segments_m(
            fleet.position_m[of],
            keeps_m_s,
            world.home_m[of],
            world.return_height_m[of],
            np.minimum(fleet.age_s[of], self._operation.silence_s),
            action=np.where(halts[of], "hold", self._operation.setpoint_loss_action),
            noticed_s=np.where(halts[of], 0.0, self._operation.setpoint_loss_s),
            drift_s=self._drift_s,
        )
        return segments_m, of[segment_of]

    @property
    def _drift_s(self) -> float:
        """How long a vehicle without commands may keep its last velocity, its stop included."""
        return SETPOINT_TIMEOUT_S + self._operation.setpoint_loss_s + STOP_S

    def apart_m(self, place_m: Array, floor: Floor) -> Array:
        """(n,) distances of the places (n, 3) from the paths of lost vehicles, in the floor's metric."""
        least_m = np.full(len(place_m), FAR_M)
        for segment_m in self.segments_m:
            start_m, along_m = segment_m[0] * floor.scale, (segment_m[1] - segment_m[0]) * floor.scale
            offset_m = place_m * floor.scale - start_m
            share = np.clip(offset_m @ along_m / max(along_m @ along_m, 1e-9), 0.0, 1.0)
            away_m = np.linalg.norm(offset_m - share[:, None] * along_m, axis=1)
            least_m = np.minimum(least_m, away_m)
        return least_m


class Unbelieved(Losses):
    """The vehicles with positions that the flight does not believe; none of them is lost."""

    def __init__(self, count: int, seed: int) -> None:
        super().__init__(ScenarioLoss(), count, seed)
        self.silence_s = self._operation.silence_s
        self.stopped: Mask = np.zeros(count, dtype=bool)
        """(n,) those that their autopilots stopped, on a command."""
        self.lands: Mask = np.zeros(count, dtype=bool)
        """(n,) those that their autopilots land."""

    def advance(self, world: TrueWorld, fleet: FleetState, memory: Memory, age_max_s: float) -> bool:
        """Close the space about them, as `gcs.flight.state.uncontrolled_space`. Returns: False."""
        aged = replace(fleet, age_s=world.sample_age_s(world.time_s))
        self._kept.note(memory.desired_m_s, memory.setpoint_m_s, aged.age_s, world.time_s)
        silent = world.in_air & (fleet.age_s > age_max_s)
        lands = self.lands & world.in_air & np.isinf(fleet.age_s)
        keeps_m_s = self._kept.expected_m_s(world.received_m_s)
        noticed_s = np.where(self.stopped, 0.0, self._operation.setpoint_loss_s)
        self.drift = expected_drift(fleet.position_m, keeps_m_s, aged.age_s, silent, noticed_s=noticed_s)
        swept_m, swept_of = self._swept(world, fleet, np.flatnonzero(lands), "land")
        near_m, near_of = self._near(world, aged, np.flatnonzero(silent), self.stopped)
        self.segments_m, self.silent_segments = np.concatenate([swept_m, near_m]), len(near_m)
        self.segments_of = np.concatenate([swept_of, near_of])
        return False


@dataclass(frozen=True, slots=True, eq=False)
class SeenReports:
    """What the flight makes of the positions of n vehicles. Arrays (n,)."""

    unbelieved: Mask  # received lately, and not believed
    doubts: Doubts
    reset_time_s: Array  # of the last jump, -inf: never
    silent: Mask  # not received lately

    @staticmethod
    def good(lost: Mask) -> "SeenReports":
        """All are believed, but of the lost ones nothing is received."""
        n = len(lost)
        return SeenReports(np.zeros(n, dtype=bool), np.zeros(n, dtype=np.int64), np.full(n, -np.inf), lost)


class ServiceFailsafes:
    """The failsafes of the service in a simulated flight: triggers and arbitration are those of a flight.

    Batteries, links and clocks are not simulated: what is lost, the wind and the fence act.
    """

    def __init__(self, policy: FailsafePolicy, count: int, accuracy_m: tuple[float, float]) -> None:
        """`accuracy_m`: what every receiver reports, sideways and up."""
        self._failsafes = Failsafes(policy, Known.nothing(count, 0.0, policy))
        self._accuracy_m, self._active, self._paused_s = accuracy_m, False, np.inf
        self.show = FLIES_ON
        """Severity of what the whole show does."""
        self.vehicles = np.full(count, FLIES_ON)
        """(n,) severity of what each vehicle does."""
        self.bad_position: Mask = np.zeros(count, dtype=bool)
        """(n,) vehicles that are named for their position."""

    @property
    def paused(self) -> bool:
        return self.show == SEVERITY[Action.PAUSE]

    def advance(
        self,
        fleet: FleetState,
        desired_m_s: Array,
        fence: Fence,
        flying: Mask,
        formed: Mask,
        lost: Mask,
        judged: SeenReports | None = None,
    ) -> list[FailsafeRequest]:
        """Evaluate all triggers; called once a tick.

        Args:
            fleet: n vehicles.
            desired_m_s: (n, 3) commanded velocities, NaN: not commanded.
            fence: of the flight.
            flying: (n,) in the air and under control.
            formed: (n,) of these in formation.
            lost: (n,) taken for lost.
            judged: their positions; None: all are good.

        Returns: the requests that are executed now.
        """
        n, executed = len(flying), list[FailsafeRequest]()
        nothing, judged = np.full(n, np.nan), judged or SeenReports.good(lost)
        wide_m, tall_m = (np.full(n, accuracy_m) for accuracy_m in self._accuracy_m)
        seen = Seen(
            fleet.time_s,
            fleet.position_m,
            fleet.velocity_m_s,
            desired_m_s,
            nothing,
            wide_m,
            tall_m,
            judged.unbelieved,
            judged.doubts,
            judged.silent,
            judged.reset_time_s,
            fence,
            np.nan,
            0.0,
            np.zeros(n),
            np.ones(n),
        )
        roles = Roles(flying, formed, lost, max(fleet.time_s - self._paused_s, 0.0))
        requests = self._failsafes.look(seen, lambda: roles, active=self._active)
        self.bad_position = np.zeros(n, dtype=bool)
        if requests is None:
            return executed
        for each in requests:
            self.bad_position[list(each.rows)] |= each.cause is Cause.BAD_POSITION
        possible = {Action.RETURN, Action.LAND}
        if self.show == FLIES_ON:
            possible |= {Action.PAUSE, Action.RE_FORM, Action.HOLD_TARGET}

        def standing() -> Standing:
            severities = np.where(flying, np.maximum(self.vehicles, self.show), np.nan)
            return Standing(self.show, severities, frozenset(possible))

        def command(request: FailsafeRequest) -> FailsafeRequest:
            executed.append(request)
            if not request.whole_show:
                self.vehicles[list(request.rows)] = request.severity
            elif request.severity >= SEVERITY[Action.PAUSE]:
                self.show = request.severity
                self._paused_s = fleet.time_s if self.paused else np.inf
            return request

        self._failsafes.execute(requests, standing, command)
        self._active = bool(requests)
        return executed
