"""An operator at the REST API of a SITL flight: what chapters are made of, and the account of the flight."""

import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from gcs.api.schemas import fleet as schemas
from gcs.cli.demo.demo_report import Commanded
from gcs.client import Client
from gcs.model.errors import GcsError
from gcs.model.plan import Obstacle
from gcs.model.state import Array
from gcs.service import CommandRecord
from tests.sitl.sitl_service import Service, ServiceError
from tests.sitl.sitl_simulators import Simulators
from tests.sitl.sitl_truth import GroundTruthRecorder

SAMPLE_S = 0.2
"""Between two samples of what the service commands."""

TRUE_WITHIN_S = 1.0
"""After a stall the phase and the counts must be true within this time of continuing (issue 14)."""

LOSS_IS_SURE_S = 0.7
"""A stall this much longer than the loss time is a loss for every vehicle; a shorter one may be."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long what takes: a simulator on a busy machine is slower than the wall clock."""

    ready_s: float = 90.0
    up_s: float = 120.0
    formed_s: float = 90.0
    steady_s: float = 12.0
    orbit_s: float = 20.0
    home_s: float = 240.0


QUICK = Pace(ready_s=300.0, up_s=300.0, formed_s=300.0, home_s=600.0, steady_s=5.0, orbit_s=4.0)
"""Of tests, which other work may delay. ArduCopter swings round its place for some seconds."""


Place = tuple[float, float, float]
"""Show frame."""


@dataclass(frozen=True, slots=True)
class Window:
    """Times on the monotonic clock in which the shape of these vehicles is judged."""

    start_s: float
    end_s: float
    vehicles: frozenset[str]


@dataclass(frozen=True, slots=True)
class Stall:
    """What followed a stall of the station."""

    when: str
    seconds: float
    phase: str
    true_s: float | None  # None: the phase was never true, or is not known
    recovered_s: float | None


@dataclass(slots=True)
class Account:
    """What the flight did and saw; times on the monotonic clock."""

    steady: dict[str, Window] = field(default_factory=dict)
    obstacle: Obstacle | None = None
    obstacle_s: tuple[float, float] = (0.0, np.inf)
    lost: list[str] = field(default_factory=list)  # vehicles whose process was ended, and not started again
    stalls: list[Stall] = field(default_factory=list)
    recovered_after_restart_s: float | None = None
    refused: list[str] = field(default_factory=list)
    flown: list[str] = field(default_factory=list)  # chapters
    not_flown: dict[str, str] = field(default_factory=dict)  # chapters, with the reason
    failures: list[str] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)  # see Commanded
    reported: list[dict[str, Place]] = field(default_factory=list)  # by each vehicle, row by row
    autopilots: dict[str, str] = field(default_factory=dict)  # of each vehicle

    def commanded(self) -> Commanded | None:
        """What the service commanded, as arrays; None: no formation flew."""
        if not self.rows:
            return None
        table = np.array(self.rows, dtype=np.float64)
        return Commanded(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5:7])

    def reported_m(self, vehicle: str, window: "Window") -> Array:
        """(3,) mean of what a vehicle reported in that time, show frame; NaN: nothing."""
        reported_m = [
            known[vehicle]
            for row, known in zip(self.rows, self.reported, strict=True)
            if window.start_s <= row[0] <= window.end_s and vehicle in known
        ]
        return np.mean(reported_m, axis=0) if reported_m else np.full(3, np.nan)


def _place(vehicle: schemas.Vehicle) -> Place | None:
    if vehicle.x_m is None or vehicle.y_m is None or vehicle.height_m is None:
        return None
    return vehicle.x_m, vehicle.y_m, -vehicle.height_m


