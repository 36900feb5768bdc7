"""Vehicles leave the corridor of fast traffic in time, and enter none."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.safety.constraints import Braking
from gcs.safety.near_traffic import EARLY_S, SOONEST, WIDEST, Evading, NearTraffic, track_constraints

SPEED_M_S, RADIUS_M = 20.0, 30.0


def near_traffic(
    *place_m: float, velocity_m_s: tuple[float, float, float] = (SPEED_M_S, 0.0, 0.0)
) -> NearTraffic:
    """One that comes from the south, exactly known."""
    return NearTraffic(
        ("A",),
        np.array([place_m]),
        np.array([velocity_m_s]),
        np.array([RADIUS_M]),
        np.array([15.0]),
        np.zeros((1, 2, 3)),
    )


def evading(
    *place_m: tuple[float, float, float], desired_m_s: Array | None = None, reach_m: float = 300.0
) -> Evading:
    n = len(place_m)
    return Evading(
        np.array(place_m),
        np.ones(n, np.bool_),
        np.zeros((n, 3)) if desired_m_s is None else desired_m_s,
        np.zeros(n),
        np.full(n, 8.0),
        Braking().of_each(n),
        reach_m,
    )


AHEAD = near_traffic(-130.0, 0.0, -40.0)
"""100 m before the cylinder would be over the origin: 5 s."""


def test_vehicle_leaves_sideways_as_fast_as_needed() -> None:
    rows = track_constraints(evading((0.0, 10.0, -40.0)), AHEAD)
    assert rows.reason.tolist() == ["traffic A"]
    assert rows.normal[0] == pytest.approx([0.0, 1.0, 0.0])
    left_s = (130.0 - RADIUS_M) / SPEED_M_S - EARLY_S
    assert rows.bound_m_s[0] == pytest.approx(20.0 / left_s)


def test_side_is_that_to_which_the_desired_velocity_leads() -> None:
    back = np.array([[0.0, -4.0, 0.0]])
    early = near_traffic(-160.0, 0.0, -40.0)
    rows = track_constraints(evading((0.0, 5.0, -40.0), desired_m_s=back), early)
    assert rows.normal[0] == pytest.approx([0.0, -1.0, 0.0])


def test_other_side_where_only_that_is_reached_in_time() -> None:
    near = near_traffic(-90.0, 0.0, -40.0)
    back = np.array([[0.0, -8.0, 0.0]])
    rows = track_constraints(evading((0.0, 11.0, -40.0), desired_m_s=back), near)
    assert rows.normal[0] == pytest.approx([0.0, 1.0, 0.0])


def test_no_vehicle_is_led_over_the_fence() -> None:
    rows = track_constraints(evading((0.0, 10.0, -40.0), reach_m=25.0), near_traffic(-160.0, 0.0, -40.0))
    assert rows.normal[0] == pytest.approx([0.0, 1.0, 0.0]), "both ways lead over it: the nearer one"
    rows = track_constraints(evading((5.0, 90.0, -40.0), reach_m=100.0), near_traffic(-160.0, 85.0, -40.0))
    assert rows.normal[0] == pytest.approx([0.0, -1.0, 0.0])


def test_vehicle_beside_the_corridor_does_not_enter() -> None:
    rows = track_constraints(evading((0.0, 34.0, -40.0)), AHEAD)
    assert rows.normal[0] == pytest.approx([0.0, 1.0, 0.0])
    assert rows.bound_m_s[0] == pytest.approx(-Braking().speed_m_s(np.array([4.0]))[0])


@pytest.mark.parametrize(("height_m", "down"), [(60.0, -1.0), (20.0, 1.0)])
def test_vehicle_above_or_below_stays_there(height_m: float, down: float) -> None:
    rows = track_constraints(evading((0.0, 3.0, -height_m)), AHEAD)
    assert rows.normal[0] == pytest.approx([0.0, 0.0, down])
    assert rows.bound_m_s[0] == pytest.approx(-Braking().speed_m_s(np.array([5.0]))[0])


def test_climb_of_the_track_counts() -> None:
    climbing = near_traffic(-130.0, 0.0, -10.0, velocity_m_s=(SPEED_M_S, 0.0, -4.0))
    rows = track_constraints(evading((0.0, 10.0, -40.0)), climbing)
    assert rows.normal[0] == pytest.approx([0.0, 1.0, 0.0]), "it is as high when it arrives"


@pytest.mark.parametrize(
    "place_m", [(100.0, 0.0, -40.0), (-600.0, 0.0, -40.0)], ids=["has passed", "is far away"]
)
def test_other_tracks_constrain_nothing(place_m: tuple[float, float, float]) -> None:
    assert len(track_constraints(evading((0.0, 0.0, -40.0)), near_traffic(*place_m))) == 0


def test_cylinder_is_widened_by_what_is_not_known() -> None:
    one = near_traffic(-130.0, 0.0, -40.0)
    spread = np.zeros((1, 2, 3))
    spread[0, 0] = 4.0, 0.0, 1.0
    unsure = NearTraffic(one.names, one.position_m, one.velocity_m_s, one.radius_m, one.half_height_m, spread)
    radius_m, half_m = unsure.widened_m(np.array([[0.0], [5.0], [1000.0]]))
    assert radius_m[:, 0] == pytest.approx([36.0, 30.0 + 3.0 * np.sqrt(29.0), WIDEST * 30.0])
    assert half_m[:, 0] == pytest.approx(15.0)


def test_side_that_was_begun_is_kept() -> None:
    """While where it will pass is a guess of 30 m, that it is 8 m to the other side changes nothing."""
    known = near_traffic(-140.0, 0.0, -40.0)
    spread = np.zeros((1, 2, 3))
    spread[0, 0, 0] = 100.0
    badly = replace(known, spread=spread)
    begun = np.array([[0.0, -2.0, 0.0]])
    sides = [
        track_constraints(evading((0.0, 8.0, -40.0), desired_m_s=begun), each).normal[0, 1]
        for each in (known, badly)
    ]
    assert sides == [1.0, -1.0]


def test_way_counts_while_its_track_is_there() -> None:
    for from_s, until_s, rows in ((0.0, 4.0, 0), (4.0, 6.0, 1), (9.0, 10.0, 0)):
        window = replace(AHEAD, counts_s=(np.array([from_s]), np.array([until_s])))
        assert len(track_constraints(evading((0.0, 10.0, -40.0)), window)) == rows


def side_by_side(*off_m: float, spread_m2: float = 0.0) -> NearTraffic:
    """As AHEAD, some tracks so far beside each other, equally well known."""
    k = len(off_m)
    spread = np.zeros((k, 2, 3))
    spread[:, 0, 0] = spread_m2
    return NearTraffic(
        tuple(f"T{number}" for number in range(k)),
        np.array([[-130.0, each_m, -40.0] for each_m in off_m]),
        np.tile([SPEED_M_S, 0.0, 0.0], (k, 1)),
        np.full(k, RADIUS_M),
        np.full(k, 15.0),
        spread,
    )


def test_track_beside_changes_no_way_out() -> None:
    """The corridor of the second is 40 m away on the other side; a vehicle leaves to its own."""
    alone, among = (
        track_constraints(evading((0.0, 10.0, -40.0)), side_by_side(*off_m))
        for off_m in ((0.0,), (0.0, -60.0))
    )
    assert len(among) == 2
    assert among.normal[0] == pytest.approx(alone.normal[0])
    assert among.bound_m_s[0] == alone.bound_m_s[0]


def test_way_out_does_not_lead_into_another_corridor() -> None:
    rows = track_constraints(evading((0.0, 5.0, -40.0)), side_by_side(0.0, 45.0))
    assert rows.normal[0] == pytest.approx([0.0, -1.0, 0.0]), "10 m more, but nothing is there"


def test_tracks_far_away_change_no_choice() -> None:
    """Of two badly known tracks, 30 others that reach no vehicle."""
    near, all_of_them = (
        track_constraints(
            evading((0.0, 10.0, -40.0), desired_m_s=np.array([[0.0, -2.0, 0.0]])),
            side_by_side(0.0, 15.0, *[5000.0 + 200.0 * number for number in range(others)], spread_m2=400.0),
        )
        for others in (0, 30)
    )
    np.testing.assert_allclose(near.normal, all_of_them.normal)
    np.testing.assert_allclose(near.bound_m_s, all_of_them.bound_m_s)


def test_rows_of_a_vehicle_among_many_tracks_are_bounded() -> None:
    rows = track_constraints(evading((0.0, 0.0, -40.0), (0.0, 5.0, -40.0)), side_by_side(*range(-20, 20, 3)))
    assert np.bincount(rows.first).tolist() == [SOONEST, SOONEST]


@pytest.mark.parametrize("seed", range(10))
def test_one_velocity_leads_all_neighbours_out(seed: int) -> None:
    """Three tracks meet at ten vehicles within 4 m: crossing ways of neighbours contradict each other."""
    random = np.random.default_rng(seed)
    angle, k = random.uniform(-np.pi, np.pi, 3), 3
    along = np.stack([np.cos(angle), np.sin(angle), np.zeros(k)], axis=1)
    crossing = replace(
        side_by_side(0.0, 0.0, 0.0),
        position_m=random.uniform(-5.0, 5.0, (k, 3)) * (1.0, 1.0, 0.0) - 130.0 * along - [0.0, 0.0, 40.0],
        velocity_m_s=SPEED_M_S * along,
    )
    place_m = random.uniform(-2.0, 2.0, (10, 3)) - [0.0, 0.0, 40.0]
    rows = track_constraints(evading(*map(tuple, place_m)), crossing)
    assert np.bincount(rows.first).tolist() == [k] * 10
    headings = np.arange(16) * np.pi / 8.0
    ways_m_s = 8.0 * np.stack([np.cos(headings), np.sin(headings), np.zeros(16)], axis=1)
    assert (ways_m_s @ rows.normal.T - rows.bound_m_s).min(axis=1).max() > -1e-6


def test_many_at_one_side_keep_none_from_its_own_way() -> None:
    """Two tracks meet head-on: one vehicle is 5 m from the left edge of both corridors, 20 at the right."""
    head_on = replace(
        side_by_side(0.0, 0.0),
        position_m=np.array([[-130.0, 0.0, -40.0], [130.0, 0.0, -40.0]]),
        velocity_m_s=np.array([[SPEED_M_S, 0.0, 0.0], [-SPEED_M_S, 0.0, 0.0]]),
    )
    others = [(x_m, y_m, -40.0) for x_m in np.linspace(-12.0, 12.0, 5) for y_m in (15.0, 19.0, 23.0, 27.0)]
    rows = track_constraints(evading((0.0, -25.0, -40.0), *others), head_on)
    left_s = (130.0 - RADIUS_M) / SPEED_M_S - EARLY_S
    assert (rows.bound_m_s[rows.first == 0] / -rows.normal[rows.first == 0, 1]).tolist() == pytest.approx(
        [5.0 / left_s] * 2
    )
