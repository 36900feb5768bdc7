"""The centre's plan past obstacles: searches spread over ticks, climbing, splitting, standing."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Tasks, detour, tick
from gcs.control.memory import Detour
from gcs.control.scene import ALOFT_M
from gcs.formation.route import Boxes, Goal, Route, find_route
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target
from gcs.model.state import Array, FleetState, Traits
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence

TICK_S, RADIUS_M, HEIGHT_M = 0.05, 8.0, 20.0
OFFSETS_M = RADIUS_M * np.array(
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
)


@dataclass
class Run:
    """A formation of vehicles that fly exactly as commanded."""

    obstacles: tuple[Obstacle, ...]
    height_max_m: float = 200.0
    target: Target = field(default_factory=lambda: Target(90.0, 3.0))
    orbit: Orbit = field(default_factory=lambda: Orbit(0.0, 2.0))

    def __post_init__(self) -> None:
        self.place_m = OFFSETS_M - np.array([0.0, 0.0, HEIGHT_M])
        self.velocity_m_s = np.zeros_like(self.place_m)
        count = len(self.place_m)
        self.tasks, self.traits = Tasks.of_formation(count, center_moves=True), Traits.alike(count)
        self.memory = Memory.fresh(count, 0.0)
        self.plan = Plan(
            Formation(RADIUS_M, HEIGHT_M), self.orbit, target=self.target, obstacles=self.obstacles
        )
        fence = Fence(height_max_m=self.height_max_m, distance_max_m=150.0)
        self.settings = ControlSettings(safety=SafetySettings(fence=fence))

    def fly(self, seconds: float) -> Detour:
        for _ in range(round(seconds / TICK_S)):
            nothing, ids = np.zeros(len(self.place_m)), tuple("abcdef")
            now_s = self.memory.time_s + TICK_S
            fleet = FleetState(now_s, ids, self.place_m.copy(), self.velocity_m_s.copy(), nothing, nothing)
            done = tick(fleet, self.tasks, self.plan, self.traits, self.memory, self.settings)
            self.memory, self.velocity_m_s = done.memory, np.array(done.memory.desired_m_s)
            self.place_m = self.place_m + TICK_S * self.velocity_m_s
        assert self.memory.detour is not None
        return self.memory.detour

    @property
    def center_m(self) -> Array:
        assert self.memory.center is not None
        return self.memory.center.position_m


def ring(height_m: float) -> tuple[Obstacle, ...]:
    sides = ((30.0, 0.0, 3.0, 33.0), (-30.0, 0.0, 3.0, 33.0), (0.0, 30.0, 33.0, 3.0), (0.0, -30.0, 33.0, 3.0))
    return tuple(Obstacle(f"wall {k}", *side, height_m) for k, side in enumerate(sides))


def row(spacing_m: float, half_m: float) -> tuple[Obstacle, ...]:
    return tuple(
        Obstacle(f"b{k}", 45.0, k * spacing_m, 2.0, half_m, 300.0)
        for k in np.arange(-150.0 / spacing_m, 150.0 / spacing_m + 1.0)
    )


@pytest.mark.parametrize("orbit", [Orbit(0.0, 2.0), Orbit(60.0, 2.0)])
def test_no_tick_makes_more_than_one_search(monkeypatch: pytest.MonkeyPatch, orbit: Orbit) -> None:
    searches: list[int] = []

    def counted(boxes: Boxes, center_m: Array, goal: Goal, speed_m_s: float, reach_m: float) -> Route:
        searches[-1] += 1
        return find_route(boxes, center_m, goal, speed_m_s, reach_m)

    monkeypatch.setattr(detour, "find_route", counted)
    low = tuple(Obstacle(f"low {k}", 60.0 + 8.0 * k, -60.0, 2.0, 2.0, 15.0 + k, 0.0, 0.5) for k in range(6))
    run = Run((*ring(300.0), *low), orbit=orbit)
    for _ in range(100):
        searches.append(0)
        run.fly(TICK_S)
    assert max(searches) == 1
    assert 5 * 3 < sum(searches) < 100  # a plan every half second, of several searches


def test_closed_ring_is_stood_in_and_named() -> None:
    run = Run(ring(300.0))
    plan = run.fly(10.0)
    assert (plan.active, plan.reaches) == (True, False)
    assert plan.held_by == "wall 0"
    assert np.hypot(*run.center_m[:2]) < 30.0 - 3.0 - RADIUS_M
    before_m = run.center_m.copy()
    run.fly(2.0)
    assert run.center_m == pytest.approx(before_m, abs=0.05)


def test_low_ring_is_climbed_over_only_inside_the_fence() -> None:
    over = Run(ring(18.0)).fly(2.0)
    assert over.reaches
    assert over.height_m == pytest.approx(18.0 + 3.0 + RADIUS_M + ALOFT_M)  # with the headroom
    assert Run(ring(18.0), height_max_m=35.0).fly(2.0).height_m is None


def test_pillars_are_passed_with_a_part_of_the_sphere() -> None:
    plan = Run(row(spacing_m=25.0, half_m=2.0)).fly(2.0)
    assert plan.reaches
    assert plan.clear < 1.0


def test_gap_that_ellipses_close_is_not_flown_through() -> None:
    run = Run(row(spacing_m=80.0, half_m=32.0))  # gaps of 16 m
    plan = run.fly(8.0)
    assert plan.held_by
    assert plan.goal.held_by == plan.held_by  # no way leads to the target: it goes to a place before the row
    assert plan.goal.place_m[0] < 45.0 - 2.0 - RADIUS_M
    run.fly(20.0)
    before_m = run.center_m.copy()
    assert before_m[0] < 45.0 - 2.0 - RADIUS_M
    run.fly(2.0)
    assert run.center_m == pytest.approx(before_m, abs=0.05)


def test_removed_obstacle_ends_its_detour_at_once() -> None:
    run = Run((Obstacle("mast", 45.0, 3.0, 2.0, 2.0, 300.0),))
    assert run.fly(1.0).active
    run.plan = Plan(run.plan.formation, run.orbit, target=run.target, obstacles=ring(5.0)[:1])
    assert not run.fly(TICK_S).active


@pytest.mark.soak
@pytest.mark.long
def test_formation_leaves_before_boxes_meet_and_returns() -> None:
    drive = (("west", -40.0, 1.0), ("east", 40.0, -1.0))
    boxes = tuple(Obstacle(name, x_m, 0.0, 4.0, 15.0, 300.0, speed, 0.0) for name, x_m, speed in drive)
    run = Run(boxes, target=Target(0.0, 0.0))
    run.fly(38.0)  # they meet after 36 s
    for box in boxes:
        beside_m = np.abs(run.place_m[:, :2] - box.position_m(38.0)) - (4.0, 15.0)
        assert (beside_m.max(axis=1) > 1.0).all()
    run.fly(60.0)
    assert np.hypot(*run.center_m[:2]) < 1.0


def test_target_that_moves_through_a_mast_is_followed_round_it() -> None:
    """The centre once waited at the moving target, and so followed it into the mast; then it climbed over."""
    mast = Obstacle("mast", 40.0, 0.0, 1.5, 1.5, 30.0)
    run = Run((mast,), target=Target(0.0, 0.0, 1.5, 0.3, 0.0))
    nearest_m, highest_m = np.inf, 0.0
    for _ in range(60):
        run.fly(1.0)
        nearest_m = min(nearest_m, float(np.hypot(*(run.center_m[:2] - (40.0, 0.0)))))
        highest_m = max(highest_m, float(-run.center_m[2]))
    assert nearest_m > RADIUS_M + 1.5
    assert highest_m < HEIGHT_M + 1.0
    assert run.center_m[:2] == pytest.approx((90.0, 18.0), abs=2.0)


@pytest.mark.long
def test_target_that_creeps_beside_a_hall_is_held_there() -> None:
    """An estimated velocity is never 0: a target that stood 5 m from a hall tore the formation along it."""
    hall = Obstacle("hall", 60.0, 0.0, 10.0, 24.0, 300.0)
    run, named = Run((hall,), target=Target(60.0, 29.0, 0.02, 0.01, 0.0)), list[str]()
    run.fly(50.0)
    for speed_m_s in (0.2, 0.4, 0.1, 0.5):
        now_s = run.memory.time_s
        run.plan = replace(run.plan, target=Target(60.0, 29.0, speed_m_s, 0.0, now_s))
        named.append(run.fly(1.0).held_by)
    assert named == ["hall"] * 4
    off_m = np.linalg.norm(run.place_m - run.center_m, axis=1) - RADIUS_M
    assert np.abs(off_m).max() < 0.5


def turning_ring(turned_rad: float) -> tuple[Obstacle, ...]:
    """Six boxes about the target that go round it, as they are after this turn."""
    boxes = list[Obstacle]()
    for turn_rad in turned_rad + np.pi / 3.0 * np.arange(6):
        ahead, aside = np.cos(turn_rad), np.sin(turn_rad)
        x_m, y_m, now_s = 70.0 + RING_M * ahead, RING_M * aside, turned_rad * RING_M / RING_M_S
        moves = {"velocity_x_m_s": -RING_M_S * aside, "velocity_y_m_s": RING_M_S * ahead, "time_s": now_s}
        boxes.append(Obstacle(f"b{len(boxes)}", x_m, y_m, 8.0, 8.0, 60.0, **moves))
    return tuple(boxes)


RING_M, RING_M_S, RING_STEP_RAD = 26.0, 1.2, np.pi / 12.0


@pytest.mark.soak
@pytest.mark.long
def test_centre_waits_before_obstacles_that_turn() -> None:
    """Each gap seems open until it has turned away: the centre does not follow it round and round."""
    run = Run(turning_ring(0.0), height_max_m=50.0, target=Target(70.0, 0.0))
    place_m, named = list[Array](), list[str]()
    for step in range(1, 25):
        named.append(run.fly(RING_STEP_RAD * RING_M / RING_M_S).held_by)
        run.plan = replace(run.plan, obstacles=turning_ring(step * RING_STEP_RAD))
        place_m.append(run.center_m.copy())
    assert np.ptp(place_m[8:], axis=0).max() < 1.0
    assert all(named[8:])
    run.plan = replace(run.plan, obstacles=(Obstacle("far", 0.0, -120.0, 4.0, 4.0, 20.0),))
    run.fly(60.0)
    assert np.linalg.norm(run.center_m[:2] - (70.0, 0.0)) < 1.0, "it goes on once they are gone"
