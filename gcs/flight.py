"""The runtime state of a flight: who is where, in which phase, and what the operator wants.

Plain data and questions about it; `director` changes it on orders and events, `orchestrator` once a tick.
"""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs.accuracy import uncertainty_m
from gcs.config import Config
from gcs.control import Memory, Tasks
from gcs.formation.thomson import NEAREST_FACTOR, NEAREST_FACTOR_FEW, nearest_m
from gcs.landing import STOP_S, swept_segments_m
from gcs.lifecycle import AIRBORNE, Phase, ShowPhase
from gcs.links import Link, Order, ParameterValue
from gcs.plan import Plan
from gcs.state import Array, FleetState, Mode, Telemetry, Traits, VehicleId
from gcs.table import Table
from gcs.vehicle import Vehicle

ASSEMBLED_M = 1.0
"""The sphere stands when nobody's radius is off by more, with ASSEMBLED_SHARE of the radius added."""

ASSEMBLED_SHARE = 0.05

SPREAD_SHARE = 0.7
"""And when the two nearest directions are apart by this share of what they are in the best shape known."""


class Flight:
    """One fleet, and what is going on with it. Changed only on the event loop."""

    def __init__(self, config: Config, links: Sequence[Link], now_s: float) -> None:
        """Nobody heard, nothing commanded. `links` carry all vehicles of `config`."""
        self.config = config
        self.links = tuple(links)
        self.link_of: Mapping[VehicleId, Link] = {name: link for link in links for name in link.ids}
        self.vehicles = {
            settings.id: Vehicle(
                settings.id, row, settings.system_id, self.link_of[settings.id].name, settings.charge
            )
            for row, settings in enumerate(config.fleet)
        }
        self.traits = Traits(
            np.array([settings.charge for settings in config.fleet]),
            np.array([settings.speed_max_m_s or np.inf for settings in config.fleet]),
            np.full(len(config.fleet), config.control.safety.floor.uncertainty_m),
        )
        self.plan: Plan = replace(config.plan, target=replace(config.plan.target, time_s=now_s))
        self.show = ShowPhase.IDLE
        self.reason = "nothing has been started"
        self.memory = Memory.fresh(len(self.vehicles), now_s)
        self.telemetry: dict[VehicleId, tuple[Telemetry, int]] = {}
        self.parameters: dict[VehicleId, Mapping[str, ParameterValue]] = {}  # as last read on the ground
        self.parameter_problems: dict[VehicleId, str] = {}  # why they could not be
        self._table = Table(config.ids, config.frame)
        self._ticked = asyncio.Event()
        self.fleet = self.hear(now_s)

    def hear(self, now_s: float) -> FleetState:
        """Take in the newest telemetry of all links."""
        parts = [link.snapshot() for link in self.links]
        self.telemetry = {name: (part, at) for part in parts for at, name in enumerate(part.ids)}
        self.fleet = self._table.state(parts, now_s)
        self._widen(now_s)
        return self.fleet

    def _widen(self, now_s: float) -> None:
        """Give every vehicle the margin that its reported accuracy, or a jump, asks for."""
        reported_m = np.array(
            [(part.horizontal_accuracy_m[at], part.vertical_accuracy_m[at]) for part, at in self._heard()]
        )
        wide_m = uncertainty_m(
            self.config.control.safety.floor.uncertainty_m,
            reported_m[:, 0],
            reported_m[:, 1],
            now_s - self._table.reset_time_s,
            self.config.positioning,
        )
        self.traits = replace(self.traits, uncertainty_m=wide_m)

    def _heard(self) -> list[tuple[Telemetry, int]]:
        """Of every vehicle in its order: its link's telemetry, and its row there."""
        return [self.telemetry[vehicle_id] for vehicle_id in self.vehicles]

    def reset_time_s(self, vehicle: Vehicle) -> float:
        """When its position last jumped; -inf when it never did."""
        return float(self._table.reset_time_s[vehicle.row])

    async def ticked(self) -> None:
        """Return after the next tick."""
        await self._ticked.wait()

    def wake(self) -> None:
        """A tick is done: wake those who wait for it."""
        self._ticked.set()
        self._ticked = asyncio.Event()

    async def execute(self, order: Order) -> None:
        """Pass an order to the vehicle's link. Raises: OrderError."""
        await self.link_of[order.vehicle_id].execute(order)

    def mode(self, vehicle: Vehicle) -> Mode:
        """As its newest heartbeat says."""
        telemetry, at = self.telemetry[vehicle.id]
        return telemetry.mode[at]

    def is_known(self, vehicle_id: VehicleId) -> bool:
        """Whether its parameters have been read, where they count."""
        return vehicle_id in self.parameters or not self.config.operation.require_parameters

    def in_phase(self, *phases: Phase) -> list[Vehicle]:
        """Vehicles in any of these phases."""
        return [vehicle for vehicle in self.vehicles.values() if vehicle.phase in phases]

    @property
    def airborne(self) -> list[Vehicle]:
        """Vehicles in the air that the service answers for."""
        return self.in_phase(*AIRBORNE)

    def position_m(self, vehicle: Vehicle) -> Array:
        """(3,) newest position, show frame."""
        position_m: Array = self.fleet.position_m[vehicle.row]
        return position_m

    def may_sink(self, vehicle: Vehicle) -> bool:
        """Whether everybody lower who comes down too is in its column, so that this one may follow."""
        here_m = self.position_m(vehicle)
        for other in self.in_phase(Phase.LANDING):
            there_m = self.position_m(other)
            if other is vehicle or other.goal_m is None or not there_m[2] > here_m[2]:
                continue
            if np.hypot(there_m[0] - other.goal_m[0], there_m[1] - other.goal_m[1]) > 1.0:
                return False
        return True

    def assembled(self) -> bool:
        """Whether everybody of the formation is on the sphere, and they are spread over all of it."""
        center, radius_m = self.memory.center, self.memory.radius_m
        rows = [vehicle.row for vehicle in self.in_phase(Phase.FORMATION)]
        if center is None or not rows:
            return False
        offset_m = self.fleet.position_m[rows] - center.position_m
        distance_m = np.linalg.norm(offset_m, axis=1)
        near = np.abs(distance_m - radius_m) < ASSEMBLED_M + ASSEMBLED_SHARE * radius_m
        if not near.all() or len(rows) < 2:
            return bool(near.all())
        charge = self.traits.charge[rows]  # those with small ones settle closer together
        evenly = NEAREST_FACTOR_FEW.get(len(rows), NEAREST_FACTOR) / np.sqrt(len(rows))
        least = SPREAD_SHARE * evenly * np.sqrt(charge.min() / charge.mean())
        return bool(nearest_m(offset_m / distance_m[:, None]) >= least)

    def tasks(self) -> Tasks:
        """What everybody is to do in this tick."""
        n = len(self.vehicles)
        task, goal_m = np.zeros(n, dtype=np.int8), np.full((n, 3), np.nan)
        airborne, descending = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        segments_m = [np.zeros((0, 2, 3))]
        for vehicle in self.vehicles.values():
            row = vehicle.row
            task[row], goal = vehicle.task(self.show, self.fleet.time_s)
            if goal is not None:
                goal_m[row] = goal
            airborne[row] = vehicle.phase in AIRBORNE | {Phase.PILOT}
            descending[row] = vehicle.phase is Phase.LANDING
            if vehicle.phase in {Phase.LOST, Phase.KILLED} and vehicle.last_m is not None:
                segments_m.append(self._swept_m(vehicle, vehicle.last_m))
        return Tasks(
            task,
            goal_m,
            airborne,
            descending,
            np.concatenate(segments_m),
            center_moves=self.show is ShowPhase.RUNNING,
            formation_waits=self.show is ShowPhase.PAUSED,
        )

    def _swept_m(self, vehicle: Vehicle, last_m: Array) -> Array:
        operation = self.config.operation
        killed = vehicle.phase is Phase.KILLED
        return swept_segments_m(
            last_m,
            vehicle.last_velocity_m_s,
            vehicle.home_m,
            "land" if killed else operation.setpoint_loss_action,
            operation.return_height_m,
            climbing_to_m=None if killed else operation.takeoff_height_m,
            drift_s=self.config.deadman_s + operation.setpoint_loss_s + STOP_S,
        )
