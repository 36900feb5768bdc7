"""The flight that every SITL run flies: an operator's commands, and what goes wrong in between."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from gcs.api.schemas import fleet as schemas
from gcs.cli.demo_report import Commanded
from gcs.client import Client
from gcs.model.errors import GcsError, RefusedError
from gcs.model.plan import Obstacle
from gcs.service import CommandRecord
from tests.sitl.sitl_service import Service, ServiceError
from tests.sitl.sitl_simulators import Simulators

SAMPLE_S = 0.2
"""Between two samples of what the service commands."""

STALL_S = 4.0
TRUE_WITHIN_S = 1.0
"""After a stall the phase and the counts must be true within this time of continuing (issue 14)."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How long what takes: a simulator on a busy machine is slower than the wall clock."""

    ready_s: float = 90.0
    up_s: float = 120.0
    formed_s: float = 90.0
    steady_s: float = 12.0
    orbit_s: float = 20.0
    home_s: float = 240.0


QUICK = Pace(steady_s=5.0, orbit_s=4.0)
"""ArduCopter swings round its place for some seconds."""


@dataclass(slots=True)
class Account:
    """What the flight did and saw; times on the monotonic clock."""

    steady: dict[str, tuple[float, float]] = field(
        default_factory=dict
    )  # windows in which the shape is judged
    obstacle: Obstacle | None = None
    obstacle_from_s: float = 0.0
    lost: list[str] = field(default_factory=list)
    phase_after_stall: str = ""
    true_after_stall_s: float | None = None  # None: the phase was never true
    recovered_after_stall_s: float | None = None
    recovered_after_restart_s: float | None = None
    refused: list[str] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)  # see Commanded

    def commanded(self) -> Commanded:
        """What the service commanded, as arrays."""
        table = np.array(self.rows, dtype=np.float64)
        return Commanded(table[:, 0], table[:, 1:4], table[:, 4], table[:, 5:7])