class SitlFlight:
    """An operator's commands and looks. They raise GcsError or ServiceError when a step fails."""

    def __init__(
        self,
        service: Service,
        simulators: Simulators,
        link: GroundTruthRecorder,
        *,
        lost: int,
        pace: Pace,
        say: Callable[[str], None],
    ) -> None:
        """`lost` is the index of the vehicle that can be killed; `say` prints progress."""
        self.service, self.simulators, self.link = service, simulators, link
        self.pace, self.say = pace, say
        self.ids = service.config.ids
        self.victim = self.ids[lost]
        self.account = Account()
        self.reason_before = ""  # of the show, before its start: it is shown until the start is executed

    @property
    def client(self) -> Client:
        """The REST client. Raises: ServiceError when the service does not run."""
        return self.service.client

    @property
    def alive(self) -> set[str]:
        """Vehicles whose process runs."""
        return set(self.ids) - set(self.account.lost)

    def index(self, vehicle: str) -> int:
        """Instance of a vehicle."""
        return self.ids.index(vehicle)

    def inject(self, fault: str, vehicle: str) -> None:
        """Let something go wrong in a vehicle. Raises: CannotError."""
        self.simulators.inject(fault, self.index(vehicle), self.link)
        self.say(f"{vehicle}: {fault}")

    # commands

    def accept(self, name: str, command: Callable[[], object]) -> None:
        """Send a command; note a refusal, which the verdict counts."""
        try:
            command()
        except GcsError as error:
            self.account.refused.append(f"{name}: {error}")
            raise

    def started(self) -> CommandRecord:
        """Start with every vehicle that lives, once all are ready; the refusal is the verdict."""
        self.until("every vehicle ready", self.pace.ready_s, self.all_ready)
        self.reason_before = self.client.show().reason
        try:
            command = self.client.start([name for name in self.ids if name in self.alive])
        except GcsError as error:
            self.account.refused.append(f"start: {error}")
            raise ServiceError(f"the start was refused: {error}") from error
        self.say(f"start: {len(command.outcomes)} vehicles")
        return command

    def come_home(self) -> None:
        """Everything home and down."""
        if self.client.show().phase not in {"idle", "landed"}:
            self.accept("stop", self.client.stop)
            self.say("return home and land")
            self.reach("landed", self.pace.home_s)
        self.until("motors off", self.pace.home_s, lambda: not self.armed())

    def settle(self, expected: Collection[str]) -> None:
        """Take control of what fell out, and let the show go on, as an operator does."""
        refused = ""

        def goes_on() -> bool:
            nonlocal refused
            fleet = self.client.fleet()
            phases = {each.id: each.phase for each in fleet.vehicles}
            formed = all(phases[name] == "formation" for name in expected)
            if formed and fleet.show.phase == "running":
                return True
            try:
                if fleet.show.phase == "uncontrolled" or any(phases[name] == "pilot" for name in expected):
                    self.client.take_over()
                elif fleet.show.phase == "paused" and formed:
                    self.client.resume()
            except GcsError as error:
                refused = str(error)
            return False

        seconds = self.pace.up_s + self.pace.formed_s
        self.until("the show goes on with every vehicle", seconds, goes_on, every_s=1.0, more=lambda: refused)

    def stall(self, when: str, seconds: float) -> None:
        """SIGSTOP of the service: every vehicle does what its autopilot does without setpoints.

        Some change their mode, and are taken over again. The others hover, and follow the next setpoint.
        """
        flying = self.flying()
        changing = {name for name, changes in self.service.config_alone().items() if changes} & flying
        loss_s = self.service.config.operation.setpoint_loss_s
        possible = [changing] if seconds > loss_s + LOSS_IS_SURE_S else [set(), changing]
        self.service.stop_for(seconds)
        continued_s = time.monotonic()
        self.say(f"the service was stopped for {seconds:g} s: {when}")
        phase = ""

        def is_true() -> bool:
            nonlocal phase
            fleet = self.client.fleet()
            phase = fleet.show.phase
            fallen = {each.id for each in fleet.vehicles if each.phase == "pilot"}
            return fallen in possible and (phase == "uncontrolled") == (bool(fallen) and fallen == flying)

        true_s = recovered_s = None
        try:
            self.until(f"a true phase after the stall ({when})", 20.0, is_true)
            true_s = time.monotonic() - continued_s
            self.settle(flying)
            recovered_s = time.monotonic() - continued_s
        finally:
            self.account.stalls.append(Stall(when, seconds, phase, true_s, recovered_s))

    # looks

    def flying(self) -> set[str]:
        """Vehicles in the formation."""
        return {each.id for each in self.client.vehicles() if each.phase == "formation"}

    def armed(self) -> set[str]:
        """Vehicles that live and report motors on."""
        return {each.id for each in self.client.vehicles() if each.armed} & self.alive

    def all_ready(self) -> bool:
        """Whether every vehicle that lives is ready."""
        return all(each.ready for each in self.client.vehicles() if each.id in self.alive)

    def radius_reached(self) -> bool:
        """Whether the sphere has its radius."""
        formation = self.client.formation()
        return abs((formation.radius_now_m or 0.0) - formation.radius_m) < 0.1

    def alarms(self, vehicle: str) -> list[str]:
        """Headlines of the alarms that name the vehicle."""
        found = self.client.alarms().alarms
        return [f"{each.id}: {each.text}" for each in found if vehicle in each.vehicles]

    def judge_steady(self, name: str) -> None:
        """Let the formation settle, and note a window in which its shape is judged."""
        time.sleep(self.pace.steady_s)
        begin_s, flying = time.monotonic(), self.flying()
        time.sleep(self.pace.steady_s)
        self.account.steady[name] = Window(begin_s, time.monotonic(), frozenset(flying))
        self.say(f"steady: {name}")

    def reach(self, phase: str, seconds: float) -> None:
        """Wait for a phase of the show."""
        self.until(f"show {phase}", seconds, lambda: self.client.show().phase == phase)

    def until(
        self,
        what: str,
        seconds: float,
        reached: Callable[[], bool],
        *,
        every_s: float = 0.1,
        more: Callable[[], str] = str,
    ) -> None:
        """Wait. Raises: ServiceError with the reasons of the show and its vehicles, and `more`."""
        end_s = time.monotonic() + seconds
        while not reached():
            if time.monotonic() > end_s:
                why = "; ".join(part for part in (self._state(), more()) if part)
                raise ServiceError(f"{what}: not within {seconds:g} s; {why}")
            time.sleep(every_s)

    def _state(self) -> str:
        """The show and its vehicles, in words, and what preflight says of those that are not ready."""
        fleet = self.client.fleet()
        words = [f"show {fleet.show.phase}: {fleet.show.reason}".rstrip(": ")]
        words += [
            f"{each.id} {each.phase}: {each.reason}".rstrip(": ")
            for each in fleet.vehicles
            if each.id in self.alive and each.phase != "formation" and not each.ready
        ]
        words += [self.simulators.ended()] if self.simulators.ended() and not self.account.lost else []
        return ", ".join(words)

    @contextmanager
    def followed(self) -> Iterator[None]:
        """Sample what the service commands, on a thread, until the block ends."""
        stopped = threading.Event()
        thread = threading.Thread(target=self._follow, args=(stopped,), name="commanded")
        thread.start()
        try:
            yield
        finally:
            stopped.set()
            thread.join()

    def _follow(self, stopped: threading.Event) -> None:
        """Over its own connection: a `Client` belongs to one thread. A service that is down is no error."""
        while not stopped.wait(SAMPLE_S):
            try:
                with Client(self.service.url, timeout_s=2.0) as client:
                    while not stopped.wait(SAMPLE_S):
                        self._sample(client.fleet())
            except GcsError:
                continue

    def _sample(self, fleet: schemas.Fleet) -> None:
        if fleet.center is None or fleet.formation.radius_now_m is None:
            return  # no formation flies
        at, radius_m = fleet.center, fleet.formation.radius_now_m
        center = (at.x_m or 0.0, at.y_m or 0.0, -(at.height_m or 0.0))
        target = (fleet.target.x_m or 0.0, fleet.target.y_m or 0.0)
        self.account.rows.append((fleet.time_s, *center, radius_m, *target))
        self.account.reported.append(
            {vehicle.id: place for vehicle in fleet.vehicles if (place := _place(vehicle))}
        )
        self.account.autopilots = {vehicle.id: vehicle.autopilot for vehicle in fleet.vehicles}
