"""What a show wants at any of its times."""

from math import radians

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model.plan import Direction, Target
from gcs.shows import parse
from gcs.shows.timeline import Glide, Timeline, shortest_s
from tests.support.show_files import BEGIN, loaded, text_of

GROW = {"cue": "grow", "at_s": 10, "radius_m": 12, "over_s": 10, "lights": ["#ff0000", "#0000ff"]}


def timeline(*cues: dict[str, object], **changes: object) -> Timeline:
    return loaded(*cues, **changes).timeline


@given(
    change=st.floats(-50.0, 50.0),
    rate=st.floats(0.1, 5.0),
    acceleration=st.floats(0.1, 5.0),
)
def test_shortest_glide_reaches_its_rate_or_acceleration_limit(
    change: float, rate: float, acceleration: float
) -> None:
    long_s = shortest_s(change, rate, acceleration)
    if long_s < 1e-3:
        return
    glide = Glide(0.0, long_s, np.zeros(1), np.array([change]), 0)
    times_s = np.linspace(0.0, long_s, 2001)
    rates = np.array([glide.rate(t)[0] for t in times_s])
    accelerations = np.gradient(rates, times_s)
    assert np.abs(rates).max() <= rate * (1 + 1e-6)
    assert np.abs(accelerations).max() <= acceleration * 1.001
    assert np.abs(rates).max() > 0.999 * rate or np.abs(accelerations).max() > 0.99 * acceleration
    assert glide.value(long_s)[0] == change


def test_cue_changes_its_values_and_keeps_all_others() -> None:
    desired = timeline(GROW, {"cue": "rise", "at_s": 25, "height_m": 22})
    early, late = desired.plan_at(5.0), desired.plan_at(59.0)
    assert (early.formation.radius_m, early.formation.height_m) == (8.0, 20.0)
    assert (late.formation.radius_m, late.formation.height_m) == (12.0, 22.0)
    assert desired.plan_at(15.0).formation.radius_m == pytest.approx(10.0)


def test_first_and_last_instants_count_before_and_after() -> None:
    desired = timeline(GROW)
    assert desired.plan_at(-30.0).formation == desired.plan_at(0.0).formation
    assert desired.plan_at(1e6).formation == desired.plan_at(60.0).formation


def test_lights_are_given_in_turn_and_blended() -> None:
    desired = timeline(GROW)
    assert desired.colours_at(5.0).tolist() == [[0, 0, 0]] * 8
    assert desired.colours_at(20.0)[:3].tolist() == [[255, 0, 0], [0, 0, 255], [255, 0, 0]]
    assert desired.colours_at(15.0)[0].tolist() == [128, 0, 0]


def test_target_glides_from_rest_to_rest_with_its_velocity() -> None:
    desired = timeline({"cue": "go", "at_s": 5, "target": {"x_m": 10, "y_m": -4}})
    assert desired.plan_at(4.0).target.speed_m_s == 0.0
    end_s = desired.leg_at(20.0).to_s
    middle = desired.plan_at((5.0 + end_s) / 2).target
    ahead = desired.plan_at((5.0 + end_s) / 2 + 1e-3).target
    assert middle.velocity_x_m_s == pytest.approx((ahead.x_m - middle.x_m) / 1e-3, rel=1e-3)
    assert (desired.plan_at(end_s).target.x_m, desired.plan_at(end_s).target.y_m) == (10.0, -4.0)
    assert desired.plan_at(end_s + 1.0).target.speed_m_s == 0.0


def test_a_path_leads_through_its_points() -> None:
    path = [{"after_s": 10, "x_m": 9, "y_m": 3}, {"after_s": 25, "x_m": 0, "y_m": 12}]
    desired = timeline({"cue": "go", "at_s": 5, "target": {"path": path}})
    there = desired.plan_at(15.0).target
    assert (there.x_m, there.y_m) == pytest.approx((9.0, 3.0))
    assert there.speed_m_s > 0.1
    end = desired.plan_at(40.0).target
    assert (end.x_m, end.y_m) == pytest.approx((0.0, 12.0))
    assert end.speed_m_s == 0.0


def test_first_cue_may_begin_with_its_own_path() -> None:
    path = [{"after_s": 0, "x_m": 6, "y_m": 2}, {"after_s": 20, "x_m": 0, "y_m": 0}]
    desired = timeline(timeline=[BEGIN | {"target": {"path": path}}])
    begin = desired.plan_at(0.0).target
    assert (begin.x_m, begin.y_m) == pytest.approx((6.0, 2.0))
    assert desired.plan_at(30.0).target.x_m == pytest.approx(0.0)


