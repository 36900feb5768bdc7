"""Flies a show in virtual time: the real orchestrator and link, the fake fleet, and a recorder."""

import asyncio
import atexit
import json
import re
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np

from gcs import control
from gcs.config.schema import Config
from gcs.flight.orchestrator import Heart, Orchestrator
from gcs.formation.obstacles import Ellipse
from gcs.links.autopilots import DEFAULT
from gcs.links.batch_link import Link
from gcs.mavlink import codec, reports
from gcs.model.errors import GcsError, LinkError
from gcs.model.lifecycle import Phase, ShowPhase
from gcs.model.state import Array, VehicleId
from gcs.planning.return_paths import planner
from gcs.preflight.parameters import settings_of
from gcs.recording.session import Record
from gcs.safety.floor import minimum_separation
from gcs.service import CommandRecord, FleetView, Outcome, ShowAction, VehicleAction
from gcs.sim.fleet import Fleet
from gcs.sim.mixed import fleet_of
from gcs.sim.protocol.autopilot import Autopilot
from gcs.sim.settings import Settings
from gcs.sim.vehicle.px4 import Mode as PilotMode
from gcs.sim.vehicle.px4 import Quirks
from gcs.testing.copies import in_a_copy
from gcs.testing.views import VehicleView, vehicles_of
from gcs.testing.virtual_link import STREAMS_HZ, VirtualLink
from gcs.testing.virtual_time import AtOnce, UnixClock, VirtualLoop

T = TypeVar("T")

HEADING_DEG = 30.0
TAKEOFF_HEIGHT_M = 5.0
RADIUS_M, HEIGHT_M = 6.0, 14.0
TARGET_M = (3.0, 1.0)
JUMP_M_S = 1.5
"""What two successive setpoints may differ by: 1.0 when the centre's acceleration reverses (0.5 s of lead),
0.375 of wanted change (3 m/s^2 for 0.05 s, 2.5 times through the inner loop), and noise.
"""
WRITER_S = 60.0
"""So long a record's writer is waited for, by the clock on the wall; then it counts what it does not keep."""
HOLDS_WHEN_LOST = {"setpoint_loss_action": "hold"}
"""Section `operation` of a show whose vehicles stay where they are when they lose the ground station."""

POSITIONING: Final = {"share": 0.25, "fix_3d_m": 0.2}
"""Section `positioning` for what the fake vehicles report, as in the shipped configurations."""

ORIGIN = {"latitude_deg": 47.397742, "longitude_deg": 8.545594, "altitude_amsl_m": 488.0}


def show_config(count: int, **sections: Mapping[str, Any] | list[Any]) -> Config:
    """A small show for `count` vehicles d1, d2 ...; `sections` are added to those of the same name."""
    raw: dict[str, Any] = {
        "show_frame": {**ORIGIN, "heading_deg": HEADING_DEG},
        "links": [{"name": "loop", "listen": "udpin://127.0.0.1:14540", "vehicles": {"count": count}}],
        "formation": {"radius_m": RADIUS_M, "height_m": HEIGHT_M},
        "target": {"x_m": TARGET_M[0], "y_m": TARGET_M[1]},
        "operation": {
            "takeoff_height_m": TAKEOFF_HEIGHT_M,
            "takeoff_stagger_s": 1.0,
            "setpoint_loss_action": "descend",  # PX4's default, whose consequences show soonest
            "require_safe_setpoint_loss": False,
        },
        "positioning": POSITIONING,
    }
    for name, section in sections.items():
        raw[name] = section if isinstance(section, list) else {**raw.get(name, {}), **section}
    return Config.model_validate(raw)


class FlownSample(NamedTuple):
    """One tick: the estimates of the service and the true state."""

    view: FleetView
    true_m: Array  # (n, 3) show frame
    armed: tuple[bool, ...]

    @property
    def time_s(self) -> float:
        """Time of the tick, in s."""
        return self.view.time_s


