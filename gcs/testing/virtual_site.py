"""Flies several stations in virtual time: real orchestrators and links, fake fleets, a bus in memory."""

import asyncio
import atexit
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import Any, TypeVar

import numpy as np

from gcs.config.schema import Config
from gcs.config.site import station_config
from gcs.flight.orchestrator import Orchestrator
from gcs.links.batch_link import Link
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, Mask, VehicleId
from gcs.preflight.parameters import settings_of
from gcs.recording.session import Record
from gcs.safety.floor import minimum_separation
from gcs.service import CommandRecord, FleetView, Outcome, ShowAction
from gcs.shows.packed import unpacked
from gcs.sim.fleet import Fleet
from gcs.sim.settings import PAD_SPACING_M, Settings
from gcs.site import arrivals
from gcs.site.member import Membership
from gcs.site.service import SiteService
from gcs.testing.copies import in_a_copy
from gcs.testing.memory_bus import MemoryBus, MemoryNetwork, network
from gcs.testing.virtual_link import STREAMS_HZ, VirtualLink, VirtualPorts
from gcs.testing.virtual_show import (
    LAW_WAIT_S,
    ORIGIN,
    POSITIONING,
    READY_AT_ONCE,
    SOON_DISARMED,
    TICK_STEP_S,
    begin_of,
    load_machine_code,
)
from gcs.testing.virtual_time import AtOnce, ProcessLoop, UnixClock, VirtualLoop, as_process

T = TypeVar("T")

vars(arrivals)["unpacked_apart"] = unpacked  # a process takes seconds, in which no virtual time passes

LOOKS_S = 0.2
"""Interval at which a story looks for what it waits for: each look makes the views of all stations."""

NAMES = ("north", "south", "west", "east")


def site_config(stations: int, each: int, **sections: Any) -> Config:
    """A site of some stations with `each` vehicles: n1, n2 ... s1 ...; `sections` replace others."""
    names = NAMES[:stations]
    field_m = PAD_SPACING_M * np.sqrt(stations * each)
    raw: dict[str, Any] = {
        "show_frame": ORIGIN,
        "links": [
            {
                "name": name,
                "transport": "native",
                "listen": f"udpin://127.0.0.1:{14540 + at}",
                "vehicles": {"count": each, "id_pattern": name[0] + "{system_id}"},
            }
            for at, name in enumerate(names)
        ],
        "stations": [
            {
                "name": name,
                "links": [name],
                "endpoint": {"host": "127.0.0.1", "port": 7447 + at},
                "api": {"port": 8000 + 2 * at},
            }
            for at, name in enumerate(names)
        ],
        "formation": {"radius_m": 12.0, "height_m": 20.0},
        "target": {"x_m": field_m / 2.0, "y_m": field_m / 2.0},
        "operation": {
            "takeoff_height_m": 5.0,
            "takeoff_stagger_s": 0.2,
            "setpoint_loss_action": "hold",
            "require_safe_setpoint_loss": False,
        },
        "positioning": POSITIONING,
    }
    return Config.model_validate({**raw, **sections})


def two_hosts(vehicles: int, *, rejoins: bool = False, west: bool = False, **sections: Any) -> Config:
    """North flies so many vehicles, and south is its standby on the same radio network.

    `west` adds a station with as many vehicles of its own.
    """
    raw = site_config(3 if west else 2, vehicles, **sections).model_dump()
    standby = [{"link": "north", "listen": "udpin://127.0.0.1:14640"}]
    north, south, *others = raw["stations"]
    raw["links"] = [link for link in raw["links"] if link["name"] != "south"]
    raw["stations"] = [north, south | {"links": [], "standby": standby}, *others]
    raw["bus"]["standby_rejoins"] = rejoins
    return Config.model_validate(raw)


