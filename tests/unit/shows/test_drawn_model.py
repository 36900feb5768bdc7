"""Positions, velocities, accelerations, colours and yaw of a drawn show at any time."""

import numpy as np
import pytest

from gcs.model.errors import ShapeError
from gcs.shows.drawn import LightPrograms, Trajectories, Trajectory, YawPrograms
from gcs.shows.drawn.light_programs import WHITE, LightProgram
from gcs.shows.drawn.trajectories import bezier_of_power, power_of_bezier, turned
from gcs.shows.drawn.yaw_programs import NO_YAW, YawProgram
from tests.support.drawn_shows import drawn_show


def _fleet(seed: int = 7, vehicles: int = 12) -> Trajectories:
    """Bezier pieces of degrees 1 to 7, each vehicle with its own number of them and times."""
    rng = np.random.default_rng(seed)
    made = []
    for vehicle in range(vehicles):
        pieces, degree = 1 + vehicle % 5, 1 + vehicle % 7
        points_m = rng.uniform(-20.0, 20.0, (pieces, degree + 1, 3))
        points_m[1:, 0] = points_m[:-1, -1]  # without jumps
        times_s = vehicle + np.append(0.0, np.cumsum(rng.uniform(1.0, 9.0, pieces)))
        made.append(Trajectory(times_s, power_of_bezier(points_m)))
    return Trajectories.joined(made)


def _de_casteljau(points_m: np.ndarray, u: float) -> np.ndarray:
    while len(points_m) > 1:
        points_m = (1.0 - u) * points_m[:-1] + u * points_m[1:]
    return np.asarray(points_m[0])


def test_every_vehicle_follows_its_own_bezier_curves() -> None:
    fleet = _fleet()
    for time_s in np.linspace(0.0, 60.0, 97).tolist():
        found_m = fleet.at(time_s).position_m
        for row in range(len(fleet)):
            one = fleet.of_vehicle(row)
            piece = int(np.clip(np.searchsorted(one.times_s, time_s, "right") - 1, 0, len(one.times_s) - 2))
            begin_s, end_s = one.times_s[piece : piece + 2]
            u = float(np.clip((time_s - begin_s) / (end_s - begin_s), 0.0, 1.0))
            expected_m = _de_casteljau(bezier_of_power(one.coefficients_m[piece]), u)
            assert found_m[row] == pytest.approx(expected_m, abs=1e-9)


def test_velocity_and_acceleration_are_the_derivatives() -> None:
    fleet, step_s = _fleet(), 1e-4
    for time_s in (3.3, 8.7, 14.2, 21.9):
        before, now, after = (fleet.at(time_s + step * step_s) for step in (-1, 0, 1))
        velocity_m_s = (after.position_m - before.position_m) / (2.0 * step_s)
        acceleration_m_s2 = (after.velocity_m_s - before.velocity_m_s) / (2.0 * step_s)
        assert now.velocity_m_s == pytest.approx(velocity_m_s, abs=1e-4)
        assert now.acceleration_m_s2 == pytest.approx(acceleration_m_s2, abs=1e-4)


def test_a_vehicle_rests_before_and_after_its_trajectory() -> None:
    fleet = _fleet()
    for time_s, place in ((-1.0, 0), (1e4, -1)):
        motion = fleet.at(time_s)
        assert not motion.velocity_m_s.any()
        assert not motion.acceleration_m_s2.any()
        for row in range(len(fleet)):
            ends_m = bezier_of_power(fleet.of_vehicle(row).coefficients_m)[place, place]
            assert motion.position_m[row] == pytest.approx(ends_m)


def test_each_vehicle_may_have_its_own_time() -> None:
    fleet = _fleet()
    times_s = np.linspace(0.0, 30.0, len(fleet))
    together = fleet.at(times_s)
    for row, time_s in enumerate(times_s.tolist()):
        assert together.position_m[row] == pytest.approx(fleet.at(time_s).position_m[row])
        assert together.velocity_m_s[row] == pytest.approx(fleet.at(time_s).velocity_m_s[row])


def test_some_vehicles_at_some_times() -> None:
    fleet, times_s = _fleet(), np.array([3.0, 9.0, 21.0, 3.0])
    asked = fleet.at(times_s, np.array([5, 5, 0, 11]))
    for place_m, time_s, row in zip(asked.position_m, times_s.tolist(), (5, 5, 0, 11), strict=True):
        assert place_m == pytest.approx(fleet.at(time_s).position_m[row])


