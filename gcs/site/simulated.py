"""Several stations in virtual time: each ticks for its own vehicles and knows the others' from a bus."""

import heapq
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs.config.sections import OperationSettings
from gcs.control import ControlSettings, Memory, Tasks, tick
from gcs.control.law_step import LawRunner
from gcs.flight.features.laws.process import LawProcess
from gcs.formation.laws.registry import SHIPPED
from gcs.model.lifecycle import Phase
from gcs.model.plan import Plan
from gcs.model.state import Array, FleetState, Mode, Setpoints, Traits, VehicleId
from gcs.model.vehicle_columns import SENT
from gcs.simulation.decide import Decided
from gcs.simulation.scenario import Divided
from gcs.simulation.simulated_flight import law_process
from gcs.simulation.world import TrueWorld
from gcs.stations.messages import MODE_CODE, PHASE_CODE
from gcs.stations.publishing import STATES, FormationMessages, Reported, batch
from gcs.stations.site import Site, StationFleet
from gcs.stations.space_without_control import WithoutControl

LEAD_SILENT_S = 1.0
"""After this silence of the lead a station computes the whole formation itself."""


class _Bus:
    """Delivers each message late, and not every one. Seeded."""

    def __init__(self, settings: Divided, seed: int) -> None:
        self._settings = settings
        self._random = np.random.default_rng([seed, 4])
        self._under_way: dict[str, list[tuple[float, int, str, str, bytes]]] = {}  # to each station
        self._count = 0

    def publish(
        self, sender: str, receivers: Sequence[str], topic: str, payload: bytes, now_s: float
    ) -> None:
        settings = self._settings
        late_s = (
            now_s + settings.delay_s + settings.spread_s * self._random.uniform(-1.0, 1.0, len(receivers))
        )
        kept = self._random.random(len(receivers)) >= settings.loss
        for receiver, at_s, arrives in zip(receivers, late_s.tolist(), kept.tolist(), strict=True):
            if arrives:
                self._count += 1
                message = (at_s, self._count, sender, topic, payload)
                heapq.heappush(self._under_way.setdefault(receiver, []), message)

    def deliver(self, receiver: Site, now_s: float) -> None:
        """Hand over what has arrived at one station by now."""
        under_way = self._under_way.get(receiver.own, [])
        while under_way and under_way[0][0] <= now_s:
            at_s, _, sender, topic, payload = heapq.heappop(under_way)
            receiver.receive(sender, topic, payload, at_s)


@dataclass(slots=True, eq=False)
class _Station:
    site: Site
    rows: NDArray[np.intp]  # (m,) of its own vehicles in the world
    order: NDArray[np.intp]  # (n,) of its own vehicles, then the others'
    memory: Memory
    formation: FormationMessages
    law: LawProcess | None = None  # of a law that is not shipped


