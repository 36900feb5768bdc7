"""What is learned from the vehicles' answers, and what the filter receives of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.model.state import Array, Traits
from gcs.safety.authority import Authority, AuthoritySettings, measured, reach_constraints, yielding
from gcs.safety.constraints import NO_ROW, Constraints
from tests.support.law_fleets import within
from tests.support.safety_fleets import CALM, SAFETY, TICK_S

SETTINGS = AuthoritySettings()
FASTEST_M_S = 6.0


def after(
    seconds: float, allowed: Array, velocity: Array, before: Authority | None = None, delay_s: float = 0.0
) -> Authority:
    """What is known when the same was allowed and measured for so long."""
    known = Authority.full(len(allowed)) if before is None else before
    everyone, fastest = np.ones(len(allowed), np.bool_), np.full(len(allowed), FASTEST_M_S)
    for _ in range(round(seconds / TICK_S)):
        known = measured(
            known,
            allowed,
            velocity,
            everyone,
            fastest,
            dt_s=TICK_S,
            link_delay_s=delay_s,
            settings=SETTINGS,
        )
    return known


def along_x(*speeds: float) -> Array:
    return np.array([[speed, 0.0, 0.0] for speed in speeds])


def test_fleet_in_order_lacks_nothing() -> None:
    known = after(20.0, along_x(4.0, 4.0), along_x(4.0, 4.0))
    assert (known.lack_m_s == 0.0).all()
    assert (known.wander_m(SETTINGS) == 0.0).all()
    assert not known.slow.any()
    traits = Traits.alike(2)
    assert known.limit(traits) is traits


def test_late_answer_is_no_lack() -> None:
    known = after(5.0, along_x(0.0), along_x(0.0))
    known = after(0.4, along_x(3.0), along_x(0.0), known)
    assert np.abs(known.lack_m_s).max() < 0.8
    for tick in range(40):
        known = after(TICK_S, along_x(3.0), along_x(min(3.0, 0.2 * tick)), known)
    assert np.abs(known.lack_m_s).max() < 0.5
    assert (known.wander_m(SETTINGS) == 0.0).all()


def test_slow_vehicle_gets_a_lower_limit_and_later_none() -> None:
    asked, flown = along_x(5.0, 5.0, 5.0), along_x(2.0, 5.0, 5.0)
    assert not after(2.5, asked, flown).slow.any()
    known = after(6.0, asked, flown)
    assert known.slow.tolist() == [True, False, False]
    assert known.speed_max_m_s[0] == pytest.approx(2.3)
    limited = known.limit(Traits.alike(3))
    assert limited.speed_max_m_s.tolist() == [known.speed_max_m_s[0], np.inf, np.inf]
    for _ in range(30):  # it answers again: the limit grows as far as it is reached
        fast = along_x(min(known.speed_max_m_s[0], 6.0), 5.0, 5.0)
        known = after(1.0, fast, fast, known)
    assert not known.slow.any()


def test_vehicle_that_is_blown_off_is_not_slow() -> None:
    known = after(10.0, along_x(4.0, 4.0), along_x(-2.0, 4.0))
    assert not known.slow.any()
    assert known.lack_m_s[0, 0] == pytest.approx(6.0, abs=0.1)


def test_common_lack_leaves_the_others_their_places() -> None:
    """A wind that carries all alike changes no distance: only the lack counts, not the wander."""
    known = after(10.0, along_x(0.0, 0.0), along_x(-1.0, -1.0))
    assert (known.square_m2_s2 == 0.0).all()
    assert (known.wander_m(SETTINGS) > 0.0).all()


def test_gusts_count_for_the_whole_fleet_and_for_a_while() -> None:
    still = along_x(0.0, 0.0)
    gust = after(2.0, still, along_x(2.0, -2.0))
    assert gust.fleet_wander_m_s > 0.7
    later = after(5.0, still, still, gust)
    assert 0.3 < later.fleet_wander_m_s < gust.fleet_wander_m_s
    assert after(60.0, still, still, gust).fleet_wander_m_s < 0.1


def test_margin_grows_by_the_variance_beyond_the_free_one() -> None:
    known = replace(Authority.full(1), square_m2_s2=np.full(1, SETTINGS.free_m_s**2 + 0.16))
    assert known.wander_m(SETTINGS) == pytest.approx(0.4 * SETTINGS.horizon_s)
    assert (replace(known, square_m2_s2=np.full(1, SETTINGS.free_m_s**2)).wander_m(SETTINGS) == 0.0).all()


def test_vehicle_that_is_not_commanded_is_forgotten() -> None:
    known = after(10.0, along_x(5.0, 5.0), along_x(2.0, 5.0))
    none = np.zeros(2, np.bool_)
    known = measured(
        known,
        np.full((2, 3), np.nan),
        np.full((2, 3), np.nan),
        none,
        np.full(2, FASTEST_M_S),
        dt_s=TICK_S,
        link_delay_s=0.0,
        settings=SETTINGS,
    )
    assert (known.lack_m_s == 0.0).all()
    assert np.isnan(known.least_m_s).all()
    assert known.slow[0], "its limit is of the vehicle, not of the command"


def test_velocity_yields_along_the_lack_only() -> None:
    lack = np.array([[1.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
    desired, flown = np.array([[4.0, 3.0, 1.0]] * 2), np.zeros((2, 3))
    yielded, yields = yielding(desired, flown, lack, 0.5, 0.5)
    assert yielded[0] == pytest.approx([0.5, 3.0, 1.0])
    assert yielded[1] == pytest.approx(desired[1])
    assert yields.tolist() == [True, False]
    downwind, _ = yielding(-desired, flown, lack, 0.5, 0.5)
    assert downwind == pytest.approx(-desired)


def reach(walls: Constraints) -> Constraints:
    flown, lack = along_x(-1.0, -1.0, 0.0), along_x(2.0, 2.0, 0.7)
    return reach_constraints(flown, np.array([True, False, True]), lack, walls, 0.5, 0.5)


def test_reach_binds_commanded_vehicles_with_a_large_lack() -> None:
    found = reach(Constraints.none())
    assert found.first.tolist() == [0]
    assert found.second.tolist() == [NO_ROW]
    assert found.slack_m_s(along_x(-0.5, 0.0, 0.0)) == pytest.approx([0.0])
    assert found.slack_m_s(along_x(1.0, 0.0, 0.0))[0] < 0.0


def test_walls_may_demand_everything() -> None:
    wall = Constraints(
        np.zeros(1, int), np.full(1, NO_ROW), along_x(1.0), np.array([3.0]), np.array(["fence"], dtype=object)
    )
    assert reach(wall).slack_m_s(along_x(3.0, 0.0, 0.0)) == pytest.approx([0.0])


@CALM
@given(within(0.0, 5.0), within(0.0, 5.0), within(0.0, 5.0), st.booleans())
def test_less_authority_never_shrinks_a_margin(off: float, more: float, lack: float, lasting: bool) -> None:
    known = replace(
        Authority.full(2),
        least_m_s=np.zeros((2, 3)),
        square_m2_s2=np.full(2, off**2),
        lack_m_s=along_x(lack, 0.0),
    )
    if lasting:
        less = replace(known, lack_m_s=along_x(lack + more, 0.0))
    else:
        less = replace(known, square_m2_s2=np.full(2, (off + more) ** 2))
    led, farther = known.wander_m(SETTINGS), less.wander_m(SETTINGS)
    assert (farther >= led).all()
    assert SAFETY.floor.worst_reserve_m(farther) >= SAFETY.floor.worst_reserve_m(led)