@dataclass(frozen=True, slots=True, eq=False)
class FlownTrack:
    """A part of a flight, tick by tick."""

    samples: tuple[FlownSample, ...]
    ids: tuple[VehicleId, ...]

    def between(self, begin_s: float, end_s: float = np.inf) -> "FlownTrack":
        """The ticks from `begin_s` to `end_s`."""
        inside = (sample for sample in self.samples if begin_s <= sample.time_s <= end_s)
        return FlownTrack(tuple(inside), self.ids)

    def of(self, vehicle_id: VehicleId) -> list[VehicleView]:
        """The service's view of one vehicle."""
        row = self.ids.index(vehicle_id)
        return [vehicles_of(sample.view)[row] for sample in self.samples]

    @property
    def time_s(self) -> Array:
        """(k,) times of all ticks, in s."""
        return np.array([sample.time_s for sample in self.samples])

    @property
    def true_m(self) -> Array:
        """(k, n, 3) true positions, show frame."""
        return np.array([sample.true_m for sample in self.samples])

    @property
    def setpoint_m_s(self) -> Array:
        """(k, n, 3) setpoints; NaN where none was sent."""
        nothing = (np.nan, np.nan, np.nan)
        return np.array(
            [[seen.setpoint_m_s or nothing for seen in vehicles_of(sample.view)] for sample in self.samples]
        )

    def phases(self, vehicle_id: VehicleId) -> list[Phase]:
        """One vehicle's phases, each change once."""
        seen = [view.phase for view in self.of(vehicle_id)]
        return [phase for at, phase in enumerate(seen) if at == 0 or phase is not seen[at - 1]]

    def show_phases(self) -> list[ShowPhase]:
        """The show's phases, each change once."""
        seen = [sample.view.show for sample in self.samples]
        return [phase for at, phase in enumerate(seen) if at == 0 or phase is not seen[at - 1]]

    def since(self, vehicle_id: VehicleId, phase: Phase) -> float:
        """When the vehicle was first in `phase`."""
        row = self.ids.index(vehicle_id)
        return next(sample.time_s for sample in self.samples if vehicles_of(sample.view)[row].phase is phase)

    def hardest_change_m_s(self) -> float:
        """The largest step between two setpoints of one vehicle in successive ticks."""
        steps = np.linalg.norm(np.diff(self.setpoint_m_s, axis=0), axis=2)
        return float(np.nanmax(steps))

    def setpoints_per_s(self, vehicle_id: VehicleId) -> float:
        """Setpoints of the vehicle per second."""
        commanded = sum(seen.setpoint_m_s is not None for seen in self.of(vehicle_id))
        period_s = float(self.time_s[-1] - self.time_s[0]) / (len(self.samples) - 1)
        return commanded / (len(self.samples) * period_s)


LAW_WAIT_S = 0.3
"""How long a tick waits for a law of another package, in true time."""


