"""The law's invariants, one sentence each."""

from dataclasses import replace
from math import hypot, inf

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.formation.article import repulsion_force
from gcs.formation.law import LawSettings, directions_from, goal_velocity, slot_velocity, turn_towards
from gcs.formation.laws.registry import SHIPPED
from gcs.formation.neighbours import sphere_velocity
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.formation.orbit import Center, advance_center, orbit_velocity, within_ground_speed
from gcs.formation.repulsion import energy, sweep
from gcs.formation.response import limit_change, scale_to_limits, shrink_relative
from gcs.formation.steering import LEFT, RIGHT, avoid_all
from gcs.model.frames import ShowFrame, wrap_rad
from gcs.model.plan import Direction, Formation, Obstacle, Orbit, Plan, Target
from gcs.model.state import Array, FleetState, Traits
from gcs.planning.feasibility import check_formation, check_orbit, smallest_formation_radius_m
from gcs.planning.landing_sites import CLEAR_M, distinct_sites_m
from gcs.safety.surroundings import SafetySettings
from gcs.safety.walls import Fence
from tests.support.law_fleets import COUNTS, met_m, obstacles, places, tangent_of, vectors, within

CALM = settings(deadline=None, max_examples=60)
LAW = LawSettings()
AVOIDANCE = AvoidanceSettings()
SAFETY = SafetySettings()


