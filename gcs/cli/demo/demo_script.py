"""The demonstration flight, commanded through the REST API like any other flight."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import ceil

import numpy as np

from gcs.client import Client
from gcs.formation.orbit import orbit_velocity
from gcs.model.errors import CommandError, GcsError, RefusedError
from gcs.model.plan import Direction, Obstacle
from gcs.model.state import Array
from gcs.service import CommandRecord

ORBIT_SPEED_M_S = 2.5
TARGET_VELOCITY_M_S = (0.8, -0.4)
CONNECT_S = 60.0
READY_S = 30.0
SETTLE_S, TURN_S = 10.0, 20.0
"""Time after assembly, and after the obstacle was passed, until shape and orbit count as steady."""

SHORT_SETTLE_S = 5.0
"""The same time after assembly in a short flight."""

STEADY_S = 5.0
"""Least time of flight in formation."""

READY_FIRST_S, CLIMB_S = 6.0, 8.0
RISE_M_S, SINK_M_S = 2.0, 1.4
"""Vertical speeds of the vehicles with the longest way, up to the top of the sphere and down from it."""

TOUCH_DOWN_S = 12.0
"""Time from the end of a filtered descent until the motors stop, with a reserve for vehicles that waited."""

AWAY_SPEED_M_S = 1.2
"""Speed of the target after the obstacle; with the orbit's speed it stays below the centre's limit."""

AHEAD_S = 13.0
"""Time until a sphere of `USUAL_RADIUS_M` meets the obstacle on its path."""

USUAL_RADIUS_M = 15.0
"""Of the sphere in the shipped demonstration, and of its orbit. Larger spheres have larger orbits."""

NEAR_M = 20.0
"""Of an obstacle, for a formation that meets it."""

BESIDE_M = 12.0
"""From the farthest pad to the orbit."""

DEFAULT_S = 240.0


class StoppedEarlyError(GcsError):
    """Ctrl-C ended the script early; the fleet is home."""


@dataclass(slots=True)
class Marks:
    """Times of events on the monotonic clock, for the report. None: did not happen."""

    before: tuple[float, float] | None = None  # steady formation before the obstacle
    after: tuple[float, float] | None = None
    orbit: tuple[float, float] | None = None  # steady orbit
    obstacle: Obstacle | None = None
    obstacle_time_s: float | None = None
    target_from_m: tuple[float, float] | None = None
    target_to_m: tuple[float, float] | None = None


PLACES_TRIED, BETWEEN_PLACES_S = 40, 3.0
"""Where the orbit leads over pads no tower may stand: they fly on, in most of a turn past all of them."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Sizes and durations of the script for a fleet and its sphere."""

    vehicles: int
    stagger_s: float  # between two take-offs
    radius_m: float  # of the sphere
    top_m: float  # of the sphere, above the ground
    field_m: float = 0.0  # from the target to the farthest pad, where the orbit is to be around all pads

    @property
    def orbit_radius_m(self) -> float:
        """So large that the obstacle, which stands on the orbit, is off pads and outside the sphere."""
        around_m = self.field_m + BESIDE_M if self.field_m else 0.0
        return max(USUAL_RADIUS_M + 2.0 * self.beyond_m, around_m)

    @property
    def tower_height_m(self) -> float:
        """So high that none of them flies over it."""
        return max(45.0, ceil(self.top_m))

    @property
    def ahead_s(self) -> float:
        """Time until the formation, on its path, meets the obstacle."""
        return AHEAD_S + self.beyond_m / ORBIT_SPEED_M_S

    @property
    def beyond_m(self) -> float:
        """By how much the sphere is larger than the usual one."""
        return max(self.radius_m - USUAL_RADIUS_M, 0.0)

    @property
    def home_s(self) -> float:
        """Time until all have landed from the top of the sphere."""
        return self.top_m / SINK_M_S + TOUCH_DOWN_S

    @property
    def whole_s(self) -> float:
        """Shortest duration of the whole script."""
        wide_m = self.orbit_radius_m - USUAL_RADIUS_M
        passing_s = (2.0 * self.beyond_m + wide_m) / ORBIT_SPEED_M_S
        return ceil((115.0 + 1.5 * self.stagger_s * self.vehicles + passing_s + self.home_s) / 10.0) * 10.0

    @property
    def shortest_s(self) -> float:
        """Shortest duration of a flight without target and obstacle: up to the sphere, and home."""
        up_s = READY_FIRST_S + self.stagger_s * self.vehicles + CLIMB_S + self.top_m / RISE_M_S
        return ceil((up_s + SHORT_SETTLE_S + STEADY_S + self.home_s) / 10.0) * 10.0