class VirtualShow:
    """A running service and its fake fleet, as a story gets them."""

    def __init__(
        self,
        config: Config,
        fleet: Fleet,
        link: VirtualLink,
        service: Orchestrator,
        unix: UnixClock,
        planning: AtOnce,
    ) -> None:
        self.config = config
        self.unix = unix
        self.planning = planning
        self.fleet = fleet
        self.link = link
        self.ports = link.ports
        self.service = service
        self.refusals: list[str] = []
        self._moments: list[FlownSample] = []

    @property
    def now_s(self) -> float:
        """The loop's time."""
        return asyncio.get_running_loop().time()

    @property
    def view(self) -> FleetView:
        """Newest state."""
        return self.service.view.value

    @property
    def track(self) -> FlownTrack:
        """All ticks so far."""
        return FlownTrack(tuple(self._moments), self.config.ids)

    @property
    def true_m(self) -> Array:
        """(n, 3) true positions now, show frame."""
        return self.service.frame.from_ned(self.fleet.position_m)

    def vehicle(self, vehicle_id: VehicleId) -> VehicleView:
        """The service's view of one vehicle."""
        return vehicles_of(self.view)[self.config.ids.index(vehicle_id)]

    def autopilot(self, vehicle_id: VehicleId) -> Autopilot:
        """The fake autopilot of a vehicle."""
        autopilot = self.fleet.autopilots[self.config.ids.index(vehicle_id)]
        assert isinstance(autopilot, Autopilot)
        return autopilot

    def pilot(self, vehicle_id: VehicleId, mode: PilotMode) -> None:
        """Change the mode by the vehicle's remote control, which uses no link."""
        self.autopilot(vehicle_id).change_mode(mode)

    def befall(self, vehicle_id: VehicleId, fault: str, **values: float | str) -> None:
        """Give a vehicle a fault, as a command to `gcs sim --control` does."""
        command = {"vehicle": self.config.ids.index(vehicle_id) + 1, "fault": fault, **values}
        answer = json.loads(self.ports.fault_injector.obey(json.dumps(command)))
        if not answer["ok"] or "unmoved" in answer:
            raise ValueError(f"{command}: {answer}")

    async def record(self, onto: Record | None = None) -> None:
        """Note every tick until cancelled; no time passes while the writer of `onto` is behind."""
        async for view in self.service.view.values():
            wait_for_writer(onto)
            armed = tuple(pilot.commander.armed for pilot in self.fleet.autopilots)
            self._moments.append(FlownSample(view, self.true_m, armed))

    async def wait(self, seconds: float) -> None:
        """Let time pass."""
        await asyncio.sleep(seconds)

    async def until(self, holds: Callable[[], bool], limit_s: float = 60.0) -> float:
        """Wait for a tick at which `holds`. Returns: the duration in s. Raises: TimeoutError with details."""
        began_s = self.now_s
        async for _ in self.service.view.values():
            if holds():
                break
            if self.now_s - began_s > limit_s:
                states = ", ".join(
                    f"{seen.id} {seen.phase} ({seen.reason})" for seen in vehicles_of(self.view)
                )
                raise TimeoutError(f"not within {limit_s} s: show {self.view.show}; {states}")
        return self.now_s - began_s

    async def reach(self, phase: ShowPhase, limit_s: float = 60.0) -> float:
        """Wait for a phase of the show."""
        return await self.until(lambda: self.view.show is phase, limit_s)

    async def phase(self, vehicle_id: VehicleId, phase: Phase, limit_s: float = 60.0) -> float:
        """Wait for a phase of a vehicle."""
        return await self.until(lambda: self.vehicle(vehicle_id).phase is phase, limit_s)

    async def settled(self, record: CommandRecord, limit_s: float = 90.0) -> CommandRecord:
        """Wait until no part of a command is pending."""
        await self.until(
            lambda: self.service.command_log.get(record.id).outcome is not Outcome.PENDING, limit_s
        )
        return self.service.command_log.get(record.id)

    async def standby(self) -> None:
        """Wait until every vehicle that is not cut off can be armed."""
        await self.until(
            lambda: all(seen.ready or self.ports.is_silent(seen.id) for seen in vehicles_of(self.view)), 12.0
        )

    async def start(self) -> CommandRecord:
        """Boot, start with all that are not cut off, and wait until the sphere is stable."""
        await self.standby()
        online = [name for name in self.config.ids if not self.ports.is_silent(name)]
        names = None if len(online) == len(self.config.ids) else online
        record = self.service.commands.command_show(ShowAction.START, names)
        await self.reach(ShowPhase.RUNNING)
        return record

    async def show(self, action: ShowAction) -> CommandRecord:
        """Send a show command and wait until it is carried out."""
        return await self.settled(self.service.commands.command_show(action))

    async def command(self, vehicle_id: VehicleId, action: VehicleAction) -> CommandRecord:
        """Command one vehicle and wait until it has done it."""
        return await self.settled(self.service.commands.command_vehicle(vehicle_id, action))

    def floor_violations(self, track: FlownTrack | None = None) -> int:
        """Ticks with a true pair distance inside the floor; pairs low over their pads do not count."""
        floor, all_vehicles = self.config.control.safety.floor, np.ones(len(self.config.ids), dtype=np.bool_)
        true_m = (self.track if track is None else track).true_m
        return sum(minimum_separation(here_m, all_vehicles, floor)[1] > 0 for here_m in true_m)

    def ellipse(self, obstacle_id: str) -> Ellipse:
        """An obstacle of the plan, without the law's margins."""
        box = next(known for known in self.view.plan.obstacles if known.id == obstacle_id)
        return Ellipse.around(box, margin_m=0.0, headroom_m=0.0)


