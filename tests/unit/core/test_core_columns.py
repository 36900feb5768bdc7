"""Who stands above whom."""

import numpy as np
import pytest

from gcs.columns import NAMED_MAX, column_m, overlapping, told
from gcs.safety.separation import Floor

PLACES_M = np.array([(0.0, 0.0, -10.0), (1.0, 0.0, -20.0), (10.0, 0.0, -15.0), (10.0, 0.5, -8.0)])


def test_pairs_are_found_upper_first_and_the_nearest_first() -> None:
    pairs, apart_m = overlapping(PLACES_M, 2.0)
    assert pairs.tolist() == [[2, 3], [1, 0]]
    assert apart_m == pytest.approx([0.5, 1.0])
    assert told(("a", "b", "c", "d"), pairs).startswith(
        "columns overlap in the formation: c above d, b above a;"
    )


def test_where_nobody_stands_above_another_nothing_is_told() -> None:
    pairs, apart_m = overlapping(PLACES_M, 0.4)
    assert (len(pairs), len(apart_m), told((), pairs)) == (0, 0, "")
    assert len(overlapping(np.zeros((0, 3)), 2.0)[0]) == 0


def test_of_many_pairs_the_nearest_are_named() -> None:
    stack_m = np.column_stack([np.linspace(0.0, 1.0, 6), np.zeros(6), -4.0 * np.arange(6)])
    pairs, _ = overlapping(stack_m, 3.0)
    words = told([f"d{i}" for i in range(6)], pairs)
    assert words.count(" above ") == NAMED_MAX
    assert f"{len(pairs) - NAMED_MAX} pairs more" in words


def test_a_column_is_as_wide_as_two_that_pass_keep_apart() -> None:
    assert column_m(Floor(horizontal_m=2.0, vertical_m=3.0, uncertainty_m=0.5, margin_m=0.25)) == 3.25
