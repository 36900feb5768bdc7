"""What vehicles without a link may sweep, and where they are expected."""

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.planning.lost_space import (
    COLUMNS_APART_M,
    DRIFT_S,
    OVERSHOOT_M,
    KeptSetpoints,
    expected_drift,
    return_heights_m,
    swept_segments_m,
)
from gcs.planning.silent_space import silent_segments_m
from gcs.safety.floor import Floor

LAST, HOME = np.array([30.0, 40.0, -20.0]), np.array([1.0, 2.0, 0.5])
COLUMN = [[[30.0, 40.0, -20.0], [30.0, 40.0, 0.0]]]


@pytest.mark.parametrize("action", ["descend", "land", "hold"])
def test_vehicle_landing_by_itself_sweeps_the_column_below(action: str) -> None:
    assert swept_segments_m(LAST, None, HOME, action, 30.0).tolist() == COLUMN


def test_returning_vehicle_may_climb_fly_home_and_descend() -> None:
    swept = swept_segments_m(LAST, None, HOME, "return", 30.0)
    assert swept.tolist() == [
        *COLUMN,
        [[30.0, 40.0, -20.0], [30.0, 40.0, -29.5]],
        [[30.0, 40.0, -29.5], [1.0, 2.0, -29.5]],
        [[1.0, 2.0, -29.5], [1.0, 2.0, 0.5]],
    ]


def test_vehicle_near_home_may_return_lower_as_px4_does() -> None:
    near = np.array([7.0, 10.0, -8.0])  # 10 m from home
    swept = swept_segments_m(near, None, HOME, "return", 30.0)
    assert [[7.0, 10.0, -9.5], [1.0, 2.0, -9.5]] in swept.tolist()
    assert [[7.0, 10.0, -29.5], [1.0, 2.0, -29.5]] in swept.tolist()


def test_return_heights_differ_up_to_the_fence() -> None:
    assert return_heights_m(4, 30.0, 4.0, 100.0).tolist() == [30.0, 34.0, 38.0, 42.0]
    assert return_heights_m(3, 30.0, 0.0, 100.0).tolist() == [30.0] * 3
    assert return_heights_m(2, 120.0, 4.0, 100.0).tolist() == [120.0] * 2
    heights_m = return_heights_m(50, 30.0, 4.0, 100.0)
    assert heights_m.min() == 30.0
    assert heights_m.max() <= 100.0
    assert (np.diff(heights_m) >= 0.0).all()
    assert np.unique(heights_m, return_counts=True)[1].max() == 3  # 18 layers for 50