def wait_for_writer(record: Record | None) -> None:
    """Let the writer catch up: it expects 50 ms for each tick, and virtual ticks follow faster."""
    end_s = time.monotonic() + WRITER_S
    while record is not None and not record.has_room and time.monotonic() < end_s:
        time.sleep(0.01)  # the whole loop waits, and with it virtual time


def alarm_texts(show: VirtualShow) -> list[str]:
    """The text of every present alarm."""
    return [alarm.text for alarm in show.view.alarms]


BADLY_WRITTEN: Final = re.compile(r"[.,;:][,;]|[,;:]\.(?!\.)|(?<!\.)\.\.(?!\.)|\s[.,;](\s|$)|  |\bNone\b|\('")
"""Two marks where there should be one, a space before a mark or two of them, Python."""


def badly_written(show: VirtualShow) -> list[str]:
    """Texts of a flight that are badly written for an operator."""
    texts = set(show.refusals)
    for view in (sample.view for sample in show.track.samples[::10]):
        texts.update(text for alarm in view.alarms for text in (alarm.text, alarm.advice))
        texts.update(vehicle.reason for vehicle in vehicles_of(view))
        texts.add(view.reason)
    for command in show.service.command_log.newest():
        texts.update(outcome.reason for outcome in command.outcomes.values())
    return sorted(text for text in texts if BADLY_WRITTEN.search(text))


class RefusedCall(NamedTuple):
    """The refusal of a request and the changes that it made, which should be none."""

    kind: type[GcsError]
    text: str
    plan_kept: bool


async def refused(show: VirtualShow, request: Callable[[], object]) -> RefusedCall:
    """Make a request that must be refused, and compare the plan before and after."""
    await show.wait(2.0 / show.config.tick_rate_hz)
    before = show.view
    try:
        request()
    except GcsError as error:
        await show.wait(2.0 / show.config.tick_rate_hz)
        kept = show.view.plan == before.plan and show.view.show is before.show
        show.refusals.append(str(error))
        return RefusedCall(type(error), str(error), kept)
    raise AssertionError("it was accepted")


Story = Callable[[VirtualShow], Awaitable[T]]
READY_AT_ONCE: Final = Quirks(late_ready=False)
"""Habits of the fake vehicles: all of PX4's but the 4 to 6 s after booting, in which nothing happens."""
SOON_DISARMED: Final = {"COM_DISARM_LAND": 0.5, "LNDMC_TRIG_TIME": 0.25}
"""Parameters of the fake vehicles: 1.3 s pass from touching the ground to disarming, with PX4's own 5 s."""
SLOWLY_DISARMED: Final = {"COM_DISARM_LAND": 2.0, "LNDMC_TRIG_TIME": 1.0}
"""PX4's own."""
FLEET_STEP_S: Final = 1.0 / 60.0  # three steps a tick, as the simulation takes
TICK_STEP_S: Final = 1.0 / 20.0
"""One step a tick, for vehicles with PX4: a fifth less time. Their bodies take steps of 0.0167 s."""
BEFORE_TICK_S: Final = 0.005
"""The steps come so long before the ticks: telemetry is new then, and a setpoint acts in the next step."""


def begin_of(now_s: float, unix_s: float, step_s: float = TICK_STEP_S) -> dict[str, float]:
    """Settings of time for a fake fleet. With one step a tick it steps a little before each tick."""
    before_s = BEFORE_TICK_S if step_s == TICK_STEP_S else 0.0
    return {"start_s": now_s - before_s, "unix_at_start_s": unix_s - before_s, "step_s": step_s}


