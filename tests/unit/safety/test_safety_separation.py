"""How pairs are held apart, against numbers computed by hand."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.safety.across_stations import CHANGE_M_S
from gcs.safety.constraints import Braking, Constraints
from gcs.safety.filter import filter_velocities
from gcs.safety.floor import Floor, pairs_that_count
from gcs.safety.lost_paths import OWNERS_MOST, keepout_constraints
from gcs.safety.neighbours import FEW
from gcs.safety.separation import separation_constraints
from gcs.safety.surroundings import Limits
from tests.support.safety_world import BRAKING, FLOOR, SETTINGS, filtered, surroundings


def test_pairs_on_pads_are_exempt_and_unknown_are_ignored() -> None:
    position = np.array(
        [[0.0, 0.0, -1.0], [1.0, 0.0, -1.9], [2.0, 0.0, -2.1], [np.nan, 0.0, -9.0], [3.0, 0.0, 0.0]]
    )
    airborne = np.array([True, True, True, True, False])
    first, second = pairs_that_count(position, airborne, FLOOR)
    assert list(zip(first.tolist(), second.tolist(), strict=True)) == [(0, 2), (1, 2), (2, 4)]


def test_widest_separation_satisfies_the_ellipsoid_everywhere() -> None:
    assert FLOOR.widest_m() == pytest.approx(4.5)
    unsure = FLOOR.model_copy(update={"vertical_uncertainty": 2.0, "deviations": 2.0})
    assert unsure.kept_m(0.7) == pytest.approx((3.7, 5.9))
    flat = Floor(horizontal_m=3.0, vertical_m=2.0, margin_m=1.0, uncertainty_m=0.0)
    assert flat.widest_m() == pytest.approx(4.0)


def test_margin_is_a_multiple_of_the_relative_deviation() -> None:
    floor = FLOOR.model_copy(update={"vertical_uncertainty": 2.0, "deviations": 2.0})
    assert floor.reserve_m(0.3, 0.4) == pytest.approx(2.0 * 0.5)
    assert floor.worst_reserve_m(np.array([0.1, 0.4, 0.2, 0.3])) == pytest.approx(2.0 * 0.5)
    assert floor.worst_reserve_m(np.array([0.4])) == pytest.approx(2.0 * 0.4)
    assert floor.widest_m(np.array([0.3, 0.4])) == pytest.approx(4.5 + 2.0 * 1.0)


def test_head_on_pair_is_held_to_its_combined_braking() -> None:
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    allowed = filtered(np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]), surroundings(position))
    closing = allowed[0, 0] - allowed[1, 0]
    assert closing == pytest.approx(float(BRAKING.speed_m_s(np.array([5.0]))[0]), abs=2e-3)
    assert allowed[0, 0] == pytest.approx(-allowed[1, 0], abs=2e-3)


def test_stacked_pair_is_separated_in_the_taller_direction() -> None:
    # 9 m apart, 4.5 m is floor and margin vertically
    position = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -29.0]])
    allowed = filtered(np.array([[0.0, 0.0, -2.5], [0.0, 0.0, 1.4]]), surroundings(position))
    assert allowed[1, 2] - allowed[0, 2] <= float(BRAKING.speed_m_s(np.array([4.5]))[0]) + 2e-3


def test_commanded_vehicle_yields_fully_to_an_uncommanded_one() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.5, 0.0, -20.0]])
    oncoming = np.array([[0.0, 0.0, 0.0], [-3.0, 0.0, 0.0]])
    around = surroundings(position, velocity=oncoming, commanded=[True, False])
    allowed = filtered(np.zeros((2, 3)), around)
    brake = float(BRAKING.speed_m_s(np.array([0.5]))[0])
    assert allowed[0, 0] == pytest.approx(-3.0 + brake, abs=2e-3)
    assert not allowed[1].any()


def test_pair_of_two_stations_that_share_yields_half_each() -> None:
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])
    desired, both = np.array([[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]), surroundings(position)
    together = filtered(desired, both)
    for own in ([True, False], [False, True]):
        shared = np.where(np.array(own)[:, None], np.nan, together)
        here = replace(both, commanded=np.array(own), shared_m_s=shared)
        allowed, reasons = filter_velocities(desired, here, SETTINGS)
        row = own.index(True)
        assert allowed[row] == pytest.approx(together[row])
        assert reasons[row] == f"separation from d{1 - row}"
        assert not allowed[1 - row].any()
        assert reasons[1 - row] == ""


def test_own_vehicle_yields_what_the_other_station_does_not() -> None:
    position = np.array([[-4.0, 0.0, -20.0], [4.0, 0.0, -20.0]])  # 5 m to floor and margin
    desired = np.array([[6.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    reported = np.array([[np.nan] * 3, [-0.5, 0.0, 0.0]])  # something that is not known here pushes it
    here = replace(surroundings(position, commanded=[True, False]), shared_m_s=reported)
    brake = float(BRAKING.speed_m_s(np.array([5.0]))[0])
    assert filtered(desired, here)[0, 0] == pytest.approx(brake - 0.5 + CHANGE_M_S, abs=2e-3)


def test_vehicle_of_unknown_velocity_is_kept_away_from() -> None:
    position = np.array([[0.0, 0.0, -20.0], [3.5, 0.0, -20.0]])
    unknown = np.array([[0.0, 0.0, 0.0], [np.nan, np.nan, np.nan]])
    around = surroundings(position, velocity=unknown, commanded=[True, False])
    allowed = filtered(np.array([[4.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), around)
    assert allowed[0, 0] <= float(BRAKING.speed_m_s(np.array([0.5]))[0]) + 2e-3


def test_coincident_vehicles_are_parted_vertically() -> None:
    position = np.array([[0.0, 0.0, -20.0], [0.0, 0.0, -20.0]])
    allowed = filtered(np.zeros((2, 3)), surroundings(position))
    assert allowed[0, 2] - allowed[1, 2] > 1.0


def test_no_commanded_vehicle_means_no_constraints() -> None:
    position = np.array([[0.0, 0.0, -20.0], [1.0, 0.0, -20.0]])
    no_vehicle = np.zeros(2, dtype=bool)
    found = separation_constraints(
        position,
        np.zeros((2, 3)),
        no_vehicle,
        ~no_vehicle,
        floor=FLOOR,
        braking=BRAKING,
        uncertainty_m=np.zeros(2),
        course_m_s=np.zeros((2, 3)),
        spare_m_s=np.full(2, 10.0),
    )
    assert len(found) == 0
    paths = np.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 0.0]]])
    assert (
        len(
            keepout_constraints(
                position, no_vehicle, paths, floor=FLOOR, braking=BRAKING, uncertainty_m=np.zeros(2)
            )
        )
        == 0
    )


def test_kept_space_takes_the_uncertainty_of_the_pair() -> None:
    position = np.array([[8.0, 0.0, -20.0], [100.0, 0.0, 0.0]])
    paths = np.array([[[0.0, 0.0, -20.0], [0.0, 0.0, 0.0]]])
    commanded = np.array([True, False])

    def bound_m_s(uncertainty_m: list[float], lost_m: float | None) -> float:
        found = keepout_constraints(
            position,
            commanded,
            paths,
            floor=FLOOR,
            braking=BRAKING,
            uncertainty_m=np.array(uncertainty_m),
            segments_uncertainty_m=None if lost_m is None else np.array([lost_m]),
        )
        return float(found.bound_m_s[0])

    precise = bound_m_s([0.05, 0.05], 0.05)
    assert bound_m_s([0.05, 2.0], 0.05) == precise  # the second stands on the ground, uncertain
    assert bound_m_s([0.05, 0.05], 0.5) > precise
    assert bound_m_s([0.5, 0.05], 0.05) > precise
    assert bound_m_s([0.05, 2.0], None) == bound_m_s([0.05, 2.0], 2.0)  # not known: the widest


def test_vehicle_pushed_beyond_its_look_is_checked_again() -> None:
    # an escape pushes the middle one, which rests, onto the right one, far beyond what anybody wants
    position = np.array([[0.0, 0.0, -20.0], [0.4, 0.0, -20.0], [4.4, 0.0, -20.0]])
    hard = SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"escape_rate_per_s": 3.0})})
    allowed, reasons = filter_velocities(np.zeros((3, 3)), surroundings(position), hard)
    assert allowed[1, 0] - allowed[0, 0] > 5.0
    assert allowed[2, 0] - allowed[1, 0] >= -float(BRAKING.speed_m_s(np.array([1.0]))[0]) - 2e-3
    assert reasons[2] == "separation from d1"


FAR_APART = np.array([[0.0, 500.0 * row, -20.0] for row in range(1, 25)])


def test_single_push_in_a_large_fleet_is_checked_again() -> None:
    # a pilot's vehicle pushes d1 onto d2; the others are in no other's way
    position = np.vstack([[[0.0, 0.0, -20.0], [0.4, 0.0, -20.0], [4.4, 0.0, -20.0]], FAR_APART])
    fence = SETTINGS.fence.model_copy(update={"distance_max_m": 1e5})
    hard = BRAKING.model_copy(update={"escape_rate_per_s": 3.0})
    settings = SETTINGS.model_copy(update={"braking": hard, "fence": fence})
    around = surroundings(position, commanded=[row > 0 for row in range(len(position))])
    allowed, reasons = filter_velocities(np.zeros_like(position), around, settings)
    assert allowed[1, 0] > 5.0
    assert allowed[2, 0] - allowed[1, 0] >= -float(BRAKING.speed_m_s(np.array([1.0]))[0]) - 2e-3
    assert reasons[:4] == ("", "separation from d0", "separation from d1", "")


def test_push_into_empty_space_names_its_cause_only() -> None:
    position = np.vstack([[[0.0, 0.0, -20.0], [0.4, 0.0, -20.0]], FAR_APART])
    fence = SETTINGS.fence.model_copy(update={"distance_max_m": 1e5})
    around = surroundings(position, commanded=[row > 0 for row in range(len(position))])
    allowed, reasons = filter_velocities(
        np.zeros_like(position), around, SETTINGS.model_copy(update={"fence": fence})
    )
    assert allowed[1, 0] == pytest.approx(-float(BRAKING.speed_m_s(np.array([-2.6]))[0]), abs=2e-3)
    assert not allowed[[0, *range(2, len(position))]].any()
    assert reasons == ("", "separation from d0", *("" for _ in FAR_APART))


def test_push_passed_along_a_row_is_followed_to_the_end() -> None:
    # all fly north; a pilot's vehicle pushes d1 onto d2, that one onto d3 and so on
    east = np.array([0.0, 0.4, 4.4, 8.4, 12.4, 16.4])
    position = np.column_stack([east, np.zeros(6), np.full(6, -20.0)])
    hard = SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"escape_rate_per_s": 2.5})})
    north = np.tile([0.0, 4.0, 0.0], (6, 1))
    around = surroundings(position, velocity=north, commanded=[row > 0 for row in range(6)])
    allowed, _ = filter_velocities(north, around, hard)
    assert allowed[1, 0] > 5.0
    assert (np.diff(allowed[1:, 0]) >= -float(BRAKING.speed_m_s(np.array([1.0]))[0]) - 5e-3).all()


ROUND = FLOOR.model_copy(update={"horizontal_m": 3.0, "vertical_uncertainty": 1.0})
FLAT = FLOOR.model_copy(update={"horizontal_m": 3.0, "vertical_m": 2.0, "vertical_uncertainty": 0.5})
SMALL_TALL = Floor(horizontal_m=0.3, vertical_m=0.9, margin_m=0.0, uncertainty_m=0.0)
SMALL_FLAT = Floor(horizontal_m=0.6, vertical_m=0.2, margin_m=0.0, uncertainty_m=0.0)
SLOW = Braking(reaction_s=1.5, lead_s=0.5, deceleration_m_s2=0.8, escape_rate_per_s=0.5)


@pytest.mark.parametrize("braking", [BRAKING.model_copy(update={"lead_s": 0.5}), SLOW], ids=["quick", "slow"])
@pytest.mark.parametrize(
    "floor",
    [FLOOR, ROUND, FLAT, SMALL_TALL, SMALL_FLAT],
    ids=["tall", "round", "flat", "small and tall", "small and flat"],
)
@pytest.mark.parametrize(
    ("spare_m_s", "closing_m_s", "unsure_m"),
    [
        *((0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, 0.0, 4.0)),
        *((1.0, 1.0, 1.0), (30.0, 0.0, 0.0), (30.0, 0.0, 4.0)),
    ],
)
def test_pair_is_found_as_soon_as_it_could_come_too_close(
    spare_m_s: float, closing_m_s: float, unsure_m: float, floor: Floor, braking: Braking
) -> None:
    wide_m, tall_m = floor.kept_m(float(floor.reserve_m(unsure_m, 0.0)))
    free_m = 2.0 * spare_m_s * braking.reaction_s + (2.0 * spare_m_s) ** 2 / (2.0 * braking.deceleration_m_s2)
    for up in np.linspace(0.0, np.pi / 2.0, 9):
        away = np.array([np.cos(up), 0.0, np.sin(up)])
        level = np.linalg.norm(away / (wide_m, wide_m, tall_m))
        normal = away / (wide_m**2, wide_m**2, tall_m**2) / level
        gap_m = free_m + braking.lead_s * 2.0 * closing_m_s
        apart_m = (1.0 + gap_m * np.linalg.norm(normal)) / level  # where that is left along the normal
        towards = closing_m_s * normal / np.linalg.norm(normal)
        for share, count in ((0.999, 1), (1.001, 0)):
            found = separation_constraints(
                np.array([share * apart_m * away, np.zeros(3)]) - (0.0, 0.0, 500.0),
                np.array([-towards, towards]),
                np.ones(2, dtype=bool),
                np.ones(2, dtype=bool),
                floor=floor,
                braking=braking,
                uncertainty_m=np.array([unsure_m, 0.0]),
                course_m_s=np.zeros((2, 3)),
                spare_m_s=np.full(2, spare_m_s),
            )
            assert len(found) == count


def test_when_all_are_pushed_all_are_checked_again() -> None:
    # two couples that are far too close part; the inner ones would meet
    position = np.column_stack([[0.0, 0.4, 5.4, 5.8], np.zeros(4), np.full(4, -20.0)])
    hard = SETTINGS.model_copy(update={"braking": BRAKING.model_copy(update={"escape_rate_per_s": 3.0})})
    allowed, _ = filter_velocities(np.zeros((4, 3)), surroundings(position), hard)
    assert (np.abs(allowed[:, 0]) > 0.5).all()
    assert allowed[1, 0] - allowed[2, 0] <= float(BRAKING.speed_m_s(np.array([2.0]))[0]) + 2e-3


WIDE = SETTINGS.fence.model_copy(update={"distance_max_m": 1e5})
HARD = BRAKING.model_copy(update={"escape_rate_per_s": 2.5})


def test_column_at_full_speed_stops_behind_a_standing_vehicle() -> None:
    # the first is far too close to a pilot's vehicle and turns back, so must they all, one after the other
    north = np.array([0.0, -0.4, -4.4, -8.4, -12.4, -16.4])
    position = np.column_stack([np.zeros(6), north, np.full(6, -20.0)])
    around = surroundings(position, commanded=[row > 0 for row in range(6)])
    settings = SETTINGS.model_copy(update={"braking": HARD, "fence": WIDE})
    allowed, _ = filter_velocities(np.tile([0.0, 8.0, 0.0], (6, 1)), around, settings)
    assert allowed[1, 1] < -6.0
    assert (np.diff(allowed[1:, 1]) <= float(BRAKING.speed_m_s(np.array([1.0]))[0]) + 5e-3).all()


def test_fast_push_in_a_large_fleet_is_seen_far_ahead() -> None:
    # d1 leaves a pilot's vehicle with 6.5 m/s; before d2, 10 m beyond what is kept, 4.6 m/s can be braked
    position = np.vstack([[[0.0, 0.0, -20.0], [0.4, 0.0, -20.0], [13.4, 0.0, -20.0]], FAR_APART])
    around = surroundings(position, commanded=[row > 0 for row in range(len(position))])
    settings = SETTINGS.model_copy(update={"braking": HARD, "fence": WIDE})
    allowed, reasons = filter_velocities(np.zeros_like(position), around, settings)
    assert allowed[1, 0] == pytest.approx(6.5, abs=2e-3)
    assert allowed[1, 0] - allowed[2, 0] == pytest.approx(
        float(BRAKING.speed_m_s(np.array([10.0]))[0]), abs=2e-3
    )
    assert reasons[2] == "separation from d1"


def test_push_passed_round_a_bend_is_followed_to_the_end() -> None:
    # each is 4 m from the one before it, 20 degrees further to the left: who pushes the last one is at first
    # nowhere near it, then not on the way to it, and only at last is pushed there
    bend_rad = np.radians([45.0, 65.0, 85.0])
    bend = np.vstack([[0.0, 0.0], np.cumsum(4.0 * np.column_stack([np.cos(bend_rad), np.sin(bend_rad)]), 0)])
    position = np.column_stack([np.vstack([[-0.4, 0.0], bend]), np.full(5, -20.0)])
    hard = BRAKING.model_copy(update={"escape_rate_per_s": 4.0})
    settings = SETTINGS.model_copy(update={"braking": hard, "limits": Limits(horizontal_m_s=12.0)})
    around = surroundings(position, commanded=[False, True, True, True, True])
    allowed, _ = filter_velocities(np.zeros((5, 3)), around, settings)
    for i, j in combinations(range(1, 5), 2):
        away = position[i] - position[j]
        apart_m = float(np.linalg.norm(away))
        closing_m_s = -(allowed[i] - allowed[j]) @ away / apart_m
        assert closing_m_s <= float(BRAKING.speed_m_s(np.array([apart_m - 3.0]))[0]) + 2e-3


def test_empty_fleet_needs_no_separation() -> None:
    no_vehicle = np.zeros((0, 3))
    assert filter_velocities(no_vehicle, surroundings(no_vehicle), SETTINGS)[1] == ()


def test_vehicle_between_two_columns_leaves_sideways() -> None:
    columns = np.array([[[x_m, 0.0, -30.0], [x_m, 0.0, 0.0]] for x_m in (-1.3, 1.3)])
    place = np.array([[0.05, 0.0, -15.0]])
    found = keepout_constraints(
        place, np.array([True]), columns, floor=Floor(), braking=Braking(), uncertainty_m=np.zeros(1)
    )
    assert abs(found.normal[:, 1]) == pytest.approx(1.0, abs=0.1)
    assert (found.bound_m_s > 1.0).all()


def test_next_column_of_the_same_vehicle_stops_none_beside_it() -> None:
    columns = np.array([[[x_m, 0.0, -30.0], [x_m, 0.0, 0.0]] for x_m in (0.0, 2.6)])
    place = np.array([[-1.0, 0.5, -15.0]])
    for owners, count in ((np.array([7, 7]), 1), (np.array([7, 8]), 2)):
        found = keepout_constraints(
            place,
            np.array([True]),
            columns,
            floor=Floor(),
            braking=Braking(),
            uncertainty_m=np.zeros(1),
            segments_of=owners,
        )
        assert len(found) == count


def test_paths_of_the_nearest_lost_vehicles_bound_the_work() -> None:
    """Of 40 lost vehicles each constrains the vehicle beside it exactly as if it were the only one."""
    columns = np.array([[[10.0 * k, 0.0, -30.0], [10.0 * k, 0.0, 0.0]] for k in range(40)])
    owners = 39 - np.arange(40)
    place = columns[:, 0] + np.array([2.0, 0.0, 15.0])

    def found(rows: list[int], paths: list[int]) -> Constraints:
        return keepout_constraints(
            place[rows],
            np.ones(len(rows), np.bool_),
            columns[paths],
            floor=Floor(),
            braking=Braking(),
            uncertainty_m=np.zeros(len(rows)),
            segments_of=owners[paths],
        )

    every = list(range(40))
    together = found(every, every)
    assert len(together) == 40 * OWNERS_MOST
    for k in every:
        mine = together.first == k
        nearest = np.flatnonzero(mine)[together.bound_m_s[mine].argmax()]
        alone = found([k], [k])
        assert together.bound_m_s[nearest] == alone.bound_m_s[0]
        assert together.normal[nearest].tolist() == alone.normal[0].tolist()


def test_vehicle_ahead_of_a_drifting_one_is_not_slowed() -> None:
    columns = np.array([[[x_m, 0.0, -30.0], [x_m, 0.0, 0.0]] for x_m in (6.0, 8.6)])
    lost_m, moves_m_s = np.array([[4.0, 0.0, -15.0]]), np.array([[4.0, 0.0, 0.0]])
    for x_m, slowed in ((5.0, False), (3.0, True)):
        found = keepout_constraints(
            np.array([[x_m, 0.3, -15.0]]),
            np.array([True]),
            columns,
            floor=Floor(),
            braking=Braking(),
            uncertainty_m=np.zeros(1),
            segments_of=np.zeros(2, dtype=np.intp),
            drift=(lost_m, moves_m_s),
        )
        assert (found.normal[:, 0] < -0.1).any() == slowed
        assert len(found) > 0


def test_wide_margins_drive_no_other_pair_together() -> None:
    """Around two, one above the other, and above both are nine that may be metres off."""
    about = [(6.0, 0.0), (-6.0, 0.0), (0.0, 6.0), (0.0, -6.0)]
    nine = [*((x, y, z) for z in (-8.2, -3.3) for x, y in about), (0.0, 0.0, -14.0)]
    position = np.array([(0.0, 0.0, -7.6), (0.0, 0.0, -3.3), *nine])  # two in each other's margin
    sure, nearest_m = np.arange(11) < 2, np.inf
    for _ in range(100):
        around = surroundings(position, commanded=sure.tolist())
        allowed = filtered(np.zeros((11, 3)), replace(around, uncertainty_m=np.where(sure, 0.0, 1.0)))
        position = position + 0.05 * np.where(sure[:, None], allowed, 0.0)
        apart_m = float(np.linalg.norm((position[0] - position[1]) * FLOOR.scale))
        nearest_m = min(nearest_m, apart_m)
    assert nearest_m > 2.8  # the floor is 2 m


@pytest.mark.parametrize("unknown", ["course_m_s", "uncertainty_m"])
def test_what_is_not_known_of_one_hides_no_other_pair(unknown: str) -> None:
    """In a fleet that is sorted into cells."""
    count = FEW + 50
    random = np.random.default_rng(1)
    position_m = random.uniform(-20.0, 20.0, (count, 3)) - (0.0, 0.0, 30.0)
    velocity_m_s, every = random.uniform(-3.0, 3.0, (count, 3)), np.ones(count, np.bool_)
    known = {"course_m_s": velocity_m_s, "uncertainty_m": np.zeros(count)}

    def pairs_without_first(values: dict[str, Array]) -> set[tuple[int, int]]:
        pairs = separation_constraints(
            position_m,
            velocity_m_s,
            every,
            every,
            floor=FLOOR,
            braking=BRAKING,
            spare_m_s=np.full(count, 0.25),
            course_m_s=values["course_m_s"],
            uncertainty_m=values["uncertainty_m"],
        )
        rows = zip(pairs.first.tolist(), pairs.other.tolist(), strict=True)
        return {(min(pair), max(pair)) for pair in rows if 0 not in pair}

    lacking = known[unknown].copy()
    lacking[0] = np.nan
    expected = pairs_without_first(known)
    assert len(expected) > count
    assert pairs_without_first({**known, unknown: lacking}) == expected
