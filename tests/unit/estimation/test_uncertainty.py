"""A margin is never less than configured, wider for a poor fix and after a jump, and capped."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.fleet_state import Positioning, uncertainty_m

P = Positioning()
NEVER = np.inf


def one(horizontal_m: float, vertical_m: float, since_s: float = NEVER, configured_m: float = 0.35) -> float:
    wide_m = uncertainty_m(
        configured_m, np.array([horizontal_m]), np.array([vertical_m]), np.array([since_s]), P
    )
    return float(wide_m[0])


def test_usual_or_unreported_accuracy_has_configured_margin() -> None:
    assert one(0.9, 1.78) == one(np.nan, np.nan) == one(0.0, 0.0) == 0.35


@pytest.mark.parametrize(
    ("horizontal_m", "vertical_m", "wide_m"),
    [(2.0, 1.0, 0.75), (1.0, 4.0, 0.75), (np.nan, 4.0, 0.75), (9.0, 1.0, 1.5), (np.inf, np.inf, 1.5)],
)
def test_worse_accuracy_widens_the_margin_up_to_the_cap(
    horizontal_m: float, vertical_m: float, wide_m: float
) -> None:
    assert one(horizontal_m, vertical_m) == pytest.approx(wide_m)


def test_after_a_jump_the_margin_is_wider_for_a_while() -> None:
    assert one(0.9, 1.8, 0.0) == one(0.9, 1.8, 29.9) == pytest.approx(1.05)
    assert one(0.9, 1.8, 30.0) == 0.35


def test_margin_configured_above_the_cap_stays() -> None:
    assert one(9.0, 9.0, 0.0, configured_m=2.0) == 2.0


@given(
    st.floats(0.0, 5.0),
    st.floats(width=32),
    st.floats(width=32),
    st.floats(allow_nan=False, allow_infinity=True),
)
def test_no_report_makes_the_margin_smaller_or_infinite(
    configured_m: float, horizontal_m: float, vertical_m: float, since_s: float
) -> None:
    assert configured_m <= one(horizontal_m, vertical_m, since_s, configured_m) <= max(configured_m, 1.5)
