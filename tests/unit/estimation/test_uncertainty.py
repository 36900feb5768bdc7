"""A position is as uncertain as its receiver reports, no less than its kind of fix can mean, and capped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.positioning import LEAST_M, SHARE_3D, Positioning, uncertainty_m
from gcs.model.state import Array
from gcs.safety.floor import Floor

P = Positioning()
FLOOR = Floor()
NEVER = np.inf
WORST_FIRST = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ACCURACY_M = st.floats(0.0, 20.0) | st.just(np.inf)


def fleet(*reported: tuple[float, float, float], given: Positioning = P) -> Array:
    """Of vehicles that report an accuracy sideways, up, and a fix."""
    accuracy_m, up_m, fix = np.array(reported).T.copy()
    return uncertainty_m(0.3, 2.0, accuracy_m, up_m, fix, given)


def one(horizontal_m: float, vertical_m: float, fix_type: float) -> float:
    return float(fleet((horizontal_m, vertical_m, fix_type))[0])


def after_jumps(usual_m: Array, since_s: float, *jumped_m: float) -> Array:
    since = np.full(len(usual_m), since_s)
    return P.after_jumps_m(usual_m, since, np.array(jumped_m), FLOOR.deviations)


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
    usual_m = np.array([0.9])
    assert after_jumps(usual_m, 0.0, 0.5) == after_jumps(usual_m, 29.9, 0.5) == pytest.approx(1.1)
    assert after_jumps(usual_m, 30.0, 0.5) == after_jumps(usual_m, NEVER, 9.0) == 0.9
    assert after_jumps(usual_m, 0.0, 99.0) == P.uncertainty_max_m


@given(st.floats(0.05, 1.0), st.floats(0.05, 1.0), st.floats(0.0, 8.0))
def test_margin_of_a_pair_grows_by_the_jump_of_one(jumper_m: float, other_m: float, jumped_m: float) -> None:
    usual_m = np.array([jumper_m, other_m])
    wide_m = after_jumps(usual_m, 0.0, jumped_m, 0.0)
    grown_m = FLOOR.reserve_m(*wide_m) - FLOOR.reserve_m(*usual_m)
    assert grown_m >= jumped_m - 1e-9


@given(
    ACCURACY_M, ACCURACY_M, ACCURACY_M, ACCURACY_M, st.sampled_from(WORST_FIRST), st.sampled_from(WORST_FIRST)
)
def test_no_margin_shrinks_when_accuracy_or_fix_worsens(
    horizontal_m: float, worse_m: float, vertical_m: float, worse_up_m: float, fix: float, other: float
) -> None:
    good = (min(horizontal_m, worse_m), min(vertical_m, worse_up_m), max(fix, other))
    bad = (max(horizontal_m, worse_m), max(vertical_m, worse_up_m), min(fix, other))
    better, worse = fleet(good, bad)  # one fleet has one share
    assert 0.05 <= better <= worse <= 3.0


@given(st.floats(0.1, 5.0), st.floats(0.1, 5.0), st.none() | st.floats(0.1, 2.0), st.sampled_from((3.0, 5.0)))
def test_accuracy_accepted_on_the_ground_is_what_the_cap_means(
    poor_m: float, most_m: float, share: float | None, fix_type: float
) -> None:
    least = dict.fromkeys(LEAST_M, 0.01)
    given = Positioning(poor_m=poor_m, uncertainty_max_m=most_m, share=share, **least)
    fix = np.full(2, fix_type)
    reported_m = given.accepted_m(fix) * np.array([0.99, 1.0])
    below_m, at_m = uncertainty_m(0.0, 2.0, reported_m, np.full(2, np.nan), fix, given)
    assert below_m < most_m == pytest.approx(at_m)


def test_receivers_without_corrections_share_most_of_their_error() -> None:
    reported_m, beyond_m = 1.8, SHARE_3D * 1.8 - 1.0
    assert fleet((reported_m, 1.0, 3.0), (reported_m, 1.0, 3.0)) == pytest.approx([1.0 + 2 * beyond_m] * 2)
    assert fleet((0.9, 1.78, 3.0)) == 1.0, "what a 3D fix can mean at least is each receiver's own"


def test_corrections_leave_an_error_that_is_not_common() -> None:
    uncorrected = (1.8, 1.0, 3.0)
    assert fleet(uncorrected, (0.02, 0.04, 6.0)) == pytest.approx([2.6, 0.05])
    assert fleet(uncorrected, (np.nan, np.nan, np.nan))[0] < 2.0, "nothing reported is no correction"


def test_a_configured_share_holds_for_every_kind_of_fix() -> None:
    given = Positioning(share=0.25, fix_3d_m=0.2)
    assert fleet((0.9, 1.78, 3.0), (0.9, 0.4, 6.0), given=given) == pytest.approx([0.225, 0.225])


@given(st.lists(st.none() | st.floats(0.01, 3.0), min_size=4, max_size=4))
def test_a_configured_accuracy_is_what_it_says(least_m: list[float | None]) -> None:
    configured = sorted(value for value in least_m if value is not None)
    values = [None if value is None else configured.pop(0) for value in least_m]
    given = Positioning.model_validate(dict(zip(LEAST_M, values, strict=True)))
    best_first_m = given.least_by_type_m[[6, 5, 4, 3]]
    assert (np.diff(best_first_m) >= 0.0).all(), "a worse fix is no better"
    assert all(value in (None, used_m) for value, used_m in zip(values, best_first_m, strict=True))
    assert Positioning.model_validate(given.model_dump()) == given


def test_of_px4s_simulator_a_configured_3d_fix_counts() -> None:
    assert Positioning(fix_3d_m=0.2).least_by_type_m[[6, 5, 4, 3]] == pytest.approx([0.05, 0.2, 0.2, 0.2])
    assert Positioning(rtk_float_m=0.7).least_by_type_m[[6, 5, 4, 3]] == pytest.approx([0.05, 0.7, 0.7, 1.0])


def test_contradiction_names_both_keys() -> None:
    with pytest.raises(
        ValueError, match=r"rtk_fixed_m is 0\.5 and fix_3d_m 0\.2: .*lower rtk_fixed_m or raise fix_3d_m"
    ):
        Positioning(rtk_fixed_m=0.5, fix_3d_m=0.2)
    with pytest.raises(ValueError, match=r"fix_3d_m is 5, .*lower fix_3d_m or raise uncertainty_max_m"):
        Positioning(fix_3d_m=5.0)
