"""The law's invariants, one sentence each."""

from math import hypot

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from law_fleets import COUNTS, obstacles, places, vectors, within

from gcs.feasibility import check_formation, check_orbit, smallest_formation_radius_m
from gcs.formation.law import LawSettings, formation_velocity, goal_velocity
from gcs.formation.obstacles import (
    LEFT,
    RIGHT,
    AvoidanceSettings,
    Ellipse,
    avoid,
    heads_into,
    tangent_directions,
    tangent_points_m,
)
from gcs.formation.orbit import Center, advance_center, orbit_velocity, within_ground_speed
from gcs.formation.repulsion import repulsion_force, spread_directions, spreading_velocity
from gcs.formation.response import limit_change, scale_to_limits
from gcs.formation.sphere import sphere_velocity
from gcs.formation.thomson import energy
from gcs.formation.yaw import turn_towards
from gcs.frames import ShowFrame, wrap_rad
from gcs.landing import CLEAR_M, distinct_places_m
from gcs.plan import Direction, Formation, Orbit
from gcs.safety.filter import SafetySettings
from gcs.state import Array

CALM = settings(deadline=None, derandomize=True, max_examples=60)
LAW = LawSettings()
AVOIDANCE = AvoidanceSettings()
SAFETY = SafetySettings()


def turn(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def law(position: Array, center: Array, kick: Array) -> Array:
    n = len(position)
    return formation_velocity(
        position,
        np.linspace(0.5, 2.0, n),
        kick,
        np.linspace(0.0, 5.0, n),
        Center.at_rest(center),
        radius_m=10.0,
        settings=LAW,
    )


@st.composite
def swarms(draw: st.DrawFn) -> tuple[Array, Array, Array]:
    """Positions and kicks, (n, 3) each, and a centre that nobody is in."""
    count = draw(COUNTS)
    position, center = draw(places(count)), draw(places(1))[0]
    assume(np.linalg.norm(position - center, axis=1).min() > 1e-2)
    apart = np.linalg.norm(position[:, None] - position[None], axis=2) + np.eye(count)
    assume(apart.min() > 1e-2)
    return position, draw(vectors(count, 1.0)), center


@CALM
@given(swarms(), vectors(1, 500.0))
def test_the_law_does_not_depend_on_where_the_origin_is(
    swarm: tuple[Array, Array, Array], shift: Array
) -> None:
    position, kick, center = swarm
    here = law(position, center, kick)
    assert np.allclose(law(position + shift[0], center + shift[0], kick), here, atol=1e-6)


@CALM
@given(swarms(), st.floats(-4.0, 4.0))
def test_the_law_turns_with_the_world_about_the_vertical(
    swarm: tuple[Array, Array, Array], angle_rad: float
) -> None:
    position, kick, center = swarm
    about = turn(angle_rad).T
    turned = law(position @ about, center @ about, kick @ about)
    assert np.allclose(turned, law(position, center, kick) @ about, atol=1e-6)


@CALM
@given(swarms(), st.randoms(use_true_random=False))
def test_the_law_does_not_depend_on_the_order_of_the_fleet(
    swarm: tuple[Array, Array, Array], shuffle: object
) -> None:
    position, kick, center = swarm
    order = np.random.default_rng(len(position)).permutation(len(position))
    charge, engaged = np.linspace(0.5, 2.0, len(position)), np.linspace(0.0, 5.0, len(position))
    middle = Center.at_rest(center)
    here = formation_velocity(position, charge, kick, engaged, middle, radius_m=10.0, settings=LAW)
    there = formation_velocity(
        position[order], charge[order], kick[order], engaged[order], middle, radius_m=10.0, settings=LAW
    )
    assert np.allclose(there, here[order], atol=1e-6)


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
def test_with_radius_zero_the_centre_comes_to_rest_above_the_target(
    x_m: float, y_m: float, speed_m_s: float
) -> None:
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
def test_the_sum_with_the_targets_velocity_stays_within_the_ground_speed(
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
    spread = spreading_velocity(
        position,
        center,
        np.ones(len(position)),
        radius_m=radius_m,
        rate_per_s=0.8,
        speed_max_m_s=4.0,
        steps=5,
    )
    for term in (pull, spread, goal_velocity(position, np.tile(center, (len(position), 1)), settings=LAW)):
        assert np.isfinite(term).all()
        assert (np.linalg.norm(term, axis=1) <= 4.0 + 1e-9).all()
    offset = position - center
    radial = np.abs((spread * offset).sum(axis=1))
    assert (radial <= 1e-6 * (1.0 + np.linalg.norm(offset, axis=1))).all()
    assert np.allclose(np.cross(pull, offset), 0.0, atol=1e-6)


@CALM
@given(st.integers(2, 10), st.integers(0, 2**32 - 1))
def test_following_the_repulsion_never_raises_the_energy(count: int, seed: int) -> None:
    raw = np.random.default_rng(seed).normal(size=(count, 3))
    direction = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    assert energy(spread_directions(direction, np.ones(count), steps=20)) <= energy(direction) * (1 + 1e-9)


# obstacles


@CALM
@given(obstacles(), places(4))
def test_tangents_touch_the_ellipse_point_ahead_and_embrace_it(obstacle: object, position: Array) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)  # type: ignore[arg-type]
    outside = position[ellipse.distance_m(position) > 0.01]
    points = tangent_points_m(ellipse, outside)
    directions = tangent_directions(ellipse, outside)
    for touch, direction in zip(points, directions, strict=True):
        assert np.allclose((ellipse.normalised(touch) ** 2).sum(axis=1), 1.0)
        along = touch - outside[:, :2]
        length = np.linalg.norm(along, axis=1)
        assert np.allclose(
            (ellipse.outward(touch) * along).sum(axis=1), 0.0, atol=1e-6 * (1 + length.max(initial=0))
        )
        assert np.allclose(direction * length[:, None], along, atol=1e-6)
    middle = np.pad((directions[0] + directions[1]) / 2, ((0, 0), (0, 1)))
    assert heads_into(ellipse, outside, middle).all()


@CALM
@given(obstacles())
def test_the_ellipse_leaves_the_margin_everywhere_around_the_box(obstacle: object) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)  # type: ignore[arg-type]
    angle_rad = np.linspace(0.0, 2 * np.pi, 361)
    contour = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1) * ellipse.semi_m
    half = np.array([obstacle.half_length_x_m, obstacle.half_length_y_m])  # type: ignore[attr-defined]
    assert np.linalg.norm(np.maximum(np.abs(contour) - half, 0.0), axis=1).min() >= 2.0 - 1e-9