class MirroredPorts(VirtualPorts):
    """Ports whose datagrams other ports receive as well: a radio network that several hosts are on."""

    def __init__(self, ids: Sequence[VehicleId], fleet: Fleet, clock: Callable[[], float]) -> None:
        super().__init__(ids, fleet, clock)
        self.mirrors: list[MirrorPorts] = []

    def _arrive(self, first_host: int, row: int, datagram: bytes) -> None:
        super()._arrive(first_host, row, datagram)
        for mirror in self.mirrors:
            mirror._arrive(first_host, row, datagram)


class MirrorPorts(VirtualPorts):
    """Another host's ports on the radio network of `first`."""

    def __init__(
        self, ids: Sequence[VehicleId], fleet: Fleet, clock: Callable[[], float], first: MirroredPorts
    ) -> None:
        super().__init__(ids, fleet, clock)
        self.step = first.step  # type: ignore[method-assign]
        self._to_vehicles = first._to_vehicles
        first.mirrors.append(self)


def own_config(site: Config, name: str) -> Config:
    """A station's configuration, with a folder of shows of its own where one of its name exists."""
    config = station_config(site, name)
    if config.shows is None or not (config.shows.folder / name).is_dir():
        return config
    shows = config.shows.model_copy(update={"folder": config.shows.folder / name})
    return config.model_copy(update={"shows": shows})


