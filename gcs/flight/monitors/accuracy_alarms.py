"""Conditions about where vehicles are and how they answer: positions, radius, authority."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from gcs.config.schema import Config
from gcs.control import ControlSettings, Tick
from gcs.estimation.fleet_state import Table
from gcs.estimation.height_bias import HeightComparison
from gcs.failsafe.autopilot_failsafe import FailsafeCause
from gcs.failsafe.policy import Cause
from gcs.flight.state.flight import FLIES
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.vehicle import SHOW_FLIES, FlightVehicles, Vehicle
from gcs.model.lifecycle import Phase
from gcs.model.state import Array, Landed, Mask
from gcs.planning.feasibility import radius_allowed, smallest_formation_radius_m
from gcs.safety.answers import slowest_m_s2
from gcs.safety.authority import Authority
from gcs.service import ActiveFailsafe
from gcs.service.alarms import AlarmCause, Condition, Limit, beyond

TOO_SMALL: Final = Limit(on=1.02, off=1.0)
"""Least radius at the accuracy that the vehicles report now, as a share of the radius."""

FEW_SHARE: Final = 1.0 / 3.0
"""Up to this share of the vehicles are named where they alone make the radius too small."""

WIDE_M: Final = Limit(on=1.5, off=0.8)
"""Margin of a pair on top of the usual one, because vehicles do not reach their velocities."""

LACKED_S: Final = 10.0
"""Gusts reach vehicles one after the other: those that lacked velocity within this time count together."""

LASTS_S: Final = 3.0
"""One vehicle alone must lack velocity for this time: its neighbours feel no wind."""

OFF_GROUND_M: Final = Limit(on=2.0, off=1.4)
"""Of a vehicle that stands on its pad: more than estimates without corrections are off at once."""

SETTLES_S: Final = 1.5
"""Averaging time of the height of a vehicle that stands: an estimate settles after a touch-down."""

ON_PAD_M: Final = 2.0
"""Farther from its pad the ground may be higher or lower."""

WIDE_JUMP_M: Final = 1.0
"""From a jump this far on, the vehicle is named at once, however large the radius is."""

MAY_STAND: Final = frozenset({Phase.LANDING, Phase.STANDBY})

REBOOT: Final = "Reboot [it|them] where [it stands|they stand] before the next start."

NO_FIX: Final = "its receiver has no 3D fix"

BLIND: Final = (
    "[It cannot be steered: keep clear of it, and people away from below|They cannot be steered: keep clear"
    " of them, and people away from below]."
)


@dataclass(eq=False)
class AccuracyAlarms:
    """Sources of these conditions, with what their hysteresis needs."""

    newest: Newest
    vehicles: FlightVehicles
    show: ShowState
    in_force: InForce
    config: Config
    table: Table
    heights: HeightComparison
    in_formation_m: Callable[[Sequence[Vehicle]], Array]  # uncertainty of these, and of those elsewhere
    control_now: Callable[[], ControlSettings]

    def __post_init__(self) -> None:
        n = len(self.vehicles)
        self._is_small = np.zeros(1, np.bool_)
        self._wide = np.zeros(1, np.bool_)
        self._off_ground = np.zeros(n, np.bool_)
        self._on_pad_m: Array = np.zeros(n)  # averaged
        self._looked_s = self.newest.state.time_s
        self._lacks_since_s: Array = np.full(n, np.inf)
        self._lacked_s: Array = np.full(n, -np.inf)

    def of_positions(self, failsafes: Sequence[ActiveFailsafe]) -> Iterator[Condition]:
        """Yield vehicles whose positions are in doubt, but for those about which a failsafe says so."""
        doubtful, jumped = self.newest.state.doubtful, self._jumped_wide()
        if not np.count_nonzero(doubtful | jumped):
            return
        named = {name for each in failsafes if each.cause == Cause.BAD_POSITION for name in each.vehicles}
        for row in np.flatnonzero(doubtful | jumped).tolist():
            vehicle = self.vehicles.rows[row]
            if vehicle.phase not in FLIES or vehicle.id in named or self.newest.silent[row]:
                continue
            if doubtful[row]:
                if vehicle.phase is Phase.PILOT and vehicle.cause is FailsafeCause.POSITION_LOSS:
                    continue  # the alarm of its own failsafe says so
                advice = BLIND if vehicle.phase is Phase.PILOT else ""
                yield Condition(AlarmCause.BAD_POSITION, NO_FIX, (vehicle.id,), advice=advice)
            else:
                yield self._uncertain(vehicle)

    def of_the_radius(self) -> Iterator[Condition]:
        """Yield a radius that the service would refuse now: the accuracy was better when it was set.

        Where a few vehicles alone make it too small, these are named instead. A drawn show has no radius.
        """
        if self.show.run is not None and self.show.run.goals is not None:
            return
        doubtful = self.newest.state.doubtful
        formed = self.vehicles.in_phase(Phase.FORMATION) if self.show.phase in SHOW_FLIES else []
        formed = [vehicle for vehicle in formed if not doubtful[vehicle.row]]
        uncertainty_m = self.in_formation_m(formed)
        about = len(uncertainty_m), self.in_force.control.safety, uncertainty_m
        radius_m = self.in_force.plan.formation.radius_m
        needed_m = smallest_formation_radius_m(*about) if formed else 0.0
        self._is_small = beyond(self._is_small, np.array([needed_m / radius_m]), TOO_SMALL)
        if not self._is_small[0]:
            return
        jumped = self._jumped_wide()
        for few in self._least_certain(formed, uncertainty_m, radius_m):
            if not jumped[few.row]:  # else it is named anyway
                yield self._uncertain(few)
            needed_m = 0.0
        if needed_m:
            because = f"{radius_m:g} m are set, the safety filter needs {radius_allowed(*about)}"
            consequence = "It keeps the vehicles apart, and holds them off their places."
            yield Condition(AlarmCause.RADIUS_SMALL, because, consequence=consequence)

    def _least_certain(
        self, formed: Sequence[Vehicle], uncertainty_m: Array, radius_m: float
    ) -> Sequence[Vehicle]:
        """The least certain vehicles, if few, without which the radius were large enough; else none."""
        own_m, count = uncertainty_m[: len(formed)], len(uncertainty_m)
        worst_first = np.argsort(-own_m)
        for few in range(1, ceil(FEW_SHARE * count)):
            usual_m = np.delete(uncertainty_m, worst_first[:few])
            usual_m = np.append(usual_m, np.full(few, usual_m.min(initial=np.inf)))
            if smallest_formation_radius_m(count, self.in_force.control.safety, usual_m) <= radius_m:
                return [formed[at] for at in worst_first[:few].tolist()]
        return []

    def _jumped_wide(self) -> Mask:
        """(n,) vehicles with jumps so far, and so lately, that others keep clear of both places."""
        lately = self.newest.state.time_s - self.table.reset_time_s < self.config.positioning.reset_margin_s
        return lately & (self.table.jumped_m >= WIDE_JUMP_M)

    def _uncertain(self, vehicle: Vehicle) -> Condition:
        uncertain_m = float(self.newest.uncertainty_m([vehicle])[0])
        because = f"{uncertain_m:.2f} m (1 sigma), {self._why_uncertain(vehicle)}"
        consequence = "Others keep farther away from [it|them]."
        return Condition(AlarmCause.UNCERTAIN_POSITION, because, (vehicle.id,), consequence)

    def _why_uncertain(self, vehicle: Vehicle) -> str:
        row = vehicle.row
        jumped_s = self.newest.state.time_s - float(self.table.reset_time_s[row])
        if jumped_s < self.config.positioning.reset_margin_s:
            return f"its position jumped by {self.table.jumped_m[row]:.1f} m, {jumped_s:.0f} s ago"
        telemetry = self.newest.telemetry
        sideways_m, up_m = telemetry.horizontal_accuracy_m[row], telemetry.vertical_accuracy_m[row]
        return f"its receiver reports {sideways_m:.1f} m sideways, {up_m:.1f} m up"

    def of_heights(self) -> Iterator[Condition]:
        """Yield vehicles with heights that differ from their receivers', or from the ground under them."""
        biases = self.heights.found
        for row in biases.named.nonzero()[0].tolist():
            vehicle = self.vehicles.rows[row]
            if vehicle.phase in FLIES:
                consequence = "Others keep so much farther above and below [it|them]."
                yield Condition(AlarmCause.HEIGHT_DIFFERS, biases.in_words(row), (vehicle.id,), consequence)
        now_s = self.newest.state.time_s
        share, self._looked_s = 1.0 - np.exp(-(now_s - self._looked_s) / SETTLES_S), now_s
        reported_m = np.nan_to_num(self._reported_on_pads_m())
        self._on_pad_m = np.where(reported_m, self._on_pad_m + share * (reported_m - self._on_pad_m), 0.0)
        height_m = self._on_pad_m
        self._off_ground = beyond(self._off_ground, np.abs(height_m), OFF_GROUND_M)
        for row in self._off_ground.nonzero()[0].tolist():
            side = "above" if height_m[row] > 0.0 else "below"
            because = f"stands on its start, and reports {abs(height_m[row]):.1f} m {side} it"
            vehicle_id = self.newest.state.ids[row]
            yield Condition(AlarmCause.HEIGHT_DIFFERS, because, (vehicle_id,), advice=REBOOT)

    def _reported_on_pads_m(self) -> Array:
        """(n,) heights that vehicles report which stand where they took off; 0 for the others."""
        height_m = np.zeros(len(self.vehicles))
        for row, (vehicle, landed) in enumerate(
            zip(self.vehicles.values(), self.newest.telemetry.landed, strict=True)
        ):
            if landed is Landed.ON_GROUND and vehicle.home_m is not None and vehicle.phase in MAY_STAND:
                above_m = vehicle.home_m - self.newest.state.position_m[row]
                if np.hypot(above_m[0], above_m[1]) < ON_PAD_M:  # False for NaN
                    height_m[row] = above_m[2]
        return height_m

    def of_authority(self, tick: Tick) -> Iterator[Condition]:
        """Yield that vehicles do not reach their velocities, and those with a lowered speed limit."""
        authority, safety = tick.memory.authority, self.control_now().safety
        wider_m = safety.floor.worst_reserve_m(authority.wander_m(safety.authority))
        self._wide = beyond(self._wide, np.array([wider_m]), WIDE_M)
        lack_m_s = np.sqrt((authority.lack_m_s * authority.lack_m_s).sum(axis=1))
        blown = self._blown(lack_m_s > safety.authority.lack_m_s)
        if self._wide[0] and len(blown):
            gusts = authority.fleet_wander_m_s > safety.authority.free_m_s
            why = "by wind or gusts" if gusts else "all alike: by wind, or a hard turn"
            because = f"up to {_off_m_s(authority):.1f} m/s off, {why}"
            if len(blown) == 1:
                off_m_s = float(lack_m_s[blown[0]])
                because = f"{self.newest.state.ids[blown[0]]} alone, {off_m_s:.1f} m/s off"
            consequence = f"Pairs keep up to {wider_m:.1f} m more than usual."
            yield Condition(AlarmCause.LITTLE_AUTHORITY, because, consequence=consequence)
        fastest_m_s = np.minimum(self.newest.traits.speed_max_m_s, safety.limits.horizontal_m_s)
        for row in authority.slow[: len(fastest_m_s)].nonzero()[0].tolist():
            reached_m_s = authority.speed_max_m_s[row]
            because = f"reaches {reached_m_s:.1f} of {fastest_m_s[row]:g} m/s"
            consequence = "[Its limit is|Their limits are] lowered until [it is|they are] faster again."
            yield Condition(AlarmCause.SLOW_VEHICLE, because, (self.newest.state.ids[row],), consequence)
        least_m_s2 = slowest_m_s2(self.newest.traits.response)
        for row in tick.memory.answers.slow[: len(fastest_m_s)].nonzero()[0].tolist():
            vehicle = self.vehicles.rows[row]
            because = f"{vehicle.autopilot.title}, less than {least_m_s2[row]:.1f} m/s^2"
            consequence = "[Its stops|Their stops] may be longer than the safety filter counts on."
            yield Condition(AlarmCause.SLOW_ANSWERS, because, (vehicle.id,), consequence)

    def _blown(self, lacks: Mask) -> list[int]:
        """Rows that show wind: several that `lacks` (n,) velocity, or one for long.

        A vehicle whose position is in doubt, or jumped, shows none: its velocity is then wrong as well.
        """
        now_s = self.newest.state.time_s
        jumped_s = now_s - self.table.reset_time_s
        lacks = lacks & ~self.newest.state.doubtful & (jumped_s > self.config.positioning.reset_margin_s)
        self._lacks_since_s = np.where(lacks, np.minimum(self._lacks_since_s, now_s), np.inf)
        self._lacked_s = np.where(lacks, now_s, self._lacked_s)
        blown = (now_s - self._lacked_s <= LACKED_S).nonzero()[0].tolist()
        if len(blown) == 1 and not now_s - self._lacks_since_s[blown[0]] >= LASTS_S:
            return []
        return blown


def _off_m_s(authority: Authority) -> float:
    """The most that a vehicle is off its velocity: what margins are widened by."""
    gusts_m2_s2 = np.maximum(authority.square_m2_s2, authority.fleet_wander_m_s**2)
    off_m2_s2 = 3.0 * gusts_m2_s2 + (authority.lack_m_s**2).sum(axis=1)
    return float(np.sqrt(off_m2_s2.max(initial=0.0)))
