"""The service flown over light vehicles, its links alone, and how long they take to connect."""

import asyncio
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite, nan

import numpy as np
import yaml

from gcs.cli.service.serve import make_link, raise_priority
from gcs.config.schema import Config, parse
from gcs.control import Memory
from gcs.flight.orchestrator import Orchestrator
from gcs.links.batch_link import Link
from gcs.mavlink.kernels import BEGIN, Bytes, Whole
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mode, Setpoints, Telemetry
from tests.bench.link_measures import (
    EACH,
    FIRST_PORT,
    MEASURED_S,
    MEETING_S,
    WARM_UP_S,
    Cost,
    Fleet,
    Gaps,
    flying,
    namespaces,
    radius_m,
    resident_mb,
)
from tests.bench.link_traffic import FRAME, HOST

NUMBER_AT = 4  # of a MAVLink 2 frame: where its number is


def config_of(count: int, rate_hz: float, transport: str = "native", position_hz: float = 10.0) -> Config:
    """So many vehicles, 250 to a port."""
    links = [
        {
            "name": f"n{index}",
            "transport": transport,
            "listen": f"udpin://{HOST}:{FIRST_PORT + index}",
            "vehicles": {"count": min(EACH, count), "id_pattern": "{link}-{system_id}"},
            "streams": {"position_hz": position_hz},
        }
        for index in range(namespaces(count))
    ]
    origin = {
        "latitude_deg": FRAME.latitude_deg,
        "longitude_deg": FRAME.longitude_deg,
        "altitude_amsl_m": FRAME.altitude_amsl_m,
    }
    wide_m = radius_m(count)
    raw = {
        "show_frame": origin,
        "links": links,
        "formation": {"radius_m": wide_m, "height_m": wide_m + 10.0},
        "tick_rate_hz": rate_hz,
        "control": {"safety": {"fence": {"height_max_m": 300.0}}},
        "api": {"port": 0},
    }
    return parse(yaml.safe_dump(raw), "bench")


def links_of(config: Config) -> list[Link]:
    """As the service makes them."""
    return [make_link(settings, config) for settings in config.links]


class Passage:
    """How long it takes from a position's arrival until a setpoint made with it left; and what is lost."""

    def __init__(self, link: Link) -> None:
        self.waits_s: list[Array] = []
        self.gaps = Gaps(len(link.ids))
        self._link = link
        self._used_s = np.full(len(link.ids), -np.inf)  # arrival of the positions that setpoints were made of
        # when they were read, and the arrivals, of the last tick
        self._open: tuple[float, Array] | None = None
        self._snapshot = link.snapshot
        link.snapshot = self.snapshot  # type: ignore[method-assign]
        self._take = link._telemetry.take
        link._telemetry.take = self._take_batch  # type: ignore[method-assign]

    def snapshot(self) -> Telemetry:
        """As the link's. What was read the last time has left by now, or has not left at all."""
        if self._open is not None:
            self._note(*self._open)
        read_s = time.monotonic()
        telemetry = self._snapshot()
        self._open = read_s, telemetry.position_time_s
        return telemetry

    def _take_batch(self, data: Bytes, frames: Whole, rows: Whole, time_s: Array) -> None:
        """As the link's: an observer would be called frame by frame."""
        self.gaps.take(rows, data[frames[:, BEGIN] + NUMBER_AT].astype(np.int64))
        self._take(data, frames, rows, time_s)

    def _note(self, read_s: float, arrived_s: Array) -> None:
        left_s = self._left_s()
        new = np.isfinite(self._used_s) & (arrived_s > self._used_s) & (left_s >= read_s)
        self.waits_s.append(left_s[new] - arrived_s[new])
        self._used_s = np.where((left_s >= read_s) | ~np.isfinite(self._used_s), arrived_s, self._used_s)

    def _left_s(self) -> Array:
        """(n,) when the newest setpoint left, as the link's own records say."""
        return self._link._sent.newest_s.copy()


class Consumption:
    """What this process takes from the making of this until `cost`; nothing of it is measured meanwhile."""

    def __init__(self, links: Sequence[Link]) -> None:
        self._links = links
        self._began_s, self._began_cpu_s = time.monotonic(), time.process_time()
        self._before = self._sent()

    def _sent(self) -> int:
        return sum(link.setpoints_sent for link in self._links)

    def cost(self) -> Cost:
        """Since it began, before anything else is measured."""
        wall_s = time.monotonic() - self._began_s
        core_percent = 100 * (time.process_time() - self._began_cpu_s) / wall_s
        return Cost(core_percent, resident_mb(), (self._sent() - self._before) / wall_s)


def with_passages(
    cost: Cost,
    passages: Sequence[Passage],
    durations_s: Sequence[float] = (),
    lateness_s: Sequence[float] = (),
) -> Cost:
    """The cost, with what the passages saw of telemetry and setpoints, and with the times of ticks."""
    waits_s = np.concatenate([np.concatenate(passage.waits_s) for passage in passages])
    missing = sum(passage.gaps.missing for passage in passages)
    received = sum(passage.gaps.received for passage in passages)
    return replace(
        cost,
        passed_on_p99_ms=p99_ms(waits_s),
        tick_p99_ms=p99_ms(durations_s),
        late_p99_ms=p99_ms(lateness_s),
        lost_in_percent=100 * missing / max(received + missing, 1),
    )


