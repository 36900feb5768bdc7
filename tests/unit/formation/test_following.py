"""How the centre closes the distance to a target that is known well or badly."""

import numpy as np
import pytest

from gcs.formation.following import KNOWN_M_S, closing_velocity

AGILE_M_S2 = 3.0


def closed_m_s(away_m: float, deviation_m_s: float) -> float:
    return float(closing_velocity(np.array([away_m, 0.0]), AGILE_M_S2, deviation_m_s)[0])


def test_small_distance_from_a_doubtful_target_is_closed_slowly() -> None:
    """What its next report corrects is not worth an acceleration."""
    assert closed_m_s(0.2, 3.0 * KNOWN_M_S) < 0.5 * closed_m_s(0.2, KNOWN_M_S)


@pytest.mark.parametrize("away_m", [0.1, 1.0, 3.0, 10.0, 100.0])
@pytest.mark.parametrize("doubt", [1.5, 3.0, 10.0])
def test_doubtful_target_is_closed_no_faster_than_a_known_one(away_m: float, doubt: float) -> None:
    assert closed_m_s(away_m, doubt * KNOWN_M_S) <= closed_m_s(away_m, KNOWN_M_S)


def test_distance_beyond_doubt_is_closed_faster() -> None:
    near_m, far_m, doubtful_m_s = 0.1, 4.0, 3.0 * KNOWN_M_S
    slowly, faster = (closed_m_s(away_m, doubtful_m_s) / away_m for away_m in (near_m, far_m))
    assert faster > 1.7 * slowly