def test_a_trajectory_of_one_point_stands_there() -> None:
    fleet = Trajectories.joined([Trajectory(np.array([5.0]), np.array([[[1.0, 2.0, -3.0]]]))])
    for time_s in (0.0, 5.0, 99.0):
        assert fleet.at(time_s).position_m.tolist() == [[1.0, 2.0, -3.0]]
    assert fleet.end_s.tolist() == [5.0]
    assert fleet.of_vehicle(0).times_s.tolist() == [5.0]


def test_no_vehicle_leaves_the_hull() -> None:
    fleet = _fleet()
    least_m, most_m = fleet.hull_m()
    positions_m = fleet.positions_m(np.linspace(0.0, 60.0, 500))
    assert (positions_m >= least_m - 1e-9).all()
    assert (positions_m <= most_m + 1e-9).all()


def test_a_placed_drawing_is_turned_clockwise_then_moved() -> None:
    """A quarter turn clockwise from above leads what was ahead (x) to the right (y)."""
    ahead = Trajectories.joined([Trajectory(np.array([0.0]), np.array([[[10.0, 0.0, -5.0]]]))])
    placed = ahead.placed(90.0, np.array([100.0, 0.0, 0.0]))
    assert placed.at(0.0).position_m[0] == pytest.approx([100.0, 10.0, -5.0])


def test_all_parts_of_a_placed_show_move_together() -> None:
    """Seen from its own frame, a placed show is the same show."""
    show, offset_m = drawn_show(6, 30.0, 3.0, ("rings",)), np.array([40.0, -7.0, 0.0])
    placed = show.placed(30.0, offset_m)
    back = np.linalg.inv(turned(30.0))
    for time_s in (0.0, 9.0, 21.0):
        place_m = (placed.trajectories.at(time_s).position_m - offset_m) @ back
        assert place_m == pytest.approx(show.trajectories.at(time_s).position_m)
        assert placed.yaw.at(time_s) == pytest.approx(show.yaw.at(time_s) + np.pi / 6)
    assert (placed.home_m - offset_m) @ back == pytest.approx(show.home_m)
    corners_m = (placed.fence[0].points_m - offset_m[:2]) @ back[:2, :2]
    assert corners_m == pytest.approx(show.fence[0].points_m)


def test_some_vehicles_in_another_order() -> None:
    fleet, rows = _fleet(), [4, 0, 9]
    assert fleet.of_vehicles(rows).at(11.0).position_m == pytest.approx(fleet.at(11.0).position_m[rows])


@pytest.mark.parametrize(
    ("times_s", "coefficients"),
    [
        ([0.0, 2.0, 2.0], np.zeros((2, 2, 3))),
        ([-1.0, 2.0], np.zeros((1, 2, 3))),
        ([0.0, 9e3], np.zeros((1, 2, 3))),
        ([0.0, 1.0], np.zeros((1, 9, 3))),
        ([0.0, 1.0], np.zeros((2, 2, 3))),
        ([0.0, 1.0], np.full((1, 2, 3), np.nan)),
    ],
)
def test_impossible_trajectories_are_refused(times_s: list[float], coefficients: np.ndarray) -> None:
    with pytest.raises(ShapeError):
        Trajectory(np.array(times_s), coefficients)


def test_lights_hold_fade_and_stay() -> None:
    red, blue = [255, 0, 0], [0, 0, 255]
    before, after = (np.array(rgb, np.uint8) for rgb in ([red, red], [red, blue]))
    program = LightProgram(np.array([0.0, 2.0, 4.0]), before, after)
    lights = LightPrograms.joined([WHITE, program])
    expected = {1.0: red, 2.0: red, 3.0: [128, 0, 128], 4.0: blue, 900.0: blue}
    for time_s, rgb in expected.items():
        assert lights.colours_at(time_s).tolist() == [[255, 255, 255], rgb]
    assert lights.of_vehicle(1).times_s.tolist() == [0.0, 2.0, 4.0]


def test_yaw_turns_between_set_points() -> None:
    turning = YawProgram(np.array([10.0, 20.0]), np.array([0.0, np.pi]))
    yaw = YawPrograms.joined([NO_YAW, turning])
    assert np.isnan(yaw.at(15.0)[0])
    assert [yaw.at(time_s)[1] for time_s in (0.0, 15.0, 99.0)] == pytest.approx([0.0, np.pi / 2, np.pi])