def p99_ms(times_s: Array | Sequence[float]) -> float:
    """Of seconds; nan of none."""
    return float(np.percentile(np.array(times_s), 99)) * 1e3 if len(times_s) else nan


async def service(fleet: Fleet, config: Config, missing: int = 0) -> Cost:
    """The whole service with a formation in the air: law, safety, setpoints. Nothing asks the API.

    Processor time and ticks are measured first, then what passes through it: to measure that costs time too.
    `missing` vehicles are never received; the figures are those of the others.
    """
    count = len(config.fleet)
    links = links_of(config)
    orchestrator = Orchestrator(config, links)
    flight = orchestrator.flight
    raise_priority(orchestrator, config.scheduling)
    running = asyncio.create_task(orchestrator.run())
    await in_formation(orchestrator, links, count - missing)
    await asyncio.sleep(WARM_UP_S)
    clock = orchestrator._clock
    clock._duration_s.clear()
    clock._lateness_s.clear()
    consumption = Consumption(links)
    await asyncio.sleep(MEASURED_S)
    cost, durations_s, lateness_s = consumption.cost(), [*clock._duration_s], [*clock._lateness_s]
    passages = [Passage(link) for link in links]
    await asyncio.sleep(MEASURED_S)
    cost = with_passages(cost, passages, durations_s, lateness_s)
    still_there = sum(vehicle.phase is Phase.FORMATION for vehicle in flight.vehicles.values())
    await ended([running])
    if still_there < count - missing:
        print(f"only {still_there} of {count - missing} are still in formation", file=sys.stderr)
    return with_received(cost, links, fleet)


async def in_formation(orchestrator: Orchestrator, links: Sequence[Link], count: int) -> None:
    """Until so many are met; they are then flown, as after a start."""
    flight = orchestrator.flight
    here = await asyncio.wait_for(met(links, count), MEETING_S)
    for vehicle in flight.vehicles.values():
        if vehicle.id not in here:
            continue
        vehicle.phase, vehicle.modes = Phase.FORMATION, frozenset({Mode.OFFBOARD})
        vehicle.home_m = flight.newest.position_m(vehicle).copy()
    flight.newest.memory = Memory.fresh(len(flight.vehicles), asyncio.get_running_loop().time())
    flight.show.phase = ShowPhase.RUNNING


async def ended(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel them, and wait."""
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def with_received(cost: Cost, links: Sequence[Link], fleet: Fleet) -> Cost:
    """The cost, with what the fleet did not receive of all that ever left."""
    fleet.end()
    sent = sum(link.setpoints_sent for link in links)
    return replace(cost, lost_out_percent=100 * (sent - fleet.setpoints) / max(sent, 1))


async def met(links: Sequence[Link], count: int) -> frozenset[str]:
    """Until so many fly in OFFBOARD with a position. Returns: who."""
    while True:
        reported = [link.snapshot() for link in links]
        here = frozenset(
            name
            for each in reported
            for name, mode, latitude_deg in zip(each.ids, each.mode, each.latitude_deg.tolist(), strict=True)
            if mode is Mode.OFFBOARD and isfinite(latitude_deg)
        )
        if len(here) >= count:
            return here
        await asyncio.sleep(0.1)


async def connecting_s(count: int, transport: str) -> float:
    """The longest time from a vehicle's first heartbeat until it has a position and could be ordered."""
    links = links_of(config_of(count, 20.0, transport))
    running = [asyncio.create_task(link.run()) for link in links]
    await asyncio.sleep(2.0)
    met_s: dict[tuple[int, int], float] = {}
    with flying(count) as fleet:
        while len(met_s) < count:
            await asyncio.sleep(0.02)
            for index, reported in enumerate(link.snapshot() for link in links):
                now_s, here = time.monotonic(), np.isfinite(reported.latitude_deg + reported.heartbeat_time_s)
                for row in np.flatnonzero(here).tolist():
                    met_s.setdefault((index, row + 1), now_s)
    await ended(running)
    return fleet.connecting_s([(*key, when_s) for key, when_s in met_s.items()])


async def links_alone(fleet: Fleet, config: Config) -> Cost:
    """Telemetry to one batch, a batch to setpoints, nothing between."""
    links, rate_hz = links_of(config), config.tick_rate_hz
    running = [asyncio.create_task(link.run()) for link in links]
    still = np.zeros((EACH, 3))

    async def ticks(duration_s: float) -> None:
        start_s, tick = time.monotonic(), 0
        while time.monotonic() < start_s + duration_s:
            for link in links:
                link.snapshot()
                n = len(link.ids)
                link.send(Setpoints(time.monotonic(), link.ids, still[:n], still[:n, 0].copy()))
            tick += 1
            await asyncio.sleep(start_s + tick / rate_hz - time.monotonic())

    await ticks(WARM_UP_S)
    consumption = Consumption(links)
    await ticks(MEASURED_S)
    cost, passages = consumption.cost(), [Passage(link) for link in links]
    await ticks(MEASURED_S)
    await ended(running)
    return with_received(with_passages(cost, passages), links, fleet)
