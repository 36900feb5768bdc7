"""Straight ways over the ground, and the edges of areas that they meet."""

import numpy as np
import pytest

from gcs.model.state import Array
from gcs.planning.return_paths.within_areas import cross_edges
from gcs.safety.fenced_areas import FencedArea


def crossing(one_m: Array, other_m: Array, corner_m: Array) -> bool:
    """Whether the line meets an edge, by the sides on which the ends of each lie."""

    def side(a_m: Array, b_m: Array, c_m: Array) -> float:
        (ax, ay), (bx, by) = b_m - a_m, c_m - a_m
        return float(ax * by - ay * bx)

    edges = zip(corner_m, np.roll(corner_m, -1, axis=0), strict=True)
    return any(
        side(one_m, other_m, a_m) * side(one_m, other_m, b_m) < 0.0
        and side(a_m, b_m, one_m) * side(a_m, b_m, other_m) < 0.0
        for a_m, b_m in edges
    )


@pytest.mark.parametrize("away_m", [0.0, 5000.0])
def test_every_way_across_an_edge_is_seen(away_m: float) -> None:
    """Of ways through the gap of a U some counted as within it: they are 1e-16 m from its edges."""
    random = np.random.default_rng(4)
    outer_m, inner_m = [(-6, 46), (-6, -6), (26, -6), (26, 46)], [(14, 46), (14, 6), (6, 6), (6, 46)]
    u_m = away_m + 1.7 * np.array(outer_m + inner_m)
    area = FencedArea(corners_m=tuple((float(x_m), float(y_m)) for x_m, y_m in u_m))
    ends_m = away_m + random.uniform(-20.0, 90.0, (2, 400, 3))
    expected = [crossing(one_m[:2], other_m[:2], u_m) for one_m, other_m in zip(*ends_m, strict=True)]
    assert 100 < sum(expected) < 390
    assert cross_edges([area], *ends_m).tolist() == expected
