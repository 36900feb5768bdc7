"""A position is as uncertain as its receiver reports, no less than its kind of fix can mean, and capped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.fleet_state import Positioning, uncertainty_m

P = Positioning()
NEVER = np.inf
WORST_FIRST = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ACCURACY_M = st.floats(0.0, 20.0) | st.just(np.inf)


def one(horizontal_m: float, vertical_m: float, fix_type: float, since_s: float = NEVER) -> float:
    accuracy_m, up_m, fix, since = (
        np.array([value]) for value in (horizontal_m, vertical_m, fix_type, since_s)
    )
    return float(uncertainty_m(0.3, 2.0, accuracy_m, up_m, fix, since, P)[0])


@pytest.mark.parametrize(
    ("fix_type", "least_m"),
    [(6, 0.05), (5, 0.2), (4, 0.5), (3, 1.0), (2, 3.0), (0, 3.0), (7, 0.2), (99, 0.2)],
)
def test_no_fix_is_better_than_its_kind_can_mean(fix_type: float, least_m: float) -> None:
    assert one(0.01, 0.01, fix_type) == one(np.nan, np.nan, fix_type) == least_m


@pytest.mark.parametrize(
    ("horizontal_m", "vertical_m", "wide_m"),
    [
        (0.7, 1.0, 0.7),
        (0.1, 1.8, 0.9),
        (1.5, 1.0, 2.0),
        (np.nan, 2.4, 1.4),
        (1.5, np.nan, 2.0),
        (9.0, 1.0, 3.0),
        (np.inf, 0.1, 3.0),
    ],
)
def test_accuracy_counts_twice_beyond_1_m_up_to_the_cap(
    horizontal_m: float, vertical_m: float, wide_m: float
) -> None:
    assert one(horizontal_m, vertical_m, 6.0) == pytest.approx(wide_m)


def test_vehicle_that_reports_nothing_is_as_configured() -> None:
    assert one(np.nan, np.nan, np.nan) == 0.3


def test_after_a_jump_it_is_wider_for_a_while() -> None:
    assert one(0.9, 1.8, 6.0, 0.0) == one(0.9, 1.8, 6.0, 29.9) == pytest.approx(1.1)
    assert one(0.9, 1.8, 6.0, 30.0) == 0.9


@given(
    ACCURACY_M, ACCURACY_M, ACCURACY_M, ACCURACY_M, st.sampled_from(WORST_FIRST), st.sampled_from(WORST_FIRST)
)
def test_no_margin_shrinks_when_accuracy_or_fix_worsens(
    horizontal_m: float, worse_m: float, vertical_m: float, worse_up_m: float, fix: float, other: float
) -> None:
    better = one(min(horizontal_m, worse_m), min(vertical_m, worse_up_m), max(fix, other))
    worse = one(max(horizontal_m, worse_m), max(vertical_m, worse_up_m), min(fix, other))
    assert 0.05 <= better <= worse <= 3.0


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.floats(0.1, 2.0))
def test_accuracy_accepted_on_the_ground_is_what_the_cap_means(
    poor_m: float, most_m: float, share: float
) -> None:
    given = Positioning(poor_m=poor_m, uncertainty_max_m=most_m, share=share)
    reported_m = given.accepted_m * np.array([0.99, 1.0])
    unknown, never = np.full(2, np.nan), np.full(2, NEVER)
    below_m, at_m = uncertainty_m(0.0, 2.0, reported_m, unknown, unknown, never, given)
    assert below_m < most_m == pytest.approx(at_m)


@given(st.lists(st.floats(0.01, 5.0), min_size=4, max_size=4))
def test_a_worse_kind_of_fix_is_never_configured_better(least_m: list[float]) -> None:
    fixed_m, float_m, dgps_m, fix_3d_m = least_m
    given = Positioning(rtk_fixed_m=fixed_m, rtk_float_m=float_m, dgps_m=dgps_m, fix_3d_m=fix_3d_m)
    assert (np.diff(given.least_by_type_m[np.array(WORST_FIRST[3:], int)]) <= 0.0).all()
