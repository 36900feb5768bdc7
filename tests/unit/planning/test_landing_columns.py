"""Who stands above whom."""

import numpy as np
import pytest

from gcs.planning.landing_sites import column_m, describe_columns, most_overlapping, overlapping
from gcs.safety.floor import Floor

PLACES_M = np.array([(0.0, 0.0, -10.0), (1.0, 0.0, -20.0), (10.0, 0.0, -15.0), (10.0, 0.5, -8.0)])


def test_pairs_are_upper_first_and_nearest_first() -> None:
    pairs, apart_m = overlapping(PLACES_M, 2.0)
    assert pairs.tolist() == [[2, 3], [1, 0]]
    assert apart_m == pytest.approx([0.5, 1.0])


def test_without_vertical_overlap_there_is_no_pair() -> None:
    pairs, apart_m = overlapping(PLACES_M, 0.4)
    assert (len(pairs), len(apart_m)) == (0, 0)
    assert len(overlapping(np.zeros((0, 3)), 2.0)[0]) == 0


@pytest.mark.parametrize(("count", "most"), [(0, 0), (1, 0), (2, 1), (3, 3)])
def test_in_a_line_all_may_overlap_in_any_direction(count: int, most: int) -> None:
    line_m = 5.0 * np.arange(count)[:, None] * np.array([[0.6, 0.0, 0.8]])
    assert most_overlapping(line_m, 2.0) == most


def test_overlaps_never_exceed_the_predicted_most() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        place_m = random.normal(size=(10, 3))
        place_m *= 8.0 / np.linalg.norm(place_m, axis=1, keepdims=True)
        turned_m = place_m @ np.linalg.qr(random.normal(size=(3, 3)))[0]
        assert len(overlapping(turned_m, 2.5)[0]) <= most_overlapping(place_m, 2.5 + 0.8)


def test_overlap_is_described_and_silent_when_there_is_none() -> None:
    assert describe_columns(0) == ""
    assert "up to 3 pairs in the formation are stacked:" in describe_columns(3)
    assert "pairs in the formation are stacked (in the show's check a above b):" in describe_columns(
        3, ["a above b"]
    )
    many = describe_columns(3, [f"{n} above {n + 1}" for n in range(12)])
    assert "up to 12 pairs" in many
    assert "9 above 10, others)" in many


def test_column_is_as_wide_as_passing_separation() -> None:
    floor = Floor(horizontal_m=2.0, margin_m=0.25, uncertainty_m=0.0, deviations=2.0)
    assert column_m(floor) == 2.25
    assert column_m(floor, np.array([0.4, 0.1, 0.3])) == 3.25