class SitlFlight:
    """Flies the whole story through the REST API. Raises: GcsError or ServiceError when a step fails."""

    def __init__(
        self,
        service: Service,
        simulators: Simulators,
        *,
        lost: int,
        pace: Pace,
        say: Callable[[str], None],
    ) -> None:
        """`lost` is the index of the vehicle that is killed on the way; `say` prints progress."""
        self._service, self._simulators = service, simulators
        self._lost, self._pace, self._say = lost, pace, say
        self.account = Account()

    @property
    def _client(self) -> Client:
        if self._service.client is None:
            raise ServiceError("gcs serve was not started")
        return self._service.client

    def fly(self) -> None:
        """Everything, in order; comes home also when a step fails."""
        with self._followed():
            try:
                self._assemble()
                self._change_radius()
                self._follow_target()
                self._pass_obstacle()
                self._pause()
                self._lose_vehicle()
                self._stall()
                self._restart()
            finally:
                self._come_home()

    # the steps

    def _assemble(self) -> None:
        self._until("every vehicle ready", self._pace.ready_s, self._all_ready)
        command = self._client.start()
        self._say(f"start: {len(command.outcomes)} vehicles")
        self._reach("running", self._pace.up_s + self._pace.formed_s)
        self._judge_steady("assembled")

    def _change_radius(self) -> None:
        radius_m = 2.0 / 3.0 * self._client.formation().radius_m
        self._client.change_formation(radius_m=radius_m)
        self._say(f"radius {radius_m:g} m")
        self._until("the new radius", self._pace.formed_s, self._radius_reached)
        self._judge_steady("radius")

    def _follow_target(self) -> None:
        self._client.change_orbit(radius_m=12.0, speed_m_s=2.0)
        target = self._client.target()
        self._client.set_target(target.x_m or 0.0, target.y_m or 0.0, velocity_x_m_s=0.5, velocity_y_m_s=-0.3)
        self._say("orbit of 12 m around a target that moves at 0.6 m/s")
        time.sleep(self._pace.orbit_s)

    def _pass_obstacle(self) -> None:
        center = self._client.fleet().center
        if center is None or center.vx_m_s is None:
            raise ServiceError("no formation flies")
        course = np.array([center.vx_m_s, center.vy_m_s], dtype=np.float64)
        course /= max(float(np.linalg.norm(course)), 1e-3)
        here_m = np.array([center.x_m, center.y_m], dtype=np.float64)
        for ahead_m in (28.0, 32.0, 36.0, 40.0):
            x_m, y_m = (here_m + ahead_m * course).round(1).tolist()
            box = Obstacle("mast", x_m, y_m, 1.5, 1.5, 45.0)
            try:
                self._client.add_obstacle(
                    x_m=x_m,
                    y_m=y_m,
                    half_length_x_m=box.half_length_x_m,
                    half_length_y_m=box.half_length_y_m,
                    height_m=box.height_m,
                    obstacle_id=box.id,
                )
            except RefusedError as refusal:
                self._say(f"obstacle: {refusal}")
                continue
            self.account.obstacle, self.account.obstacle_from_s = box, time.monotonic()
            self._say(f"a mast stands at ({x_m:g}, {y_m:g}) m")
            time.sleep(self._pace.orbit_s)
            return
        raise ServiceError("no place for the obstacle was accepted")

    def _pause(self) -> None:
        self._client.pause()
        self._reach("paused", 10.0)
        time.sleep(3.0)
        self._client.resume()
        self._reach("running", self._pace.formed_s)
        self._say("paused and resumed")

    def _lose_vehicle(self) -> None:
        name = self._client.fleet().vehicles[self._lost].id
        self._client.change_orbit(radius_m=0.0)
        self._simulators.kill(self._lost)
        self.account.lost.append(name)
        self._say(f"{name}: SIGKILL")
        self._until(f"{name} lost", 20.0, lambda: self._client.vehicle(name).phase == "lost")
        self._reach("running", self._pace.formed_s)
        time.sleep(self._pace.steady_s)  # the formation closes the gap
        self._judge_steady("after_loss")

    def _stall(self) -> None:
        """SIGSTOP of the service: every vehicle does what its autopilot does without setpoints.

        Some change their mode, and are taken over again. The others hover, and follow the next setpoint.
        """
        flying = self._flying()
        fallen = {name for name, changes in self._service.config_alone().items() if changes} & flying
        self._service.stop_for(STALL_S)
        continued_s = time.monotonic()
        self._say(f"the service was stopped for {STALL_S:g} s")

        def is_true() -> bool:
            fleet = self._client.fleet()
            self.account.phase_after_stall = fleet.show.phase
            phase_is_true = fleet.show.phase == "uncontrolled" or fallen != flying
            return phase_is_true and {each.id for each in fleet.vehicles if each.phase == "pilot"} == fallen

        self._until("a true phase after the stall", 20.0, is_true)
        self.account.true_after_stall_s = time.monotonic() - continued_s
        if not fallen:
            self._until("the same fleet under control", 10.0, lambda: self._formed() == flying)
            self.account.recovered_after_stall_s = time.monotonic() - continued_s
            self._reach("running", self._pace.formed_s)
            return
        self._accept("take-over", self._client.take_over)
        self._until("control of the whole fleet", self._pace.formed_s, lambda: self._formed() == flying)
        self.account.recovered_after_stall_s = time.monotonic() - continued_s
        if fallen == flying:  # else the show went on with the others
            self._accept("resume", self._client.resume)
        self._reach("running", self._pace.formed_s)

    def _restart(self) -> None:
        """SIGKILL of the service, and a new one that finds the fleet in the air."""
        flying = self._flying()
        self._service.kill()
        killed_s = time.monotonic()
        self._service.start()
        self._say("the service was killed and started again")
        self._until("telemetry of the interrupted flight", 60.0, lambda: flying <= self._waiting())
        self._accept("take-over", self._client.take_over)
        self._until("control of the whole fleet", self._pace.formed_s, lambda: self._formed() == flying)
        self.account.recovered_after_restart_s = time.monotonic() - killed_s

    def _come_home(self) -> None:
        if self._client.show().phase in {"idle", "landed"}:
            return
        self._accept("stop", self._client.stop)
        self._say("come home and land")
        self._reach("landed", self._pace.home_s)

    # their parts

    def _flying(self) -> set[str]:
        return {each.id for each in self._client.vehicles() if each.phase == "formation"}

    _formed = _flying

    def _waiting(self) -> set[str]:
        """Vehicles of an interrupted flight that wait for take-over, where it is offered."""
        found = self._client.interrupted()
        if found is None or "take-over" not in found.offers:
            return set()
        return {name for name, vehicle in found.vehicles.items() if vehicle.waits}

    def _all_ready(self) -> bool:
        return all(each.ready for each in self._client.vehicles())

    def _radius_reached(self) -> bool:
        formation = self._client.formation()
        return abs((formation.radius_now_m or 0.0) - formation.radius_m) < 0.1

    def _judge_steady(self, name: str) -> None:
        time.sleep(self._pace.steady_s)
        begin_s = time.monotonic()
        time.sleep(self._pace.steady_s)
        self.account.steady[name] = (begin_s, time.monotonic())
        self._say(f"steady: {name}")

    def _accept(self, name: str, command: Callable[[], CommandRecord]) -> None:
        """Send a command; note a refusal, which the verdict counts."""
        try:
            command()
        except GcsError as error:
            self.account.refused.append(f"{name}: {error}")
            raise

    def _reach(self, phase: str, seconds: float) -> None:
        self._until(f"show {phase}", seconds, lambda: self._client.show().phase == phase)

    def _until(self, what: str, seconds: float, reached: Callable[[], bool]) -> None:
        end_s = time.monotonic() + seconds
        while not reached():
            if time.monotonic() > end_s:
                show = self._client.show()
                raise ServiceError(f"{what}: not within {seconds:g} s; show {show.phase}: {show.reason}")
            time.sleep(0.1)

    @contextmanager
    def _followed(self) -> Iterator[None]:
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
                with Client(self._service.url, timeout_s=2.0) as client:
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