class DemoScript:
    """Runs the demonstration; every step is an API call."""

    def __init__(self, client: Client, seconds: float, say: Callable[[str], None], scale: Scale) -> None:
        """With less time than `Scale.whole_s` no target moves and no obstacle appears."""
        self._scale, self._whole = scale, seconds >= scale.whole_s
        self._client = client
        self._say = say
        self._end_s = time.monotonic() + seconds
        self.marks = Marks()
        self._stopped = False

    def interrupt(self) -> None:
        """Bring the fleet home now. Safe to call from any thread."""
        self._stopped = True

    def fly(self) -> None:
        """Fly the script. Raises: CommandError when vehicles do not connect, start or land in time."""
        try:
            self._take_off()
            self._fly_over()
        finally:
            self._come_home()

    # parts of the script

    def _take_off(self) -> None:
        self._until("every vehicle ready", CONNECT_S, lambda: all(v.ready for v in self._client.vehicles()))
        command = self._start()
        self._say(f"start: {len(command.outcomes)} vehicles take off, one after the other, straight up")
        self._until(
            "take-off",
            READY_S + 2.0 * len(command.outcomes),
            lambda: self._phase() in {"assembling", "running"},
        )
        self._say("all up; they organise themselves in formation")
        self._until("assembly", 60.0, lambda: self._phase() == "running")
        self._say("assembled; the formation settles above the target")
        self._sleep(SETTLE_S if self._whole else SHORT_SETTLE_S)

    def _fly_over(self) -> None:
        """What is flown between take-off and return."""
        if self._whole:
            self._orbit()
            self._obstacle()
            self._stay()
        else:
            self._circle()

    def _start(self) -> CommandRecord:
        """Start as soon as preflight permits it. Raises: RefusedError with what is still wrong at the end."""
        end_s, reported = time.monotonic() + READY_S, ""
        while True:
            try:
                return self._client.start()
            except RefusedError as refused:
                if time.monotonic() > end_s:
                    raise
                if str(refused) != reported:
                    reported = str(refused)
                    self._say(f"not yet: {reported}")
            self._sleep(0.5)

    def _orbit(self) -> None:
        steady_s = time.monotonic()
        orbit_m = self._scale.orbit_radius_m
        self._client.change_orbit(radius_m=orbit_m, speed_m_s=ORBIT_SPEED_M_S)
        self._say(f"orbit: {orbit_m:g} m around the target at {ORBIT_SPEED_M_S:g} m/s")
        self._sleep(12.0 + (self._scale.orbit_radius_m - USUAL_RADIUS_M) / ORBIT_SPEED_M_S)
        self.marks.target_from_m = self._target_m()
        x, y = TARGET_VELOCITY_M_S
        self._client.set_target(*self.marks.target_from_m, velocity_x_m_s=x, velocity_y_m_s=y)
        self._say(f"the target moves off at ({x:g}, {y:g}) m/s; they follow")
        self._sleep(max(20.0, self._left_s() * 0.14))
        self.marks.before = (steady_s, time.monotonic() - 0.5)

    def _circle(self) -> None:
        steady_s = time.monotonic()
        self._client.change_orbit(radius_m=self._scale.orbit_radius_m, speed_m_s=ORBIT_SPEED_M_S)
        self._say(
            f"no time for target and tower; orbit at {ORBIT_SPEED_M_S:g} m/s until it is time to go home"
        )
        self._sleep(max(STEADY_S, self._left_s() - self._scale.home_s))
        self._need_running()
        self.marks.before = (steady_s, time.monotonic() - 0.5)

    def _obstacle(self) -> None:
        for _ in range(PLACES_TRIED):
            x_m, y_m = (round(each, 1) for each in self._ahead_m(self._scale.ahead_s))
            size = {"half_length_x_m": 3.0, "half_length_y_m": 3.0, "height_m": self._scale.tower_height_m}
            box = Obstacle("tower", x_m, y_m, **size)
            try:
                self._client.add_obstacle(x_m=x_m, y_m=y_m, **size, obstacle_id=box.id)
            except RefusedError as refused:
                self._say(f"not there: {refused}")
                self._sleep(BETWEEN_PLACES_S)
                continue
            self.marks.obstacle, self.marks.obstacle_time_s = box, time.monotonic()
            self._say(f"a tower of 6 x 6 x {box.height_m:g} m stands in their way at {x_m:g}, {y_m:g}")
            self._until("meeting the tower", 60.0, partial(self._is_near, box))
            self._until("passing the tower", 60.0 + 2.0 * self._scale.beyond_m, partial(self._clear_of, box))
            self._say("past the tower; the target turns away from it, and they re-form")
            self._move_target_away(box)
            self._sleep(TURN_S)
            return
        raise CommandError("no place for the obstacle was accepted")

    def _stay(self) -> None:
        steady_s = time.monotonic()
        self._sleep(max(20.0, self._left_s() - self._scale.home_s))
        self._need_running()
        self.marks.after = self.marks.orbit = (steady_s, time.monotonic() - 0.5)
        self.marks.target_to_m = self._target_m()

    def _come_home(self) -> None:
        self._stopped = False  # the return that Ctrl-C requested begins here
        if self._phase() in {"idle", "landed"}:
            return
        try:
            self._client.stop()
        except RefusedError as refused:
            self._say(f"stop: {refused}")
        self._say("return home, and land")
        self._until("landing", 180.0, lambda: self._phase() == "landed")
        self._say("landed")

    # helpers

    def _phase(self) -> str:
        return self._client.show().phase

    def _need_running(self) -> None:
        """Raises: CommandError when something has ended or paused the show: not all of it was flown."""
        show = self._client.show()
        if show.phase != "running":
            raise CommandError(f"the show did not last: it is {show.phase}: {show.reason}")

    def _target_m(self) -> tuple[float, float]:
        target = self._client.target()
        return target.x_m or 0.0, target.y_m or 0.0

    def _now_s(self) -> float:
        return time.monotonic()

    def _left_s(self) -> float:
        return self._end_s - time.monotonic()

    def _sleep(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self._check_stopped()
            time.sleep(0.1)

    def _until(self, what: str, seconds: float, reached: Callable[[], bool]) -> None:
        end_s = time.monotonic() + seconds
        while not reached():
            self._check_stopped()
            if time.monotonic() > end_s:
                raise CommandError(f"{what}: not within {seconds:g} s ({self._client.show().reason})")
            time.sleep(0.25)

    def _check_stopped(self) -> None:
        if self._stopped:
            raise StoppedEarlyError("stopped by hand")

    def _ahead_m(self, seconds: float) -> tuple[float, float]:
        """Predict the position of the formation's centre with the orbit law."""
        fleet = self._client.fleet()
        if fleet.center is None:
            raise CommandError("no formation flies")
        target = fleet.target
        center_m = np.array([fleet.center.x_m, fleet.center.y_m], dtype=np.float64)
        target_m = np.array([target.x_m, target.y_m], dtype=np.float64)
        target_m_s = np.array([target.velocity_x_m_s, target.velocity_y_m_s])
        step_s = 0.05
        for _ in range(round(seconds / step_s)):
            around_m_s = orbit_velocity(
                center_m - target_m,
                radius_m=fleet.orbit.radius_m,
                speed_m_s=fleet.orbit.speed_m_s,
                direction=Direction(fleet.orbit.direction),
                braking_m_s2=1.0,
            )
            center_m = center_m + step_s * (target_m_s + around_m_s)
            target_m = target_m + step_s * target_m_s
        return float(center_m[0]), float(center_m[1])

    def _move_target_away(self, box: Obstacle) -> None:
        """Move the target straight away from the box, so that nothing disturbs the rest of the orbit."""
        x_m, y_m = self._target_m()
        away_m = np.array([x_m - box.x_m, y_m - box.y_m])
        vx_m_s, vy_m_s = (AWAY_SPEED_M_S / max(float(np.hypot(*away_m)), 1.0) * away_m).tolist()
        self._client.set_target(x_m, y_m, velocity_x_m_s=vx_m_s, velocity_y_m_s=vy_m_s)

    def _is_near(self, box: Obstacle) -> bool:
        return bool((np.hypot(*self._offset_m(box).T) < NEAR_M).any())

    def _clear_of(self, box: Obstacle) -> bool:
        """Whether the formation has passed the box: all vehicles are beyond it, or away from it."""
        center = self._client.fleet().center
        if center is None or center.vx_m_s is None:
            return False
        offset_m, velocity = self._offset_m(box), np.array([center.vx_m_s, center.vy_m_s], dtype=np.float64)
        return bool((offset_m @ velocity > 0.0).all() or (np.hypot(*offset_m.T) > NEAR_M).all())

    def _offset_m(self, box: Obstacle) -> Array:
        """(n, 2) of the vehicles in formation, from the box."""
        places = [(v.x_m, v.y_m) for v in self._client.vehicles() if v.phase == "formation"]
        return np.array(places, dtype=np.float64).reshape(-1, 2) - (box.x_m, box.y_m)