def test_live_target_is_the_reported_one_and_waits_for_it() -> None:
    desired = timeline({"cue": "follow", "at_s": 10, "target": "live"})
    reported = Target(3.0, 4.0, 0.5, 0.0, 1000.0)
    assert desired.plan_at(5.0, live=reported).target.x_m == 0.0
    assert desired.plan_at(15.0, live=reported).target is reported
    assert desired.plan_at(15.0).target.speed_m_s == 0.0


def test_stopped_clock_stops_the_target_with_tick_times() -> None:
    desired = timeline({"cue": "go", "at_s": 5, "target": {"x_m": 10, "y_m": 0}})
    runs, stopped = desired.plan_at(8.0, clock_s=500.0), desired.plan_at(8.0, clock_s=510.0, runs=False)
    assert (runs.target.time_s, stopped.target.time_s) == (500.0, 510.0)
    assert runs.target.speed_m_s > 0.0
    assert stopped.target.speed_m_s == 0.0
    assert runs.target.x_m == stopped.target.x_m


def test_loop_is_unrolled_and_later_cues_are_shifted() -> None:
    cues = [
        {"cue": "in", "at_s": 5, "radius_m": 10},
        {"cue": "out", "at_s": 15, "radius_m": 8},
        {"cue": "end", "at_s": 25},
    ]
    desired = timeline(*cues, loops=[{"from_cue": "in", "to_cue": "end", "times": 3}])
    names = [(one.cue.cue, one.at_s, one.passage) for one in desired.played]
    assert names == [
        ("begin", 0.0, 1),
        ("in", 5.0, 1),
        ("out", 15.0, 1),
        ("in", 25.0, 2),
        ("out", 35.0, 2),
        ("in", 45.0, 3),
        ("out", 55.0, 3),
        ("end", 65.0, 1),
    ]
    assert desired.duration_s == 100.0
    assert desired.plan_at(34.0).formation.radius_m == pytest.approx(desired.plan_at(14.0).formation.radius_m)
    assert desired.cue_at(50.0).cue.cue == "in"


def test_obstacles_appear_and_disappear() -> None:
    box = {"id": "mast", "x_m": 30, "y_m": 0, "half_length_x_m": 1, "half_length_y_m": 1, "height_m": 20}
    desired = timeline(
        {"cue": "up", "at_s": 10, "obstacles": {"appear": [box]}},
        {"cue": "down", "at_s": 20, "obstacles": {"go": ["mast"]}},
    )
    seen = [[each.id for each in desired.plan_at(t).obstacles] for t in (5.0, 10.0, 19.9, 20.0)]
    assert seen == [[], ["mast"], ["mast"], []]


def test_a_spin_clockwise_from_above_is_positive() -> None:
    clockwise = {"cue": "spin", "at_s": 5, "spin": {"rate_deg_s": 6}}
    other = {
        "cue": "spin",
        "at_s": 5,
        "spin": {"rate_deg_s": 6, "direction": Direction.COUNTERCLOCKWISE.value},
    }
    assert timeline(clockwise).plan_at(50.0).formation.spin_rad_s == pytest.approx(radians(6))
    assert timeline(other).plan_at(50.0).formation.spin_rad_s == pytest.approx(-radians(6))


def test_hash_covers_the_content_not_the_formatting() -> None:
    plain = loaded(GROW).show.digest
    commented = parse("# a comment\n" + text_of(GROW, about="Other words."), "other.yaml").show.digest
    default_written_out = loaded(GROW, limits={"speed_max_m_s": 8}).show.digest
    turned = loaded(
        GROW, origin={"latitude_deg": 47.4, "longitude_deg": 8.5, "altitude_amsl_m": 488.0, "heading_deg": 7}
    )
    assert plain == commented == default_written_out
    assert len({plain, loaded(GROW | {"radius_m": 12.5}).show.digest, turned.show.digest}) == 3


def test_pads_are_rows_about_their_centre() -> None:
    pads_m = loaded().show.pads_m
    assert pads_m[:2].tolist() == [[-2.5, -7.5, 0.0], [-2.5, -2.5, 0.0]]
    assert pads_m.mean(axis=0).tolist() == [0.0, 0.0, 0.0]
    assert BEGIN["at_s"] == 0
