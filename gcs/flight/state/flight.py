"""The runtime state of a flight: positions, phases, and the plan that the operator has set.

Plain data and queries; `commander` changes it on commands and events, `orchestrator` once a tick.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from itertools import chain
from operator import attrgetter, is_
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np

from gcs.config.schema import Config
from gcs.control import ControlSettings, Memory, Task, Tasks
from gcs.control.late_links import LateAmongFast, fleet_delay_s, for_late_links
from gcs.estimation.fleet_state import FORWARD_MAX_S, Table
from gcs.estimation.height_bias import HeightComparison
from gcs.estimation.link_delay import LinkDelay
from gcs.estimation.link_health import LinkQuality, SetpointGaps
from gcs.estimation.pad_places import PadPlaces
from gcs.estimation.positioning import uncertainty_m
from gcs.estimation.touch_down import height_error_m
from gcs.failsafe.autopilot_failsafe import TEXTS_COUNT_S, FailsafeInputs
from gcs.flight.state.elsewhere import Elsewhere
from gcs.flight.state.external_clock import ExternalClock
from gcs.flight.state.feature import Feature, Instant
from gcs.flight.state.newest import InForce, Newest
from gcs.flight.state.show_state import ShowState
from gcs.flight.state.start_hashes import start_hashes
from gcs.flight.state.uncontrolled_space import UncontrolledSpace
from gcs.flight.state.vehicle import SHOW_FLIES, FlightVehicles, Vehicle
from gcs.formation.laws.protocol import GoalShape
from gcs.formation.laws.registry import law_of
from gcs.formation.repulsion import NEAREST_FACTOR, NEAREST_FACTOR_FEW
from gcs.links import Command, ParameterValue
from gcs.links.autopilots.versions import Version
from gcs.links.batch_link import Link
from gcs.links.intake import Intake
from gcs.model.errors import CommandError
from gcs.model.lifecycle import AIRBORNE, GROUNDED, ON_THE_GROUND, Phase, ShowPhase
from gcs.model.preflight_report import Exclusion
from gcs.model.response import FLIES_ON_S, FleetResponse
from gcs.model.setpoint_loss import FleetWithoutSetpoints, WithoutSetpoints
from gcs.model.state import (
    Array,
    FleetState,
    Landed,
    Mask,
    Telemetry,
    Traits,
    VehicleId,
)
from gcs.planning.return_paths.paths import keeps_to_path, lowest_beside_m
from gcs.preflight.parameters import presumed_parameters
from gcs.preflight.vehicles import PAD_HEIGHT_MAX_M
from gcs.safety.impact import in_wind
from gcs.safety.neighbours import near_pairs
from gcs.service.commands import CommandLog

log = logging.getLogger(__name__)

T = TypeVar("T")

ASSEMBLED_M = 1.0
"""The formation is assembled when no radius is off by more, with ASSEMBLED_SHARE of the radius added."""

ASSEMBLED_SHARE = 0.05

SPREAD_SHARE, SPREAD_EVENLY, SETTLES_S = 0.7, 0.9, 15.0
"""And when the two nearest directions are apart by this share of those in the best shape known: the second
without slots, where vehicles spread for long after they are on the sphere, or the first for this time.
"""

AT_REST_M_S = 0.5
"""A killed vehicle that moves faster may be falling."""

FLIES = AIRBORNE | {Phase.PILOT}

NOT_CHOSEN: Final = "not chosen"
"""Why a vehicle does not fly where a start named others."""


def in_shape(shape: GoalShape, offset_m: Array, radius_m: float, charge: Array) -> bool:
    """Whether vehicles at (n, 3) from the centre, n >= 1, are where the law leads; True for other shapes."""
    if shape is GoalShape.SPHERE:
        return stands(offset_m, radius_m, charge)
    level_m = np.hypot(offset_m[:, 0], offset_m[:, 1])
    off_m = np.hypot(level_m - max(radius_m, float(level_m.mean())), offset_m[:, 2])
    return shape is not GoalShape.RING or bool((off_m < ASSEMBLED_M + ASSEMBLED_SHARE * radius_m).all())


def stands(offset_m: Array, radius_m: float, charge: Array, spread: float = SPREAD_SHARE) -> bool:
    """Whether the vehicles at (n, 3) from the centre, n >= 1, are on the sphere and spread over all of it."""
    distance_m = np.linalg.norm(offset_m, axis=1)
    near = np.abs(distance_m - radius_m) < ASSEMBLED_M + ASSEMBLED_SHARE * radius_m
    if not near.all() or len(offset_m) < 2:
        return bool(near.all())
    evenly = NEAREST_FACTOR_FEW.get(len(offset_m), NEAREST_FACTOR) / np.sqrt(len(offset_m))
    least = spread * evenly * np.sqrt(charge.min() / charge.mean())  # small charges settle closer
    every = np.ones(len(offset_m), np.bool_)
    first, _ = near_pairs(every, offset_m / distance_m[:, None], every, np.full(len(offset_m), least / 2.0))
    return len(first) == 0


Joined: TypeAlias = tuple[Sequence[Telemetry], Telemetry]
"""The telemetry of each link, and of all of them."""


def joined(
    parts: Sequence[Telemetry], order: Sequence[int] | None, before: Joined | None = None
) -> Telemetry:
    """The telemetry of several links as one; `order`: the place of each row among theirs, None: the same.

    Columns of Python values seldom change: where those of all links are the same as `before`, so is theirs.
    """
    if len(parts) == 1 and order is None:
        return parts[0]
    columns: dict[str, Any] = {}
    for name, of in _COLUMNS.items():
        values = list(map(of, parts))
        if isinstance(values[0], np.ndarray):
            column = np.concatenate(values)
            columns[name] = column if order is None else column[order]
        elif before is not None and all(map(is_, values, map(of, before[0]))):
            columns[name] = of(before[1])
        else:
            row = tuple(chain.from_iterable(values))
            columns[name] = row if order is None else tuple(row[place] for place in order)
    return Telemetry(**columns)


def _requested_hz(config: Config) -> Array:
    """(n,) positions a second that are requested and used of each vehicle."""
    looks_hz = config.tick_rate_hz
    return np.array([min(link.streams.position_hz, looks_hz) for link in config.links for _ in link.fleet])


_COLUMNS: Final = {field.name: attrgetter(field.name) for field in fields(Telemetry)}


def _copied(value: T) -> T:
    """A shallow copy of an object with a `__dict__`: `copy.copy` takes six times as long."""
    made = object.__new__(type(value))
    made.__dict__.update(value.__dict__)
    return made


_in_formation = lru_cache(maxsize=4)(Tasks.of_formation)
"""The same object from tick to tick: what is computed of it is kept as well."""


class Flight:
    """The runtime state of one fleet. Changed on the event loop only."""

    _stands_since_s: float = np.inf  # on the sphere and spread, see `assembled`

    def __init__(
        self,
        config: Config,
        links: Sequence[Link],
        now_s: float,
        *,
        unix_s: Callable[[], float] = time.time,
        book: CommandLog | None = None,
    ) -> None:
        """Starts with nothing received and nothing commanded. `now_s` is the loop's, `unix_s` since 1970."""
        self.config = config
        self.unix_s = unix_s
        self.book = book or CommandLog(None)
        self.links = tuple(links)
        self.link_of: Mapping[VehicleId, Link] = {name: link for link in links for name in link.ids}
        self.vehicles = self._made_vehicles()
        self.newest = Newest()
        self.elsewhere = Elsewhere(len(self.vehicles))  # of a flight alone
        self.parameters: dict[VehicleId, Mapping[str, ParameterValue]] = {}  # as last read on the ground
        self._fall_on_ground = [
            vehicle for vehicle in self.vehicles.values() if vehicle.autopilot.falls_on_ground
        ]
        self._presumed = presumed_parameters(config)
        for vehicle in self.vehicles.values():
            vehicle.without_setpoints = self._without_setpoints(vehicle)
        self.newest.traits = Traits(
            np.array([settings.charge for settings in config.fleet]),
            np.array([settings.speed_max_m_s or np.inf for settings in config.fleet]),
            np.full(len(config.fleet), config.control.safety.floor.uncertainty_m),
            self._response(),
        )
        target = replace(config.plan.target, time_s=now_s)
        self.in_force = InForce(replace(config.plan, target=target), config.control)
        self.show = ShowState(lambda: self.newest.state.time_s)
        self.columns = ""  # how many pairs will be stacked, in words; as of the last start
        self.excluded: dict[VehicleId, Exclusion] = {}  # taken out of the show by an operator
        self.outside_clock: ExternalClock  # that shows follow; set as the flight gets its features
        self.features: list[Feature] = []
        self.newest.memory = Memory.fresh(len(self.vehicles), now_s)
        self.changed_parameters: dict[VehicleId, dict[str, str]] = {}  # changed from what preflight requires
        received_in = [name for link in links for name in link.ids]
        place_of = {name: place for place, name in enumerate(received_in)}
        order = [place_of[settings.id] for settings in config.fleet]  # rows among all links' vehicles
        self._order = None if order == sorted(order) else order
        self._joined: Joined | None = None  # of the last tick
        self._once: tuple[FleetState | None, dict[str, Any]] = None, {}  # of the newest state: see `once`
        self.table = self._made_table()
        self.uncontrolled = UncontrolledSpace(config, tuple(self.vehicles.values()))
        self.link_quality = LinkQuality(_requested_hz(config))
        self.link_delay = LinkDelay(len(self.vehicles))
        self.heights = HeightComparison(len(self.vehicles), config.heights)
        self.places = PadPlaces(len(self.vehicles), config.control.safety.floor.vertical_uncertainty)
        self._windy: tuple[ControlSettings, ControlSettings] | None = None  # see `limits_now`
        self._slowed: tuple[ControlSettings, float, ControlSettings] | None = None  # see `control_now`
        self._late_among_fast = LateAmongFast(len(self.vehicles))
        self.newest.silent = np.ones(len(self.vehicles), dtype=np.bool_)
        self.newest.has_heartbeat = ~self.newest.silent
        self.newest.without_heartbeat = {}
        self.setpoint_gaps = SetpointGaps(len(self.vehicles))
        self._ticked = asyncio.Event()
        self.receive(now_s)

    def __copy__(self) -> "Flight":
        """As it is now: a view of a tick is made of it later. Copied with every tick."""
        copied = _copied(self)
        copied.show, copied.newest = _copied(self.show), _copied(self.newest)
        copied.in_force = _copied(self.in_force)
        return copied

    @property
    def intakes(self) -> Sequence[Intake]:
        """What bounds the inputs beside the vehicles' own."""
        others = chain.from_iterable(link.counters.intakes for link in self.links)
        own = chain.from_iterable(feature.intakes for feature in self.features)
        return *own, *self.elsewhere.intakes, *others

    def _made_vehicles(self) -> FlightVehicles:
        """Return the configured vehicles, in order."""
        autopilots = [profile for link in self.config.links for profile in link.autopilots]
        return FlightVehicles(
            Vehicle(
                settings.id,
                row,
                settings.system_id,
                self.link_of[settings.id].name,
                settings.charge,
                autopilot=autopilots[row],
            )
            for row, settings in enumerate(self.config.fleet)
        )

    def _made_table(self) -> Table:
        config, alone = self.config, [vehicle.without_setpoints for vehicle in self.vehicles.values()]
        noticed_s = FORWARD_MAX_S + config.setpoint_timeout_s + max(each.flies_on_s for each in alone)
        flies_on_s = max(noticed_s, config.operation.silence_s)
        fastest_m_s = config.control.safety.limits.horizontal_m_s
        brakes_s = 2.0 * max(each.stop_s(fastest_m_s) for each in alone)
        return Table(config.ids, config.frame, flies_on_s=flies_on_s, brakes_s=brakes_s)

    def receive(self, now_s: float) -> FleetState:
        parts = [link.snapshot() for link in self.links]
        self.newest.telemetry = joined(parts, self._order, self._joined)
        self._joined = parts, self.newest.telemetry
        self.newest.state = self.table.state(parts, now_s, self.newest.memory.asked_m_s[: len(self.vehicles)])
        if self._fall_on_ground:
            self.newest.telemetry = self._without_falling(self.newest.telemetry)
        if np.count_nonzero(owned := self.elsewhere.owned) < len(owned):  # others say where these are
            position_m = self.newest.state.position_m.copy()
            position_m[~owned] = np.nan
            self.newest.state = replace(self.newest.state, position_m=position_m)
        jumps = now_s - self.table.reset_time_s, self.table.jumped_m
        about = self.uncertainty_on_pads_m, *jumps, self.in_force.control.safety.floor.deviations
        uncertain_m, traits = self.config.positioning.after_jumps_m(*about), self.newest.traits
        self.newest.traits = Traits(traits.charge, traits.speed_max_m_s, uncertain_m, traits.response)
        return self.newest.state

    @property
    def uncertainty_on_pads_m(self) -> Array:
        """(n,) Without what jumps add in flight: when a neighbour's estimator resets, no pad moves."""
        telemetry, floor = self.newest.telemetry, self.in_force.control.safety.floor
        least = floor.uncertainty_m, floor.vertical_uncertainty
        reported = telemetry.horizontal_accuracy_m, telemetry.vertical_accuracy_m, telemetry.fix_type
        wide_m = uncertainty_m(*least, *reported, self.config.positioning)
        if np.count_nonzero((biases := self.heights.found).named):
            wide_m = wide_m + biases.widening_m(floor.deviations, floor.vertical_uncertainty)
        return wide_m

    def note_links(self) -> None:
        """Note how telemetry arrived, its heights, and where vehicles stand. After the setpoints."""
        self.link_quality.note(self.newest.telemetry.position_time_s, self.newest.state.time_s)
        self.link_delay.note(
            self.newest.telemetry.clock_base_s, self.newest.telemetry.round_trip_s, self.newest.state.time_s
        )
        fresh = self.newest.state.age_s <= self.in_force.control.telemetry_age_max_s
        self.heights.note(self.newest.telemetry, fresh, self.newest.state.time_s)
        if self.places.is_due(self.newest.state.time_s):
            state, wide_m = self.newest.state, self.uncertainty_on_pads_m
            self.places.note(self.newest.telemetry, state.position_m, fresh, wide_m, state.time_s)

    def slow_from_m(self, vehicles: Sequence[Vehicle]) -> Array:
        """(k,) reported heights above the ground from which these descend slowly: they may be lower."""
        return self.once("slow from", self._slow_from_now_m)[[vehicle.row for vehicle in vehicles]]

    def _slow_from_now_m(self) -> Array:
        error_m = height_error_m(self.newest.telemetry.vertical_accuracy_m, self.heights.departed_m)
        return np.asarray(self.config.operation.handover_height_m + error_m)

    def note_parameters(self, vehicle: Vehicle, values: Mapping[str, ParameterValue]) -> None:
        """Take the parameters of a vehicle as read; what it does without setpoints follows from them."""
        self.parameters[vehicle.id] = values
        alone = self._without_setpoints(vehicle)
        if alone != vehicle.without_setpoints:
            vehicle.without_setpoints = alone
            of_all = [each.without_setpoints for each in self.vehicles.values()]
            self.uncontrolled.without_setpoints = FleetWithoutSetpoints(of_all)
        self.newest.traits = replace(self.newest.traits, response=self._response())

    def _without_setpoints(self, vehicle: Vehicle) -> WithoutSetpoints:
        operation = self.config.operation
        action, loss_s = operation.setpoint_loss_action, operation.setpoint_loss_s
        return vehicle.autopilot.without_setpoints(action, loss_s, self._known_parameters(vehicle))

    def _response(self) -> FleetResponse:
        """How the vehicles answer setpoints and their end, by their profiles and their parameters as read."""
        return FleetResponse.of(
            [
                replace(
                    vehicle.autopilot.response(self._known_parameters(vehicle)),
                    blind_s=max(vehicle.without_setpoints.flies_on_s - FLIES_ON_S, 0.0),
                )
                for vehicle in self.vehicles.values()
            ]
        )

    def start_hashes(self, vehicles: Sequence[VehicleId], show_hash: str | None) -> dict[str, str]:
        """What a start of these vehicles stands for, by names in the audit."""
        return start_hashes(vehicles, self.config.flight_site, show_hash, self.parameters)

    def _known_parameters(self, vehicle: Vehicle) -> Mapping[str, ParameterValue]:
        """Those that were read, and until then those that are demanded."""
        return self.parameters.get(vehicle.id) or self._presumed.get(vehicle.id, {})

    def version(self, vehicle_id: VehicleId) -> str:
        """Of its autopilot, as reported; empty: not yet."""
        return str(Version.of(self.newest.telemetry.version[self.vehicles[vehicle_id].row]) or "")

    def in_formation_m(self, vehicles: Sequence[Vehicle]) -> Array:
        """(k,) as `Newest.uncertainty_m`, and of those flown elsewhere that take part with them."""
        return np.concatenate([self.newest.uncertainty_m(vehicles), self.elsewhere.uncertainty_m()])

    @property
    def limits_now(self) -> ControlSettings:
        """The control settings in force; falls go as far as in the measured wind, if that is more."""
        settings, wind_m_s = self.in_force.control, self.newest.wind_m_s
        if not wind_m_s > settings.safety.impact.wind_max_m_s:
            return settings
        impact, before = in_wind(settings.safety.impact, wind_m_s), self._windy
        if before is None or before[0] is not settings or before[1].safety.impact is not impact:
            safety = settings.safety.model_copy(update={"impact": impact})
            self._windy = before = settings, settings.model_copy(update={"safety": safety})
        return before[1]

    @property
    def control_now(self) -> ControlSettings:
        """The control settings of this tick: `control`, slower and wider where links are late."""
        # pairs across flights know each other later
        late_s = self.link_delay.delay_s + self.elsewhere.delay_s
        before, limits = self._slowed, self.limits_now
        before_s = 0.0 if before is None else before[1]
        delay_s = fleet_delay_s(late_s, self.vehicles.states.airborne, before_s)
        if before is None or before[0] is not limits or before[1] != delay_s:
            self._slowed = before = limits, delay_s, for_late_links(limits, delay_s)
        return before[2]

    @property
    def traits_now(self) -> Traits:
        """The traits of this tick: vehicles with links later than the fleet's fly with gains for them."""
        traits, late_s = self.newest.traits, self.link_delay.delay_s + self.elsewhere.delay_s
        flying = self.vehicles.states.airborne
        response = self._late_among_fast.response(traits.response, late_s, flying, self.control_now)
        return traits if response is traits.response else replace(traits, response=response)

    def note_seen(self, rows: Mask) -> None:
        self.uncontrolled.note_seen(rows, self.newest.state.position_m, self.table.last_velocity_m_s)

    def seen(self) -> FleetState:
        """The state; of silent vehicles the last known positions and velocities."""
        position_m, velocity_m_s = self.newest.state.position_m, self.newest.state.velocity_m_s
        located, moves = np.isfinite(position_m[:, :1]), np.isfinite(velocity_m_s[:, :1])
        if located.all() and moves.all():
            return self.newest.state
        position_m = np.where(located, position_m, self.uncontrolled.seen_m)
        velocity_m_s = np.where(moves, velocity_m_s, self.uncontrolled.seen_m_s)
        return replace(self.newest.state, position_m=position_m, velocity_m_s=velocity_m_s)

    @property
    def setpoints_sent(self) -> int:
        return sum(link.setpoints_sent for link in self.links)

    @property
    def late_samples(self) -> int:
        return sum(link.counters.late_samples for link in self.links)

    @property
    def instant(self) -> Instant:
        """What features are asked about."""
        return Instant(self.newest.state.time_s, self.show.phase, self.show.run)

    def once(self, name: str, compute: Callable[[], T]) -> T:
        """What `compute` returns, computed once for the state of this tick: all vehicles ask for it."""
        if self._once[0] is not self.newest.state:
            self._once = self.newest.state, {}
        values = self._once[1]
        if name not in values:
            values[name] = compute()
        value: T = values[name]
        return value

    async def ticked(self) -> None:
        await self._ticked.wait()

    def wake(self) -> None:
        self._ticked.set()
        self._ticked = asyncio.Event()

    async def execute(self, command: Command) -> None:
        """Send a command to the vehicle's link. Raises: CommandError."""
        if not self.elsewhere.owned[self.vehicles[command.vehicle_id].row]:
            raise CommandError(f"{command.vehicle_id} is flown by another station")
        await self.link_of[command.vehicle_id].execute(command)

    def climb_ended(self, vehicle: Vehicle) -> bool:
        """Whether the autopilot's own take-off has ended."""
        landed, up_m_s = (
            self.newest.telemetry.landed[vehicle.row],
            -float(self.newest.state.velocity_m_s[vehicle.row, 2]),
        )
        return vehicle.autopilot.climb_ended(self.newest.mode(vehicle), landed, up_m_s)

    def inputs(self, vehicle: Vehicle) -> FailsafeInputs:
        """Return the inputs that explain the vehicle's mode: see `gcs.failsafe.autopilot_failsafe`."""
        telemetry, at, now_s = self.newest.telemetry, vehicle.row, self.newest.state.time_s
        return FailsafeInputs(
            mode=telemetry.mode[at],
            in_failsafe=telemetry.in_failsafe[at],
            battery_remaining=float(telemetry.battery_remaining[at]),
            battery_critical_below=self.config.failsafes.low_battery.critical_below,
            texts=[text.text for text in telemetry.texts[at] if now_s - text.time_s <= TEXTS_COUNT_S],
            setpoint_gap_s=self.setpoint_gaps.longest_s(vehicle.row),
            setpoint_loss_s=vehicle.without_setpoints.flies_on_s,
            setpoint_loss_action=alone.action if (alone := vehicle.without_setpoints).changes_mode else "",
            position_age_s=float(self.newest.state.age_s[vehicle.row]),
            beyond_fence=vehicle.autopilot.beyond_fence(int(telemetry.unhealthy_sensors[at])),
            position_doubtful=bool(self.newest.state.doubtful[at]),
        )

    def note_setpoints(self) -> None:
        """Begin a tick, before telemetry changes phases: see `SetpointGaps` and `KeptSetpoints`."""
        phases = self.vehicles.phases
        left = np.zeros(len(phases), np.bool_)
        if Phase.PILOT in phases:
            left[:] = [phase is Phase.PILOT for phase in phases]
        memory, fleet, n = self.newest.memory, self.newest.state, len(phases)
        self.setpoint_gaps.note(~np.isnan(memory.desired_m_s[:n, 0]), left, fleet.time_s)
        self.uncontrolled.note_setpoints(memory, self.table.sample_age_s(fleet.time_s), fleet.time_s)

    @property
    def known(self) -> set[VehicleId]:
        """Vehicles that have reported all that a start requires, and are still where they stood."""
        config = self.config
        names = set(self.parameters if config.operation.require_parameters else self.vehicles)
        reported = np.isinf(self.places.found.since_s)
        if config.preflight.require_fix:
            reported &= np.isfinite(self.newest.telemetry.fix_type)
        if config.preflight.clock_max_s is not None:
            reported &= np.isfinite(self.newest.telemetry.clock_base_s)
        return names - {self.newest.state.ids[row] for row in (~reported).nonzero()[0].tolist()}

    @property
    def not_flying(self) -> dict[VehicleId, str]:
        """Vehicles that stay on the ground while the others fly or will fly, with the reasons."""
        why = {name: str(exclusion) for name, exclusion in self.excluded.items()}
        if self.show.phase not in ON_THE_GROUND:
            why = self.show.left_behind | why
        return {name: text for name, text in why.items() if self.vehicles[name].phase in GROUNDED}

    def _without_falling(self, telemetry: Telemetry) -> Telemetry:
        """Telemetry in which no killed vehicle that may still fall is on the ground."""
        falling = [vehicle.row for vehicle in self._fall_on_ground if self._may_fall(vehicle)]
        if not falling:
            return telemetry
        landed = list(telemetry.landed)
        for row in falling:
            landed[row] = Landed.UNKNOWN
        return replace(telemetry, landed=tuple(landed))

    def _may_fall(self, vehicle: Vehicle) -> bool:
        """Whether a killed vehicle may still be in the air, by its height and speed."""
        if vehicle.phase is not Phase.KILLED:
            return False
        pad_m = 0.0 if vehicle.home_m is None else float(vehicle.home_m[2])
        height_m = pad_m - float(self.newest.state.position_m[vehicle.row, 2])
        speed_m_s = float(np.linalg.norm(self.newest.state.velocity_m_s[vehicle.row]))
        return not (height_m <= PAD_HEIGHT_MAX_M and speed_m_s <= AT_REST_M_S)  # True for NaN

    def may_descend(self, vehicle: Vehicle) -> bool:
        """Whether every lower landing vehicle is in its landing column, so that this one may descend."""
        return not self.once("lowest beside", self._lowest_beside_m) > self.newest.position_m(vehicle)[2]

    def _lowest_beside_m(self) -> float:
        landing = [
            vehicle
            for vehicle in self.vehicles.in_phase(Phase.LANDING)
            if vehicle.goal_m is not None and not vehicle.flags.handed_over  # else it goes nowhere but down
        ]
        here_m = self.newest.state.position_m[[vehicle.row for vehicle in landing]]
        goal_m = np.array([vehicle.goal_m for vehicle in landing], dtype=float).reshape(-1, 3)
        return lowest_beside_m(here_m, goal_m)

    def assembled(self) -> bool:
        """Whether the formation's vehicles are where its law leads: on the sphere and spread over all of it.

        The leading flight decides for all: vehicles that pass the space of lost ones are never spread evenly.
        """
        if self.elsewhere.lead_runs:
            return True
        if self.show.run is not None and self.show.run.goals is not None:
            return self.show.run.there
        center, radius_m = self.newest.memory.center, self.newest.memory.radius_m
        rows = [vehicle.row for vehicle in self.vehicles.in_phase(Phase.FORMATION)]
        if center is None or not rows:
            return False
        their_m, their_charge = self.elsewhere.formed_m()
        here_m = np.concatenate([self.newest.state.position_m[rows], their_m])
        charge = np.concatenate([self.newest.traits.charge[rows], their_charge])
        on_sphere = here_m - center.position_m, radius_m, charge
        now_s, law = self.newest.state.time_s, law_of(self.in_force.plan.formation.law)
        shaped = in_shape(law.goal_shape, *on_sphere)
        self._stands_since_s = min(self._stands_since_s, now_s) if shaped else np.inf
        if law.has_slots or now_s - self._stands_since_s >= SETTLES_S:
            return self._stands_since_s <= now_s
        return law.goal_shape is GoalShape.SPHERE and stands(*on_sphere, SPREAD_EVENLY)

    def tasks(self) -> Tasks:
        """What every vehicle has to do in this tick."""
        tasks, show_run = self._tasks_now(), self.show.run
        if show_run is not None and show_run.goals is not None:
            tasks = tasks.led_by(show_run.goals, moves=show_run.moves)
        if self.newest.near_traffic is not None:
            tasks = replace(tasks, near_traffic=self.newest.near_traffic)
        if self.newest.kept_clear:
            tasks = replace(tasks, kept_clear=tuple(self.newest.kept_clear.values()))
        self.last_tasks = tasks
        return tasks

    def _tasks_now(self) -> Tasks:
        vehicles = self.vehicles.values()  # rows as in FleetState
        now_s, show = self.newest.state.time_s, self.show.phase
        show_flies = show in SHOW_FLIES
        states = self.vehicles.states
        phases = states.phases
        flown = show_flies and now_s >= states.frozen_until_s and phases.count(Phase.FORMATION) == len(phases)
        age_s = self.newest.state.age_s
        silent = self.uncontrolled.silent(age_s, self.in_force.control.telemetry_age_max_s)
        if flown and len(silent) == 0:  # the usual case
            return _in_formation(len(phases), center_moves=show is ShowPhase.RUNNING)
        task = np.full(len(vehicles), Task.FORMATION, dtype=np.int8)
        goal_m = np.full((len(vehicles), 3), np.nan)
        for row, vehicle in enumerate(vehicles):
            if not show_flies or vehicle.phase is not Phase.FORMATION or now_s < vehicle.frozen_until_s:
                task[row], goal = vehicle.task(show, now_s)
                if goal is not None:
                    goal_m[row] = goal
        follows = np.array([vehicle.flags.follows_planned_path for vehicle in vehicles], dtype=np.bool_)
        segments_m, segments_of = self.uncontrolled.swept(self.newest.state.age_s)
        sample_age_s = self.table.sample_age_s(now_s)
        silent_m, silent_of = self.uncontrolled.near_m(silent, sample_age_s)
        return Tasks(
            task,
            goal_m,
            np.array([phase in FLIES for phase in phases]),
            np.array([phase is Phase.LANDING for phase in phases]),
            np.concatenate([segments_m, silent_m]),
            center_moves=show is ShowPhase.RUNNING,
            formation_waits=show is ShowPhase.PAUSED,
            # those far behind keep the right-of-way rules
            follows_planned_path=keeps_to_path(follows, self.newest.state.position_m, goal_m),
            segments_of=np.concatenate([segments_of, silent_of]),
            drift=self.uncontrolled.drift(silent, sample_age_s),
            silent_segments=len(silent_of),
        )

    def closed(self) -> tuple[Array, Array]:
        """(m, 2, 3) paths that lost vehicles of any flight may take, and (m,) the uncertainty of each."""
        segments_m, segments_of = self.uncontrolled.swept(self.newest.state.age_s)
        uncertainty_m = self.newest.traits.uncertainty_m[segments_of]
        their_m, their_uncertainty_m = self.elsewhere.closed()
        return np.concatenate([segments_m, their_m]), np.concatenate([uncertainty_m, their_uncertainty_m])

    def closing(self) -> frozenset[VehicleId]:
        """Lost vehicles of any flight: the paths that `closed` returns are theirs."""
        return self.once("closing", self._closing_now)

    def _closing_now(self) -> frozenset[VehicleId]:
        lost = self.vehicles.in_phase(Phase.LOST, Phase.KILLED)
        own = frozenset(vehicle.id for vehicle in lost if self.uncontrolled.last_m(vehicle) is not None)
        return own | self.elsewhere.closing()