class VirtualStation:
    """One running station with its fake fleet."""

    def __init__(
        self, name: str, site: Config, first: int, columns: int, pads: Mapping[str, Any] | None = None
    ) -> None:
        self.name, self._site = name, site
        self.config = own_config(site, name)
        self.unix, self.planning, now_s = UnixClock(), AtOnce(), asyncio.get_running_loop().time()
        count = len(self.config.ids) - self.standby
        placed: dict[str, Any] = {"grid_columns": columns, **(pads or {})}
        settings = Settings(
            count=count,
            first=first,
            namespace_size=count,
            seed=7,
            rates_hz=STREAMS_HZ,
            together=True,
            quirks=READY_AT_ONCE,
            parameters={**SOON_DISARMED, **settings_of(site)},
            **placed,
        )
        self.radios: list[tuple[Fleet, MirroredPorts, VirtualLink]] = []  # none of a pure standby
        if count:
            own_ids, clock = self.config.ids[:count], asyncio.get_running_loop().time
            fleet = Fleet(settings, **begin_of(now_s, self.unix()))
            ports = MirroredPorts(own_ids, fleet, clock)
            self.radios = [(fleet, ports, VirtualLink(self.config, fleet, ids=own_ids, ports=ports))]

    @property
    def standby(self) -> int:
        """Vehicles of other stations that it stands by for."""
        return 0 if self.config.site_rows is None else self.config.site_rows.standby

    def run(self, stations: Mapping[str, "VirtualStation"], bus: MemoryBus) -> None:
        """Start the service."""
        links: list[Link] = [link for _, _, link in self.radios]
        owner = {link: each for each in self._site.stations for link in each.links}
        settings = next(each for each in self._site.stations if each.name == self.name)
        self.mirrors: dict[str, MirrorPorts] = {}
        for one in settings.standby:
            other = stations[owner[one.link].name]
            clock = asyncio.get_running_loop().time
            for fleet, first, _ in other.radios:
                self.mirrors[other.name] = ports = MirrorPorts(first.ids, fleet, clock, first)
                links.append(VirtualLink(self.config, fleet, ids=first.ids, ports=ports))
        self._bus = bus
        self._serve(links)

    def _serve(self, links: Sequence[Link], record: Record | None = None, session: int = 1) -> None:
        membership = Membership(self.name, self._site, self._bus, session)
        local = Orchestrator(
            self.config, links, record, unix_s=self.unix, planning=self.planning, law_wait_s=LAW_WAIT_S
        )
        self.service = SiteService(local, membership, self.planning)
        self.task = asyncio.create_task(self.service.run(), name=self.name, context=as_process(self.name))

    def restart(self, record: Record) -> None:
        """Start the service again after `kill`, with what its record has; for stations without standby."""
        self._alone.cancel()
        links = [VirtualLink(self.config, fleet, ids=one.ids, ports=one) for fleet, one, _ in self.radios]
        self._serve(links, record, session=2)

    @property
    def view(self) -> FleetView:
        """Newest state as this station shows it."""
        return self.service.view.value

    async def kill(self) -> None:
        """End the station as SIGKILL does; its vehicles fly on with nothing sent to them."""
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)
        self._alone = asyncio.create_task(self._fly_alone())

    def stop(self) -> None:
        """Have the station stand still as SIGSTOP does; its vehicles fly on."""
        self._loop.stop_process(self.name)
        self._alone = asyncio.create_task(self._fly_alone())

    def go_on(self) -> None:
        """End `stop`. What arrived meanwhile waits at its ports and on its bus."""
        self._alone.cancel()
        self._loop.continue_process(self.name)

    @property
    def _loop(self) -> ProcessLoop:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, ProcessLoop)
        return loop

    async def _fly_alone(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            for fleet, ports, _ in self.radios:
                while fleet.time_s + fleet.step_s / 2 < loop.time():
                    ports.step()
            await asyncio.sleep(TICK_STEP_S)


class SiteShow:
    """Several running stations, as a story gets them."""

    def __init__(self, site: Config, network_: MemoryNetwork, pads: Mapping[str, Any] | None = None) -> None:
        self.config, self.network = site, network_
        links = {link.name: len(link.fleet) for link in site.links}
        counts = [sum(links[name] for name in station.links) for station in site.stations]
        columns = int(np.ceil(np.sqrt(sum(counts))))
        self.stations = {
            station.name: VirtualStation(station.name, site, sum(counts[:at]), columns, pads)
            for at, station in enumerate(site.stations)
        }
        for name, each in self.stations.items():
            each.run(self.stations, network_.buses[name])
        self.violations = 0
        self.nearest_m = np.inf
        self._watching = asyncio.create_task(self._watch())

    def __getitem__(self, name: str) -> VirtualStation:
        return self.stations[name]

    @property
    def fleets(self) -> list[Fleet]:
        """The fake fleets of all stations."""
        return [fleet for each in self.stations.values() for fleet, _, _ in each.radios]

    @property
    def true_m(self) -> Array:
        """(n, 3) true positions of all vehicles, show frame."""
        frame = self.config.frame
        return np.concatenate([frame.from_ned(fleet.bodies.position_m) for fleet in self.fleets])

    @property
    def armed(self) -> Mask:
        """(n,) of all vehicles."""
        autopilots = [one for fleet in self.fleets for one in fleet.autopilots]
        return np.array([one.commander.armed for one in autopilots], dtype=np.bool_)

    async def _watch(self) -> None:
        """Judge the true states 20 times a second."""
        floor = self.config.control.safety.floor
        while True:
            nearest_m, pairs = minimum_separation(self.true_m, self.armed, floor)
            self.violations += pairs > 0
            self.nearest_m = min(self.nearest_m, nearest_m)
            await asyncio.sleep(0.05)

    async def wait(self, seconds: float) -> None:
        """Let time pass."""
        await asyncio.sleep(seconds)

    async def until(self, holds: Callable[[], bool], limit_s: float = 60.0) -> float:
        """Wait until `holds`. Returns: the duration in s. Raises: TimeoutError with the stations' states."""
        loop = asyncio.get_running_loop()
        began_s = loop.time()
        while not holds():
            if loop.time() - began_s > limit_s:
                shows = {
                    name: (each.view.show.value, each.view.reason) for name, each in self.stations.items()
                }
                raise TimeoutError(f"not within {limit_s} s: {shows}")
            await asyncio.sleep(LOOKS_S)
        return loop.time() - began_s

    async def reach(self, phase: ShowPhase, *names: str, limit_s: float = 60.0) -> float:
        """Wait until the shows of these stations, or of all, are in a phase."""
        chosen = [self.stations[name] for name in names or self.stations]
        return await self.until(lambda: all(each.view.show is phase for each in chosen), limit_s)

    async def start(self, at: str = "north") -> CommandRecord:
        """Start at one station, and wait until all fly in formation."""
        await self.until(lambda: all(all(each.view.rows.ready) for each in self.stations.values()), 20.0)
        await self.wait(3.0)  # pads and texts have crossed the bus
        record = self[at].service.commands.command_show(ShowAction.START)
        await self.reach(ShowPhase.RUNNING)
        return record

    async def settled(self, at: str, record: CommandRecord, limit_s: float = 120.0) -> CommandRecord:
        """Wait until no part of a command is pending at the station that was asked."""
        log = self[at].service.command_log
        await self.until(lambda: log.get(record.id).outcome is not Outcome.PENDING, limit_s)
        return log.get(record.id)

    def in_phase(self, name: str, phase: Phase) -> int:
        """Number of a station's own vehicles in a phase, as it has them."""
        rows = self[name].view.rows
        return sum(one is phase and of == name for one, of in zip(rows.phases, rows.stations, strict=True))


Story = Callable[[SiteShow], Awaitable[T]]


class SiteFlight:
    """Running stations, for one story after another. See `fly_on_pads`."""

    def __init__(self, site: Config, pads: Mapping[str, Any], **bus: Any) -> None:
        load_machine_code()
        self._loop = VirtualLoop()
        self._show = self._loop.play(self._begin(site, pads, bus))

    def play(self, story: Story[T]) -> T:
        """Play the next story."""
        return self._loop.play(self._play(story))

    def close(self) -> None:
        """Cancel everything that runs."""
        self._loop.close()

    async def _begin(self, site: Config, pads: Mapping[str, Any], bus: Mapping[str, Any]) -> SiteShow:
        names = [station.name for station in site.stations]
        return SiteShow(site, network(names, asyncio.get_running_loop().time, **bus), pads)

    async def _play(self, story: Story[T]) -> T:
        reported = asyncio.ensure_future(story(self._show))
        tasks = {each.task for each in self._show.stations.values()}
        while not reported.done():
            await asyncio.wait({reported, *tasks}, return_when=asyncio.FIRST_COMPLETED)
            for task in [one for one in tasks if one.done()]:
                tasks.discard(task)
                if not task.cancelled():
                    task.result()  # raises what ended it
        return await reported


_assembled: dict[str, SiteFlight] = {}
"""Sites that stand still in formation, by what made them."""


def fly_assembled(story: Story[T], site: Config, **bus: Any) -> T:
    """As `fly_site`, with a story that begins when all vehicles fly in formation.

    This part is flown once for all stories of the same site and bus. Each goes on in a copy of the process,
    from which only the result comes back.
    """
    made_of = f"{site.model_dump_json()} {bus}"
    if made_of not in _assembled:
        flight = SiteFlight(site, {}, **bus)
        atexit.register(flight.close)
        flight.play(SiteShow.start)
        _assembled[made_of] = flight
    return in_a_copy(partial(_assembled[made_of].play, story))


def fly_site(story: Story[T], site: Config, **bus: Any) -> T:
    """Play `story` with running stations, their vehicles on a grid; as `fly_on_pads`."""
    return fly_on_pads(story, site, {}, **bus)


def fly_on_pads(story: Story[T], site: Config, pads: Mapping[str, Any], **bus: Any) -> T:
    """Play `story` with running stations; an error of one that was not killed ends it.

    Args:
        story: the events of the flight, in virtual time.
        site: all stations.
        pads: of the fake fleets' settings: how the vehicles stand.
        bus: of `memory_bus.network`: delay_s, spread_s, loss, seed, tells_arrival.
    """
    with closing(SiteFlight(site, pads, **bus)) as flight:
        return flight.play(story)
