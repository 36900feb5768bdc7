"""The nearest velocities, and the shortening after it, against numbers computed by hand."""

import numpy as np
import pytest

from gcs.safety.constraints import NO_ROW, SHRINKS, Constraints, any_broken
from tests.support.safety_world import half_space, project, shrink


def test_pair_shares_the_correction_evenly_and_no_other_changes() -> None:
    # they close with 4 m/s, 1 is allowed: 1.5 each
    desired = np.array([[2.0, 1.0, 0.0], [-2.0, 0.0, 0.5]])
    closing = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    assert project(desired, closing) == pytest.approx(np.array([[0.5, 1.0, 0.0], [-0.5, 0.0, 0.5]]), abs=1e-3)


def test_the_projection_onto_a_corner_is_the_nearest_point_of_it() -> None:
    corner = Constraints.joined(
        half_space(0, NO_ROW, (-1.0, 0.0, 0.0), -1.0), half_space(0, NO_ROW, (0.0, -1.0, 0.0), -2.0)
    )
    assert project(np.array([[5.0, 5.0, 1.0]]), corner) == pytest.approx(
        np.array([[1.0, 2.0, 1.0]]), abs=1e-3
    )


def test_velocities_that_break_nothing_are_unchanged() -> None:
    desired = np.array([[0.3, -0.2, 0.1], [1.0, 0.0, 0.0]])
    allowed = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    assert project(desired, allowed).tolist() == desired.tolist()
    assert shrink(desired, allowed).tolist() == desired.tolist()


def test_remaining_violations_are_shrunk_until_they_hold() -> None:
    velocity = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    closing = half_space(0, 1, (-1.0, 0.0, 0.0), -1.0)
    shrunk = shrink(velocity, closing)
    assert closing.slack_m_s(shrunk)[0] >= -1e-3
    assert shrunk[2].tolist() == [1.0, 1.0, 1.0]
    assert (shrunk[:2, 0] / velocity[:2, 0] < 1.0).all()


def test_violation_that_rest_does_not_fix_is_not_shrunk() -> None:
    fleeing = np.array([[0.5, 0.0, 0.0]])
    assert shrink(fleeing, half_space(0, NO_ROW, (1.0, 0.0, 0.0), 2.0)).tolist() == fleeing.tolist()


def test_bound_of_zero_at_a_wall_ends_in_rest() -> None:
    crawl = shrink(np.array([[500.0, 0.0, 0.0]]), half_space(0, NO_ROW, (-1.0, 0.0, 0.0), 0.0))
    assert crawl[0, 0] == pytest.approx(0.0, abs=1e-3)


def test_two_approaching_vehicles_shrink_no_more_than_needed() -> None:
    velocity = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # 4 m/s of which 1 is allowed: a quarter of each
    shrunk = shrink(velocity, half_space(0, 1, (-1.0, 0.0, 0.0), -1.0))
    assert shrunk == pytest.approx(velocity / 4.0, abs=1e-3)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0)])
def test_fleeing_vehicle_keeps_speed_and_lets_the_other_close(first: int, second: int) -> None:
    # row 0 comes with 3 m/s, row 1 flees before it with 0.6: of their 2.4 m/s 0.5 are allowed
    velocity = np.array([[3.0, 0.0, 0.0], [0.6, 0.0, 0.0]])
    away = -1.0 if first == 0 else 1.0
    shrunk = shrink(velocity, half_space(first, second, (away, 0.0, 0.0), -0.5))
    assert shrunk == pytest.approx(np.array([[1.1, 0.0, 0.0], [0.6, 0.0, 0.0]]), abs=1e-3)