class VirtualFlight:
    """A running service over its fake fleet, for one story after another. See `fly`."""

    def __init__(
        self,
        plan: Config,
        failures: Sequence[LinkError] = (),
        record: Record | None = None,
        heart: Heart | None = None,
        step_s: float | None = None,
        **fleet_settings: Any,
    ) -> None:
        proper = settings_of(plan, str(fleet_settings.get("version", "")))
        kinds = list(dict.fromkeys(str(vehicle.autopilot) for vehicle in plan.fleet))
        autopilot = kinds[0] if len(kinds) == 1 else "mixed"  # in turn
        self._step_s = step_s or (TICK_STEP_S if kinds == [DEFAULT.name] else FLEET_STEP_S)
        soon = SOON_DISARMED if DEFAULT.name in kinds else {}
        usual = {"grid_columns": 2, "rates_hz": STREAMS_HZ, "together": True, "quirks": READY_AT_ONCE}
        self._settings = {"count": len(plan.ids), "autopilot": autopilot, **usual, **fleet_settings}
        self._settings["parameters"] = {**soon, **proper, **fleet_settings.get("parameters", {})}
        self._loop = VirtualLoop()
        self._show, self._services = self._loop.play(self._begin(plan, failures, record, heart))

    def play(self, story: Story[T]) -> T:
        """Play the next story."""
        return self._loop.play(self._play(story))

    def close(self) -> None:
        """Cancel everything that runs."""
        self._loop.close()

    async def _begin(
        self,
        plan: Config,
        failures: Sequence[LinkError],
        record: Record | None,
        heart: Heart | None,
    ) -> tuple[VirtualShow, set[asyncio.Task[None]]]:
        unix, planning, now_s = UnixClock(), AtOnce(), asyncio.get_running_loop().time()
        settings = Settings(**self._settings)
        made = fleet_of(settings, **begin_of(now_s, unix(), self._step_s))
        fleet = cast("Fleet", made)  # a mixed one has what stories of mixed fleets use
        link = VirtualLink(plan, fleet)
        for failure in failures:
            link.failures.put_nowait(failure)
        links: list[Link] = [link]
        orchestrator = Orchestrator(
            plan, links, record, unix_s=unix, heart=heart, planning=planning, law_wait_s=LAW_WAIT_S
        )
        show = VirtualShow(plan, fleet, link, orchestrator, unix, planning)
        services = {
            asyncio.create_task(show.service.run(), name="service"),
            asyncio.create_task(show.record(record), name="record"),
        }
        await show.wait(0.0)
        return show, services

    async def _play(self, story: Story[T]) -> T:
        reported = asyncio.ensure_future(story(self._show))
        ended, _ = await asyncio.wait({*self._services, reported}, return_when=asyncio.FIRST_COMPLETED)
        for service in ended & self._services:
            await service  # raises what ended it
        result = await reported
        wrong = badly_written(self._show)
        assert not wrong, wrong
        return result


@cache
def load_machine_code() -> None:
    """Otherwise each copy of the process loads it."""
    for warm_up in (control.warm_up, planner.warm_up, codec.warm_up, reports.warm_up):
        warm_up()


_led_so_far: dict[str, VirtualFlight] = {}
"""Flights that stand still where they were led to, by what made them."""


def fly(
    story: Story[T],
    config: Config | None = None,
    *,
    after: Story[None] | None = None,
    failures: Sequence[LinkError] = (),
    record: Record | None = None,
    heart: Heart | None = None,
    **fleet_settings: Any,
) -> T:
    """Play `story` with a running service; an error of control ends it.

    Args:
        story: the events of the flight, in virtual time.
        config: None: four vehicles.
        after: leads the flight to where the story begins. This part is flown once for all stories of the same
            settings. Each continues it in a copy of the process, from which only the result comes back.
        failures: of the link, set before it first runs.
        record: the recording of the flight, already entered.
        heart: receives the heartbeats of control.
        fleet_settings: of `sim.fleet.Settings`, and `step_s` of the fleet; `parameters` are added to those
            that the configuration asks for.
    """
    plan = show_config(4) if config is None else config
    if after is not None:
        assert (failures, record, heart) == ((), None, None), "they belong to one story"
        made_of = f"{after.__module__}.{after.__qualname__} {plan.model_dump_json()} {fleet_settings}"
        if made_of not in _led_so_far:
            load_machine_code()
            flight = VirtualFlight(plan, **fleet_settings)
            atexit.register(flight.close)
            flight.play(after)
            _led_so_far[made_of] = flight
        return in_a_copy(partial(_led_so_far[made_of].play, story))
    with closing(VirtualFlight(plan, failures, record, heart, **fleet_settings)) as flight:
        return flight.play(story)