def turn(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def lattice(count: int) -> Array:
    """(count, 3) unit vectors, nearly even."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle_rad = 2.4 * np.arange(count)
    ring = np.sqrt(1.0 - z * z)
    return np.stack([ring * np.cos(angle_rad), ring * np.sin(angle_rad), z], axis=1)


WIDE = ControlSettings(safety=SafetySettings(fence=Fence(distance_max_m=1e6, height_max_m=1e6)))
ABOUT = np.array([40.0, -20.0, -200.0])


def tick_of(
    position_m: Array,
    ids: tuple[str, ...],
    about_m: Array,
    motion_m_s: Array,
    law: str = "slots",
) -> Array:
    """(n, 3) velocities that the third tick allows to drones that have stood still, about a moving centre."""
    n = len(ids)
    plan = Plan(
        Formation(30.0, -float(about_m[2]), law=law),
        Orbit(),
        Target(about_m[0] + 9.0 * motion_m_s[0], about_m[1] + 9.0 * motion_m_s[1]),
    )
    charge = np.array([0.5 + 0.1 * int(name[1:]) for name in ids])
    traits = replace(Traits.alike(n), charge=charge)
    tasks = Tasks(
        np.full(n, Task.FORMATION, dtype=np.int8),
        np.full((n, 3), np.nan),
        np.ones(n, dtype=bool),
        np.zeros(n, dtype=bool),
        np.zeros((0, 2, 3)),
        center_moves=True,
    )
    memory = replace(Memory.fresh(n, 0.0), center=Center(about_m, motion_m_s, np.zeros(3)), radius_m=30.0)
    for index in range(1, 4):
        fleet = FleetState(0.05 * index, ids, position_m.copy(), np.zeros((n, 3)), np.zeros(n), np.zeros(n))
        memory = tick(fleet, tasks, plan, traits, memory, WIDE).memory
    return memory.desired_m_s


LAWS = st.sampled_from(list(SHIPPED))


@st.composite
def fleets(draw: st.DrawFn) -> tuple[Array, tuple[str, ...], Array]:
    """(n, 3) places well apart from each other, ids, and a level motion of the centre (3,)."""
    count = draw(st.integers(2, 12))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    around = lattice(count) * 60.0 + random.uniform(-5.0, 5.0, (count, 3))
    motion = np.append(random.uniform(-2.0, 2.0, 2), 0.0)
    return ABOUT + around, tuple(f"d{i + 1}" for i in range(count)), motion


@CALM
@given(fleets(), within(-500.0, 500.0), within(-500.0, 500.0), LAWS)
def test_the_tick_does_not_depend_on_where_the_origin_is(
    fleet: tuple[Array, tuple[str, ...], Array], x_m: float, y_m: float, law: str
) -> None:
    position, ids, motion = fleet
    shift = np.array([x_m, y_m, 0.0])
    here = tick_of(position, ids, ABOUT, motion, law)
    assert np.allclose(tick_of(position + shift, ids, ABOUT + shift, motion, law), here, atol=1e-4)


@CALM
@given(fleets(), st.floats(-4.0, 4.0), LAWS)
def test_the_tick_turns_with_the_world_about_the_vertical(
    fleet: tuple[Array, tuple[str, ...], Array], angle_rad: float, law: str
) -> None:
    position, ids, motion = fleet
    about = turn(angle_rad).T
    turned = tick_of(position @ about, ids, ABOUT @ about, motion @ about, law)
    assert np.allclose(turned, tick_of(position, ids, ABOUT, motion, law) @ about, atol=1e-4)


@CALM
@given(fleets(), st.integers(0, 2**32 - 1), LAWS)
def test_tick_does_not_depend_on_the_vehicle_order(
    fleet: tuple[Array, tuple[str, ...], Array], seed: int, law: str
) -> None:
    position, ids, motion = fleet
    order = np.random.default_rng(seed).permutation(len(ids))
    there = tick_of(position[order], tuple(ids[row] for row in order), ABOUT, motion, law)
    assert np.allclose(there, tick_of(position, ids, ABOUT, motion, law)[order], atol=1e-4)


@CALM
@given(COUNTS.flatmap(lambda n: st.tuples(places(n), vectors(n, 1.0))))
def test_repulsion_forces_cancel(swarm: tuple[Array, Array]) -> None:
    position, charges = swarm
    force = repulsion_force(position, np.abs(charges[:, 0]), gain=0.2)
    assert np.abs(force.sum(axis=0)).max() <= 1e-9 * (1.0 + np.abs(force).max())


@CALM
@given(
    within(-60.0, 60.0), within(-60.0, 60.0), within(0.1, 5.0), within(0.5, 30.0), st.sampled_from(Direction)
)
def test_the_field_has_its_speed_everywhere(
    x_m: float, y_m: float, speed_m_s: float, radius_m: float, direction: Direction
) -> None:
    velocity = orbit_velocity(
        np.array([x_m, y_m]), radius_m=radius_m, speed_m_s=speed_m_s, direction=direction, braking_m_s2=0.5
    )
    assert abs(hypot(*velocity) - speed_m_s) < 1e-9
    cross = x_m * velocity[1] - y_m * velocity[0]
    if hypot(x_m, y_m) > 0.01:  # from x towards y is to the right: clockwise
        assert cross > 0.0 if direction is Direction.CLOCKWISE else cross < 0.0


@CALM
@given(within(-60.0, 60.0), within(-60.0, 60.0), within(0.1, 5.0))
def test_with_radius_zero_the_centre_rests_above_the_target(x_m: float, y_m: float, speed_m_s: float) -> None:
    place = np.array([x_m, y_m])
    for _ in range(6):
        velocity = orbit_velocity(
            place, radius_m=0.0, speed_m_s=speed_m_s, direction=Direction.CLOCKWISE, braking_m_s2=0.5
        )
        assert hypot(*velocity) <= speed_m_s + 1e-9
        assert hypot(*(place + 0.05 * velocity)) <= hypot(*place) + 1e-12
        place = place * 0.1
    assert hypot(*velocity) < 0.01


@CALM
@given(within(-9.0, 9.0), within(-9.0, 9.0), within(-9.0, 9.0), within(-9.0, 9.0), within(0.1, 8.0))
def test_sum_with_target_velocity_stays_within_ground_speed(
    target_x: float, target_y: float, x: float, y: float, limit_m_s: float
) -> None:
    target, relative = np.array([target_x, target_y]), np.array([x, y])
    total = within_ground_speed(target, relative, limit_m_s)
    assert hypot(*total) <= limit_m_s * (1 + 1e-9) + 1e-9
    if hypot(*(target + relative)) <= limit_m_s and hypot(*target) < limit_m_s:
        assert np.allclose(total, target + relative)


@CALM
@given(vectors(3, 20.0), within(0.1, 3.0), within(0.01, 0.2))
def test_the_centre_never_accelerates_harder_than_its_limit(
    drawn: Array, limit_m_s2: float, dt_s: float
) -> None:
    before = Center(drawn[0], drawn[1], np.zeros(3))
    after = advance_center(before, drawn[2], dt_s, limit_m_s2)
    assert np.linalg.norm(after.acceleration_m_s2) <= limit_m_s2 * (1 + 1e-9)
    assert np.allclose(after.velocity_m_s, before.velocity_m_s + dt_s * after.acceleration_m_s2)


@CALM
@given(COUNTS.flatmap(lambda n: st.tuples(places(n), places(1))), within(1.0, 30.0))
def test_each_term_keeps_its_bound_and_its_direction(drawn: tuple[Array, Array], radius_m: float) -> None:
    position, center = drawn[0], drawn[1][0]
    pull = sphere_velocity(position, center, radius_m=radius_m, rate_per_s=0.8, speed_max_m_s=4.0)
    direction, distance_m = directions_from(position, center)
    led = slot_velocity(
        direction, distance_m, direction[::-1].copy(), radius_m, 0.8, np.full(len(position), 4.0)
    )
    goal, anywhere = np.tile(center, (len(position), 1)), (np.inf, np.inf, np.inf)
    straight = goal_velocity(position, goal, settings=LAW, limits_m_s=anywhere, speed_max_m_s=4.0)
    for term in (pull, led, straight):
        assert np.isfinite(term).all()
        assert (np.linalg.norm(term, axis=1) <= 4.0 + 1e-9).all()
    offset = position - center
    assert np.allclose(np.cross(pull, offset), 0.0, atol=1e-6)


@CALM
@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_sweeping_the_slots_never_raises_the_energy(count: int, seed: int) -> None:
    raw = np.random.default_rng(seed).normal(size=(count, 3))
    direction = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    place, _ = sweep(direction, np.zeros((count, 3)), direction, np.ones(count), 40, 0.0)
    assert np.allclose(np.linalg.norm(place, axis=1), 1.0)
    assert energy(place) <= energy(direction) * (1 + 1e-5)


@CALM
@given(vectors(3, 9.0), vectors(4, 9.0), within(0.1, 8.0), within(0.1, 4.0))
def test_shrunk_sum_keeps_limits_unless_the_common_part_exceeds(
    base: Array, relative: Array, level_m_s: float, climb_m_s: float
) -> None:
    total = shrink_relative(
        base[0], relative, level_m_s, climb_m_s, climb_m_s, np.full(len(relative), np.inf)
    )
    shares = ((total - base[0]) * relative).sum(axis=1)
    assert (shares >= -1e-9).all()
    if hypot(*base[0][:2]) <= level_m_s:
        assert (np.hypot(total[:, 0], total[:, 1]) <= level_m_s * (1 + 1e-9)).all()
    if abs(base[0][2]) <= climb_m_s:
        assert (np.abs(total[:, 2]) <= climb_m_s * (1 + 1e-9)).all()


# obstacles


@CALM
@given(obstacles(), places(4), st.sampled_from([LEFT, RIGHT]))
def test_tangents_separate_directions_that_meet_the_ellipse(
    obstacle: Obstacle, position: Array, side: float
) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    for place in position[ellipse.distance_m(position) > 0.1]:
        ahead = tangent_of(ellipse, place, side)
        assert hypot(*ahead) == pytest.approx(1.0)
        for off_rad in (-2e-3, 2e-3):
            turned = ahead + off_rad * np.array([-ahead[1], ahead[0]])
            assert (met_m(ellipse, place, turned) < inf) == (off_rad * side < 0.0)


@CALM
@given(obstacles(), places(4), vectors(4, 6.0))
def test_contact_is_where_the_ellipse_is_met_for_the_first_time(
    obstacle: Obstacle, position: Array, velocity: Array
) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    for place, flown_m_s in zip(position, velocity[:, :2], strict=True):
        speed_m_s = hypot(*flown_m_s)
        ahead_m = met_m(ellipse, place, flown_m_s)
        if 0.0 < ahead_m < inf:
            on_it = (place[:2] + ahead_m * flown_m_s / speed_m_s)[None]
            assert abs(ellipse.distance_m(on_it)[0]) < 1e-6 * (1.0 + ahead_m)
            before = (place[:2] + 0.99 * ahead_m * flown_m_s / speed_m_s)[None]
            assert ellipse.distance_m(before)[0] > 0.0


@CALM
@given(st.lists(obstacles(), min_size=1, max_size=4), places(4), vectors(4, 6.0))
def test_no_vehicle_enters_an_obstacle_with_a_free_tangent(
    boxes: list[Obstacle], position: Array, velocity: Array
) -> None:
    ellipses = {str(k): Ellipse.around(box, margin_m=2.0, headroom_m=100.0) for k, box in enumerate(boxes)}
    outside = np.min([ellipse.distance_m(position) for ellipse in ellipses.values()], axis=0) > 0.1
    straight = AVOIDANCE.model_copy(update={"push_rate_per_s": 1e-12, "near_m": AVOIDANCE.lookahead_m - 1e-6})
    led = avoid_all(position, velocity, ellipses, {}, np.full(4, 2.0), straight)
    for place, turned in zip(position[outside], led[outside], strict=True):
        tangents = [tangent_of(e, place, side) for e in ellipses.values() for side in (LEFT, RIGHT)]
        first_m = [min(met_m(e, place, way, 0.999) for e in ellipses.values()) for way in (turned, *tangents)]
        reachable = max(first_m[1:]) >= straight.lookahead_m
        assert first_m[0] >= straight.lookahead_m - 0.5 or not reachable


@CALM
@given(obstacles())
def test_the_ellipse_leaves_the_margin_everywhere_around_the_box(obstacle: Obstacle) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    angle_rad = np.linspace(0.0, 2 * np.pi, 361)
    contour = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) * ellipse.semi_m
    half = np.array([obstacle.half_length_x_m, obstacle.half_length_y_m])
    assert np.linalg.norm(np.maximum(np.abs(contour) - half, 0.0), axis=1).min() >= 2.0 - 1e-9


@CALM
@given(obstacles(), places(4), vectors(4, 6.0), st.sampled_from([LEFT, 0.0, RIGHT]), within(0.0, 4.0))
def test_avoidance_keeps_climb_ignores_above_leads_out_inside(
    obstacle: Obstacle, position: Array, velocity: Array, side: float, sliding_m_s: float
) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)
    result = avoid_all(position, velocity, {"b": ellipse}, {"b": side}, np.full(4, sliding_m_s), AVOIDANCE)
    assert (result[:, 2] == velocity[:, 2]).all()
    above = -position[:, 2] >= ellipse.top_height_m
    assert (result[above] == velocity[above]).all()
    inside = ~above & ellipse.contains(position)
    outward = (result[:, :2] * ellipse.outward(position)).sum(axis=1)
    assert (outward[inside] >= AVOIDANCE.lead_out_m_s - 1e-9).all()


# setpoints


@CALM
@given(vectors(5, 100.0), within(0.5, 10.0), within(0.5, 5.0), within(0.5, 5.0))
def test_a_vector_is_scaled_to_the_limits_and_never_bent(
    velocity: Array, horizontal: float, up: float, down: float
) -> None:
    scaled = scale_to_limits(velocity, horizontal_max_m_s=horizontal, up_max_m_s=up, down_max_m_s=down)
    assert (np.hypot(scaled[:, 0], scaled[:, 1]) <= horizontal + 1e-9).all()
    assert (scaled[:, 2] <= down + 1e-9).all()
    assert (-scaled[:, 2] <= up + 1e-9).all()
    assert np.allclose(np.cross(scaled, velocity), 0.0, atol=1e-6)
    assert ((scaled * velocity).sum(axis=1) >= 0.0).all()
    assert (np.linalg.norm(scaled, axis=1) <= np.linalg.norm(velocity, axis=1) + 1e-9).all()


@CALM
@given(vectors(4, 10.0), vectors(4, 10.0), within(0.1, 5.0), within(0.01, 0.2))
def test_desired_velocity_never_jumps(desired: Array, before: Array, limit_m_s2: float, dt_s: float) -> None:
    after = limit_change(desired, before, before, np.full(4, limit_m_s2), dt_s)
    assert (np.linalg.norm(after - before, axis=1) <= limit_m_s2 * dt_s * (1 + 1e-9)).all()
    assert (np.linalg.norm(after - desired, axis=1) <= np.linalg.norm(before - desired, axis=1) + 1e-9).all()


@CALM
@given(st.floats(-10, 10), st.floats(-10, 10), within(0.1, 3.0), within(0.01, 0.2))
def test_yaw_approaches_within_its_rate(
    yaw_rad: float, desired_rad: float, rate_rad_s: float, dt_s: float
) -> None:
    after = turn_towards(np.array([yaw_rad]), np.array([desired_rad]), rate_rad_s, dt_s)
    turned = abs(float(wrap_rad(after - yaw_rad)[0]))
    assert turned <= rate_rad_s * dt_s + 1e-9
    left = abs(float(wrap_rad(np.array([desired_rad]) - after)[0]))
    assert left <= abs(float(wrap_rad(np.array([desired_rad - yaw_rad]))[0])) + 1e-9


# what fits


@CALM
@given(st.integers(2, 250), within(3.5, 90.0))
def test_the_smallest_radius_reported_is_accepted(count: int, height_m: float) -> None:
    radius_m = smallest_formation_radius_m(count, SAFETY)
    assume(SAFETY.fence.height_min_m + radius_m <= height_m <= SAFETY.fence.height_max_m - radius_m)
    check_formation(Formation(radius_m, height_m), count, SAFETY)


@CALM
@given(within(0.1, LAW.center_speed_max_m_s))
def test_accepted_orbit_turns_no_harder_than_the_centre_can(speed_m_s: float) -> None:
    tightest_m = speed_m_s**2 / LAW.center_acceleration_max_m_s2
    check_orbit(Orbit(tightest_m * 1.0001 + 1e-6, speed_m_s), LAW)


@CALM
@given(
    st.integers(1, 8).flatmap(lambda n: vectors(n, 12.0)),
    st.integers(0, 5).flatmap(lambda n: vectors(n, 12.0)),
    st.lists(obstacles(), max_size=2),
)
def test_landing_sites_are_distinct_and_off_every_obstacle(
    desired: Array, taken: Array, boxes: list[object]
) -> None:
    ellipses = {
        str(index): Ellipse.around(box, margin_m=2.0, headroom_m=3.0)  # type: ignore[arg-type]
        for index, box in enumerate(boxes)
    }
    place = distinct_sites_m(desired[:, :2], taken[:, :2], 4.0, ellipses)
    all_places = np.vstack([place, taken[:, :2]])
    distance = np.linalg.norm(place[:, None] - all_places[None], axis=2)
    distance[np.arange(len(place)), np.arange(len(place))] = np.inf
    assert distance.min() >= 4.0 - 1e-9
    assert all((ellipse.distance_m(place) >= CLEAR_M - 1e-9).all() for ellipse in ellipses.values())


@CALM
@given(
    within(-80.0, 80.0),
    within(-170.0, 170.0),
    within(-100.0, 3000.0),
    within(-360.0, 360.0),
    vectors(3, 500.0),
)
def test_the_show_frame_and_the_world_agree_both_ways(
    latitude: float, longitude: float, altitude: float, heading: float, place: Array
) -> None:
    frame = ShowFrame(latitude, longitude, altitude, heading)
    assert np.allclose(frame.position_m(*frame.geodetic(place)), place, atol=1e-4)
    assert np.allclose(frame.into_ned(frame.from_ned(place)), place, atol=1e-9)
    assert np.allclose(np.linalg.norm(frame.from_ned(place), axis=1), np.linalg.norm(place, axis=1))