def test_constraints_that_only_rest_satisfies_end_in_rest() -> None:
    # each of a ring of three is shortened for the next one: geometrically, and at last it must end
    ring = Constraints.joined(*(half_space(row, (row + 1) % 3, (-1.0, 0.0, 0.0), 0.0) for row in range(3)))
    shrunk = shrink(np.array([[3.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), ring)
    assert (ring.slack_m_s(shrunk) >= -1e-3).all()


def test_shrinking_skips_parting_demands_not_later_constraints() -> None:
    both = Constraints.joined(
        half_space(0, NO_ROW, (1.0, 0.0, 0.0), 2.0), half_space(0, NO_ROW, (0.0, -1.0, 0.0), -1.0)
    )
    assert shrink(np.array([[0.0, 4.0, 0.0]]), both) == pytest.approx(np.array([[0.0, 1.0, 0.0]]), abs=1e-3)


def test_wall_removes_excess_speed_of_one_metre_a_second() -> None:
    wall = half_space(0, NO_ROW, (-1.0, 0.0, 0.0), -1.0)
    assert project(np.array([[2.0, 0.0, 0.0]]), wall) == pytest.approx(np.array([[1.0, 0.0, 0.0]]))


def test_column_shortened_one_by_one_ends_in_rest() -> None:
    # no vehicle may come up with the one before it by more than 1 cm/s; the first of all meets a wall
    column = Constraints.joined(
        *(half_space(row, row + 1, (-1.0, 0.0, 0.0), -0.01) for row in range(SHRINKS + 20)),
        half_space(SHRINKS + 20, NO_ROW, (-1.0, 0.0, 0.0), 0.0),
    )
    shrunk = shrink(np.tile([2.0, 0.0, 0.0], (SHRINKS + 21, 1)), column)
    assert (column.slack_m_s(shrunk) >= -1.1e-3).all()
    tail = np.arange(SHRINKS + 21)[::-1]  # how many are before each
    assert shrunk[tail < SHRINKS, 0] == pytest.approx(0.01 * tail[tail < SHRINKS])
    assert not shrunk[tail >= SHRINKS].any()


@pytest.mark.parametrize(
    ("speed_m_s", "broken"), [(1.002, True), (1.0005, False), (0.5, False), (-3.0, False)]
)
def test_violation_starts_beyond_the_tolerance(speed_m_s: float, broken: bool) -> None:
    wall = half_space(0, NO_ROW, (-1.0, 0.0, 0.0), -1.0)
    rows = (wall.first, wall.second, wall.normal, wall.bound_m_s)
    assert any_broken(np.array([[speed_m_s, 0.0, 0.0]]), *rows) == broken


def test_wall_that_pushed_too_far_gives_the_excess_back() -> None:
    # the wall alone asks for 1 m/s of row 0, coming up with row 1 for 1 m/s of both: not for rest
    both = Constraints.joined(
        half_space(0, NO_ROW, (-1.0, 0.0, 0.0), -1.0), half_space(0, 1, (-1.0, 0.0, 0.0), 0.0)
    )
    desired = np.array([[3.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert project(desired, both)[:, 0] == pytest.approx([1.0, 1.0], abs=1e-3)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 0)])
def test_crossing_vehicle_is_not_shrunk_for_an_approaching_one(first: int, second: int) -> None:
    # row 0 flies past to the north, row 1 comes from the east with 3 m/s of which 1 is allowed
    velocity = np.array([[0.0, 4.0, 0.0], [-3.0, 0.0, 0.0]])
    away = -1.0 if first == 0 else 1.0
    shrunk = shrink(velocity, half_space(first, second, (away, 0.0, 0.0), -1.0))
    assert shrunk == pytest.approx(np.array([[0.0, 4.0, 0.0], [-1.0, 0.0, 0.0]]), abs=1e-3)


def test_wall_shrinks_only_the_vehicle_before_it() -> None:
    velocity = np.array([[4.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
    shrunk = shrink(velocity, half_space(0, NO_ROW, (-1.0, 0.0, 0.0), -1.0))
    assert shrunk[:, 0] == pytest.approx([1.0, 4.0], abs=1e-3)


def test_push_is_passed_on_by_a_vehicle_at_rest() -> None:
    # row 0 has to go with 5 m/s and pushes row 1, row 1 pushes row 2; at first they hardly touch
    resting = half_space(1, 2, (-1.0, 0.0, 0.0), 0.0)
    pushed = half_space(0, NO_ROW, (1.0, 0.0, 0.0), 5.0), half_space(0, 1, (-1.0, 0.0, 0.0), 0.0)
    desired = np.array([[0.0, 0.0, 0.0], [-1.5e-6, 0.0, 0.0], [-3e-6, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = project(desired, Constraints.joined(resting, *pushed))
    assert found[:, 0] == pytest.approx([5.0, 5.0, 5.0, 0.0], abs=1e-2)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_nearly_opposite_constraints_meet_at_their_corner(order: tuple[int, int]) -> None:
    # row 0 must go with 1 m/s against x, hardly upwards, and may go with 0.7 m/s against x: it has to climb
    narrow = half_space(0, NO_ROW, (-0.9892, 0.0, -0.1466), 1.0), half_space(0, NO_ROW, (1.0, 0.0, 0.0), -0.7)
    found = project(np.array([[-1.0, 0.0, 0.0]]), Constraints.joined(*(narrow[k] for k in order)))
    assert found == pytest.approx(np.array([[-0.7, 0.0, -(1.0 - 0.9892 * 0.7) / 0.1466]]), abs=2e-3)


def test_contradictory_constraints_give_no_large_velocity() -> None:
    both = Constraints.joined(
        half_space(0, NO_ROW, (1.0, 0.0, 0.0), 1.0), half_space(0, NO_ROW, (-1.0, 0.0, 0.0), 0.0)
    )
    assert abs(project(np.zeros((1, 3)), both)[0, 0]) <= 1.0