@CALM
@given(obstacles(), places(4), vectors(4, 6.0), st.sampled_from([LEFT, 0.0, RIGHT]), within(0.0, 4.0))
def test_avoidance_leaves_the_climb_and_those_above_alone_and_leads_out_those_inside(
    obstacle: object, position: Array, velocity: Array, side: float, sliding_m_s: float
) -> None:
    ellipse = Ellipse.around(obstacle, margin_m=2.0, headroom_m=3.0)  # type: ignore[arg-type]
    result = avoid(
        position, velocity, ellipse, AVOIDANCE, side=np.full(4, side), sliding_m_s=np.full(4, sliding_m_s)
    )
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
def test_the_wanted_velocity_never_jumps(
    wanted: Array, before: Array, limit_m_s2: float, dt_s: float
) -> None:
    after = limit_change(wanted, before, limit_m_s2, dt_s)
    assert (np.linalg.norm(after - before, axis=1) <= limit_m_s2 * dt_s * (1 + 1e-9)).all()
    assert (np.linalg.norm(after - wanted, axis=1) <= np.linalg.norm(before - wanted, axis=1) + 1e-9).all()


@CALM
@given(st.floats(-10, 10), st.floats(-10, 10), within(0.1, 3.0), within(0.01, 0.2))
def test_yaw_turns_no_faster_than_its_rate_and_comes_nearer(
    yaw_rad: float, wanted_rad: float, rate_rad_s: float, dt_s: float
) -> None:
    after = turn_towards(np.array([yaw_rad]), np.array([wanted_rad]), rate_rad_s, dt_s)
    turned = abs(float(wrap_rad(after - yaw_rad)[0]))
    assert turned <= rate_rad_s * dt_s + 1e-9
    left = abs(float(wrap_rad(np.array([wanted_rad]) - after)[0]))
    assert left <= abs(float(wrap_rad(np.array([wanted_rad - yaw_rad]))[0])) + 1e-9


# what fits


@CALM
@given(st.integers(2, 250), within(3.5, 90.0))
def test_the_smallest_radius_told_is_accepted(count: int, height_m: float) -> None:
    radius_m = smallest_formation_radius_m(count, SAFETY)
    assume(SAFETY.fence.height_min_m + radius_m <= height_m <= SAFETY.fence.height_max_m - radius_m)
    check_formation(Formation(radius_m, height_m), count, SAFETY)


@CALM
@given(within(0.1, LAW.center_speed_max_m_s))
def test_an_orbit_that_is_accepted_turns_no_harder_than_the_centre_can(speed_m_s: float) -> None:
    tightest_m = speed_m_s**2 / LAW.center_acceleration_max_m_s2
    check_orbit(Orbit(tightest_m * 1.0001 + 1e-6, speed_m_s), LAW)


@CALM
@given(
    st.integers(1, 8).flatmap(lambda n: vectors(n, 12.0)),
    st.integers(0, 5).flatmap(lambda n: vectors(n, 12.0)),
    st.lists(obstacles(), max_size=2),
)
def test_places_to_come_down_are_distinct_and_off_every_obstacle(
    wanted: Array, taken: Array, boxes: list[object]
) -> None:
    ellipses = {
        str(index): Ellipse.around(box, margin_m=2.0, headroom_m=3.0)  # type: ignore[arg-type]
        for index, box in enumerate(boxes)
    }
    place = distinct_places_m(wanted[:, :2], taken[:, :2], 4.0, ellipses)
    everybody = np.vstack([place, taken[:, :2]])
    distance = np.linalg.norm(place[:, None] - everybody[None], axis=2)
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