def silent(
    action: str, silent_s: float, last: Array = LAST, *, moves: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Array:
    one = np.array([moves]), HOME[None], np.array([30.0]), np.array([silent_s])
    return silent_segments_m(last[None], *one, action=action, noticed_s=1.0)[0]


def test_space_of_a_silent_vehicle_grows() -> None:
    assert silent("hold", 1.5).tolist() == [[LAST.tolist(), LAST.tolist()]]
    for action, sign in (("return", -1.0), ("land", 1.0)):
        reach_m = [sign * (silent(action, s)[:, :, 2] * sign).max() for s in (0.5, 1.0, 1.5)]
        assert (np.diff(sign * np.array(reach_m)) > 0.0).all()
        assert sign * (reach_m[0] - LAST[2]) > 0.0, "before the autopilot acts"
    assert silent("return", 9.0)[:, :, 2].min() == -29.5, "no higher than its return height"


def test_silent_vehicle_that_is_high_may_begin_to_fly_home() -> None:
    high = np.array([30.0, 40.0, -60.0])
    way = silent("return", 1.0, high)[-1]
    assert way[0].tolist() == high.tolist()
    assert np.linalg.norm(way[1] - way[0]) == pytest.approx(15.0)
    assert (way[1] - way[0]) @ (HOME - high) > 0.0


def test_silent_vehicle_near_home_may_fly_there_without_a_climb() -> None:
    near = HOME - np.array([6.0, 0.0, 20.0])
    swept = silent("return", 1.0, near)
    assert distance_m(near + np.array([6.0, 0.0, 0.0]), swept) < 1e-9
    assert distance_m(near + np.array([6.0, 0.0, 0.0]), silent("hold", 1.0, near)) > 5.0


def test_silent_vehicle_may_drift() -> None:
    swept = silent("hold", 0.6, moves=(4.0, 0.0, 0.0))
    assert distance_m(LAST + np.array([4.0 * DRIFT_S, 0.0, 0.0]), swept) < 1e-9
    assert swept[:, :, 2].min() == swept[:, :, 2].max() == LAST[2]


def test_silent_vehicle_flies_on_before_it_can_have_noticed() -> None:
    swept = silent("hold", 0.6, moves=(4.0, 0.0, 0.0))
    assert distance_m(LAST, swept) == pytest.approx(4.0), "the space that it leaves is not closed"


@pytest.mark.parametrize("action", ["return", "land", "hold"])
def test_each_of_several_silent_vehicles_closes_its_own_space(action: str) -> None:
    random = np.random.default_rng(4)
    last, moves = random.normal(0.0, 20.0, (6, 3)), random.normal(0.0, 4.0, (6, 3))
    moves[1], moves[2] = 0.0, np.nan
    home = last + random.normal(0.0, 10.0, (6, 3))
    home[3] = np.nan
    each = last, moves, home, random.uniform(10.0, 40.0, 6), random.uniform(0.6, 2.0, 6)
    together, rows = silent_segments_m(*each, action=action, noticed_s=1.0)
    assert np.unique(rows).tolist() == [*range(6)]
    for row in range(6):
        alone, _ = silent_segments_m(
            *(column[row : row + 1] for column in each), action=action, noticed_s=1.0
        )
        assert together[rows == row].tolist() == alone.tolist()
    unmoved = together[rows == 2]
    assert len(unmoved) == 1 or action == "return"
    assert distance_m(last[2], unmoved) < 1e-9, "a vehicle of unknown velocity stays where it was seen"


def test_vehicle_has_one_or_two_velocities_in_the_order_asked() -> None:
    kept, still = KeptSetpoints(3), np.zeros((3, 3))
    desired = np.array([[1.0, 0.0, 0.0], [np.nan] * 3, [2.0, 0.0, 0.0]])
    setpoint = np.array([[4.0, 0.0, 0.0], [np.nan] * 3, [2.5, 0.0, 0.0]])
    kept.note(desired, setpoint, np.zeros(3), 1.0)
    rows, velocity_m_s = kept.possible_m_s(np.array([2, 0, 1]), still)
    assert rows.tolist() == [2, 0, 0, 1]
    assert velocity_m_s[:, 0].tolist() == [2.0, 1.0, 4.0, 0.0]


def test_each_vehicle_flies_on_and_acts_as_it_does() -> None:
    """In one call, as in calls of its own: one that notices soon and lands, one that flies on and holds."""
    last_m, moves_m_s = np.array([LAST, LAST + 20.0]), np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    home_m, height_m, silent_s = np.array([HOME, HOME]), np.full(2, 30.0), np.full(2, 1.5)
    actions, noticed_s, drift_s = ("land", "hold"), (1.0, 3.0), (2.2, 5.0)
    together, of = silent_segments_m(
        last_m,
        moves_m_s,
        home_m,
        height_m,
        silent_s,
        action=np.array(actions),
        noticed_s=np.array(noticed_s),
        drift_s=np.array(drift_s),
    )
    for row in range(2):
        one = (each[row : row + 1] for each in (last_m, moves_m_s, home_m, height_m, silent_s))
        alone, _ = silent_segments_m(
            *one, action=actions[row], noticed_s=noticed_s[row], drift_s=drift_s[row]
        )
        assert together[of == row].tolist() == alone.tolist()
    ends_m = np.abs(together[of == 1][:, :, 1] - last_m[1, 1]).max()
    assert ends_m == pytest.approx(2.0 * drift_s[1])


def test_expected_drift_flies_on_then_brakes_then_is_unknown() -> None:
    silent_s = np.array([0.6, 1.0, 2.4, 3.4, 5.0, 1.0])
    rows = np.array([True, True, True, True, True, False])
    moves = np.tile([4.0, 0.0, 0.0], (6, 1))
    place_m, velocity_m_s = expected_drift(np.zeros((6, 3)), moves, silent_s, rows, noticed_s=1.0)
    assert place_m[:4, 0] == pytest.approx([0.4, 2.0, 6.6, 7.6])
    assert velocity_m_s[:4, 0] == pytest.approx([4.0, 4.0, 2.0, 0.0])
    assert np.isnan(place_m[4:]).all()
    assert np.isnan(velocity_m_s[4:]).all()


def test_vehicle_above_the_return_height_flies_home_level() -> None:
    swept = swept_segments_m(np.array([30.0, 40.0, -60.0]), None, HOME, "return", 30.0)
    assert swept[2].tolist() == [[30.0, 40.0, -60.0], [1.0, 2.0, -60.0]]


def test_without_a_known_home_only_the_column_is_known() -> None:
    assert swept_segments_m(LAST, None, None, "return", 30.0).tolist() == COLUMN


def test_vehicle_below_the_origin_sweeps_no_column_above() -> None:
    low = np.array([0.0, 0.0, 2.0])
    assert swept_segments_m(low, None, None, "land", 30.0).tolist() == [[[0.0, 0.0, 2.0], [0.0, 0.0, 2.0]]]


def drifting(
    velocity: tuple[float, float, float], action: str = "descend", home: Array | None = HOME
) -> Array:
    return swept_segments_m(LAST, np.array(velocity), home, action, 30.0)


def distance_m(place: Array, segments: Array) -> float:
    """From a point to the nearest of the segments."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    share = ((place - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-9)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.linalg.norm(nearest - place, axis=1).min())


def test_moving_vehicle_drifts_and_may_descend_at_either_end() -> None:
    swept = drifting((4.0, -3.0, 0.0)).tolist()
    end = [30.0 + 4.0 * DRIFT_S, 40.0 - 3.0 * DRIFT_S]
    assert COLUMN[0] in swept
    assert pytest.approx(np.array([[*end, -20.0], [*end, 0.0]])) in swept
    assert pytest.approx(np.array([[30.0, 40.0, -20.0], [*end, -20.0]])) in swept


def test_columns_of_a_drift_leave_no_gap_between_them() -> None:
    assert Floor().kept_m(Floor().worst_reserve_m())[0] >= COLUMNS_APART_M
    swept = drifting((8.0, 0.0, 0.0))
    for share in np.linspace(0.0, 1.0, 50):
        for height_m in (1.0, 10.0, 19.0):
            below = LAST + np.array([8.0 * DRIFT_S * share, 0.0, 20.0 - height_m])
            assert distance_m(below, swept) <= COLUMNS_APART_M / 2


def test_climbing_may_be_higher_and_descending_as_high() -> None:
    assert drifting((0.0, 0.0, -2.5))[:, :, 2].min() == pytest.approx(-20.0 - 2.5 * DRIFT_S)
    assert drifting((0.0, 0.0, 1.4)).tolist() == COLUMN
    assert drifting((1.0, 0.0, 1.4))[:, :, 2].min() == -20.0


def test_returning_after_a_drift_starts_anywhere_along_it() -> None:
    swept = drifting((4.0, 0.0, 0.0), "return")
    for share in (0.0, 1.0):
        corner = np.array([30.0 + share * 4.0 * DRIFT_S, 40.0, -29.5])
        assert distance_m(corner, swept) < 1e-6
        assert distance_m((corner + np.array([1.0, 2.0, -29.5])) / 2.0, swept) < 1e-6
    assert distance_m(HOME, swept) < 1e-6


@pytest.mark.parametrize("velocity", [None, np.full(3, np.nan)])
def test_unknown_velocity_is_taken_as_rest(velocity: Array | None) -> None:
    assert swept_segments_m(LAST, velocity, HOME, "descend", 30.0).tolist() == COLUMN


def test_vehicle_lost_in_its_climb_may_reach_its_takeoff_height() -> None:
    low = HOME - np.array([0.1, 0.0, 2.0])
    climbing = swept_segments_m(low, np.zeros(3), HOME, "descend", 30.0, climbing_to_m=5.0).tolist()
    assert [[1.0, 2.0, 0.5 - 5.0 - OVERSHOOT_M], [1.0, 2.0, 0.5]] in climbing
    up = swept_segments_m(LAST, np.zeros(3), HOME, "descend", 30.0, climbing_to_m=5.0)
    assert up.tolist() == COLUMN
    nowhere = swept_segments_m(low, np.zeros(3), None, "descend", 30.0, climbing_to_m=5.0)
    assert len(nowhere) == 1


TICK_S = 0.05
NORTH, SOUTH, NOTHING = np.array([2.0, 0.0, 0.0]), np.array([-2.0, 0.0, 0.0]), np.full(3, np.nan)
Part = tuple[float, Array, Array, bool]


def possible(last_m_s: Array, *parts: Part) -> list[list[float]]:
    """Of a single vehicle; each part: for so long, desired velocity, setpoint, with or without telemetry."""
    kept, now_s, seen_s = KeptSetpoints(1), 0.0, 0.0
    for lasts_s, desired_m_s, setpoint_m_s, with_status in parts:
        for _ in range(round(lasts_s / TICK_S)):
            now_s += TICK_S
            seen_s = now_s if with_status else seen_s
            kept.note(desired_m_s[None], setpoint_m_s[None], np.array([now_s - seen_s]), now_s)
    _, velocities_m_s = kept.possible_m_s(np.array([0]), last_m_s[None])
    assert kept.expected_m_s(last_m_s[None]).tolist() == [velocities_m_s[0].tolist()]
    return [velocity_m_s.tolist() for velocity_m_s in velocities_m_s]


def test_vehicle_keeps_the_setpoint_that_it_can_have_received() -> None:
    north, south, nothing = (NORTH, NORTH, True), (SOUTH, SOUTH, True), (NOTHING, NOTHING, False)
    assert possible(NORTH, (1.0, *north), (0.5, *south), (1.0, *nothing)) == [SOUTH.tolist()]
    late = possible(NORTH, (1.0, *north), (0.1, *south), (0.4, SOUTH, SOUTH, False), (0.5, *nothing))
    assert late == [NORTH.tolist()], "the vehicle was seen too soon to have received it"


def test_without_a_station_vehicles_keep_the_newest_setpoint() -> None:
    """A station that ended had sent it: the vehicle has received it, although none has been seen since."""
    kept, turns_m_s = KeptSetpoints(2), np.array([NORTH, NORTH])
    kept.note(turns_m_s, turns_m_s, np.zeros(2), 1.0)
    turned_m_s = np.array([SOUTH, SOUTH])
    kept.note(turned_m_s, turned_m_s, np.full(2, 0.05), 1.05, np.array([True, False]))
    assert kept.expected_m_s(turns_m_s).tolist() == [SOUTH.tolist(), NORTH.tolist()]


def test_setpoint_that_leads_far_ahead_is_a_second_possibility() -> None:
    leads_m_s = NORTH + np.array([0.0, 1.5, 0.0])
    assert possible(NORTH, (1.0, NORTH, leads_m_s, True)) == [NORTH.tolist(), leads_m_s.tolist()]
    assert possible(NORTH, (1.0, NORTH, NORTH + 0.2, True)) == [NORTH.tolist()]


def test_vehicle_that_is_not_commanded_keeps_its_velocity() -> None:
    sinks = np.array([0.0, 0.0, 0.7])
    landing = (NORTH, NORTH, True), (NOTHING, NOTHING, True), (NOTHING, NOTHING, False)
    assert possible(sinks, (1.0, *landing[0]), (0.5, *landing[1]), (0.5, *landing[2])) == [sinks.tolist()]