class SimulatedStations:
    """The stations of a scenario. The first one leads."""

    def __init__(self, settings: Divided, world: TrueWorld, seed: int) -> None:
        """Each station has an equal share of the world's vehicles, in their order."""
        n = len(world.ids)
        parts = np.array_split(np.arange(n), settings.count)
        fleets = {
            f"s{number}": StationFleet(tuple(world.ids[row] for row in rows), (1.0,) * len(rows))
            for number, rows in enumerate(parts, 1)
        }
        operation = OperationSettings()
        alone = WithoutControl(operation.setpoint_loss_action, takeoff_height_m=operation.takeoff_height_m)
        self._bus, self._tick_s = _Bus(settings, seed), world.tick_s
        self._stations = []
        for number, (name, rows) in enumerate(zip(fleets, parts, strict=True)):
            others = np.concatenate([*parts[:number], *parts[number + 1 :]])
            site = Site(name, fleets, alone)
            site.home_m[:] = world.home_m[others]
            order = np.concatenate([rows, others])
            self._stations.append(_Station(site, rows, order, Memory.fresh(n, 0.0), FormationMessages(site)))

    def decide(
        self, fleet: FleetState, tasks: Tasks, plan: Plan, traits: Traits, settings: ControlSettings
    ) -> Decided:
        """One tick of every station, with what has arrived by then; the arguments are of the whole fleet."""
        now_s = fleet.time_s
        took_s, limited_by, decided, sent = [], [""] * len(fleet.ids), [], []
        for station in self._stations:
            own = (
                _rows_of(fleet, station.rows),
                _tasks_of(tasks, station.rows),
                traits.rows(station.rows),
            )
            began_s = time.thread_time()
            self._bus.deliver(station.site, now_s)
            others = station.site.others(now_s)
            shared = station.site.formation(now_s, LEAD_SILENT_S)
            before, runner = replace(station.memory), self._runner(station, plan, settings)
            result = tick(own[0], own[1], plan, own[2], before, settings, None, others, shared, runner=runner)
            station.memory = result.memory
            sent.append(self._messages(station, *own))
            took_s.append(time.thread_time() - began_s)
            for row, why in zip(station.rows.tolist(), result.limited_by, strict=False):
                limited_by[row] = why
            decided.append(result.setpoints)
        for station, messages in zip(self._stations, sent, strict=True):
            receivers = [other.site.own for other in self._stations if other is not station]
            for topic, payload in messages:
                self._bus.publish(station.site.own, receivers, topic, payload, now_s)
        return Decided(_joined(fleet, decided), self._of_all(), tuple(limited_by), tuple(took_s))

    @property
    def law_failed(self) -> str:
        """Which station does not rely on its law any more, and why."""
        laws = ((station.site.own, station.law) for station in self._stations)
        return next((f"station {name}: {law.failed}" for name, law in laws if law and law.failed), "")

    def close(self) -> None:
        for station in self._stations:
            if station.law is not None:
                station.law.close()

    def _runner(self, station: _Station, plan: Plan, settings: ControlSettings) -> LawRunner | None:
        """What computes a law that is not shipped. Raises: ConfigError when its process does not begin."""
        name = plan.formation.law
        if name in SHIPPED:
            return None
        if station.law is None:
            station.law = law_process(name, settings, len(station.order), self._tick_s)
        return station.law.velocity

    def _messages(
        self, station: _Station, fleet: FleetState, tasks: Tasks, traits: Traits
    ) -> list[tuple[str, bytes]]:
        """Topics and payloads of this tick."""
        n, site = len(fleet.ids), station.site
        unknown, flying = [np.full(n, np.nan)] * len(SENT), np.ones(n, np.bool_)
        formed = np.isfinite(station.memory.engaged_time_s[:n])
        phases = np.where(formed, PHASE_CODE[Phase.FORMATION], PHASE_CODE[Phase.HOLD]).astype(np.uint8)
        modes = np.full(n, MODE_CODE[Mode.OFFBOARD], np.uint8)
        reported = Reported(phases, modes, flying, flying, unknown)
        made = batch(site, fleet, tasks, traits.uncertainty_m, station.memory, reported)
        messages: list[tuple[str, bytes]] = [(STATES, made.encode())]
        if site.lead.leads:
            messages.extend(station.formation.of_tick(fleet.time_s, station.memory, reported))
        return messages

    def _of_all(self) -> Memory:
        """The memories of all stations as one: of each vehicle what its own station keeps."""
        first = self._stations[0].memory
        slots = first.slots
        unfollowed_s = None if first.unfollowed_s is None else self._column("unfollowed_s")
        return replace(
            first,
            desired_m_s=self._column("desired_m_s"),
            unfiltered_m_s=self._column("unfiltered_m_s"),
            asked_m_s=self._column("asked_m_s"),
            setpoint_m_s=self._column("setpoint_m_s"),
            yaw_rad=self._column("yaw_rad"),
            engaged_time_s=self._column("engaged_time_s"),
            expected_m_s=self._column("expected_m_s"),
            law_state=slots and replace(slots, place=self._column("place"), unfollowed_s=unfollowed_s),
        )

    def _column(self, name: str) -> Array:
        first = self._stations[0].memory
        column: Array = np.empty((len(first.place), *getattr(first, name).shape[1:]))
        for station in self._stations:
            column[station.rows] = getattr(station.memory, name)[: len(station.rows)]
        return column


def _rows_of(fleet: FleetState, rows: NDArray[np.intp]) -> FleetState:
    ids = tuple(fleet.ids[row] for row in rows.tolist())
    position_m, velocity_m_s, yaw_rad, age_s = (
        column[rows] for column in (fleet.position_m, fleet.velocity_m_s, fleet.yaw_rad, fleet.age_s)
    )
    return FleetState(fleet.time_s, ids, position_m, velocity_m_s, yaw_rad, age_s, fleet.doubtful[rows])


def _tasks_of(tasks: Tasks, rows: NDArray[np.intp]) -> Tasks:
    """The tasks of some vehicles, with the paths of those of them that are lost."""
    follows, segments_of = tasks.follows_planned_path, tasks.segments_of
    owners = np.zeros(0, np.intp) if segments_of is None else segments_of
    place = np.full(len(tasks.task), -1)
    place[rows] = np.arange(len(rows))
    ours = place[owners] >= 0
    silent = np.arange(len(owners)) >= len(owners) - tasks.silent_segments
    return replace(
        tasks,
        task=tasks.task[rows],
        goal_m=tasks.goal_m[rows],
        airborne=tasks.airborne[rows],
        descending=tasks.descending[rows],
        segments_m=tasks.segments_m[ours] if len(owners) else np.zeros((0, 2, 3)),
        follows_planned_path=None if follows is None else follows[rows],
        segments_of=place[owners[ours]],
        drift=None if tasks.drift is None else (tasks.drift[0][rows], tasks.drift[1][rows]),
        silent_segments=int(np.count_nonzero(ours & silent)),
    )


def _joined(fleet: FleetState, parts: Sequence[Setpoints]) -> Setpoints:
    """The setpoints of all stations as one."""
    ids = tuple(_all_ids(parts))
    if ids == fleet.ids:
        ids = fleet.ids
    return Setpoints(
        fleet.time_s,
        ids,
        np.concatenate([setpoints.velocity_m_s for setpoints in parts]),
        np.concatenate([setpoints.yaw_rad for setpoints in parts]),
    )


def _all_ids(parts: Sequence[Setpoints]) -> Iterator[VehicleId]:
    for setpoints in parts:
        yield from setpoints.ids
