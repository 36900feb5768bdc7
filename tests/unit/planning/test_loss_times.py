"""Vehicles that would stop at different times if all lost the ground station at once: START is refused."""

import numpy as np
import pytest

from gcs.model.errors import RefusedError
from gcs.planning.loss_times import APART_MAX_S, check_loss_times

IDS = ("d1", "d2", "d3", "d4")


@pytest.mark.parametrize("apart_s", [0.0, 0.05, 0.99 * APART_MAX_S])
def test_equal_loss_times_pass(apart_s: float) -> None:
    check_loss_times(IDS, 1.0 + np.array([0.0, apart_s, 0.0, apart_s]))
    check_loss_times((), np.zeros(0))


def test_different_loss_times_are_named_with_their_vehicles() -> None:
    with pytest.raises(RefusedError) as refused:
        check_loss_times(IDS, np.array([1.0, 3.0, 1.0, 3.0]))
    text = str(refused.value)
    assert text.startswith("without setpoints d2, d4 for 3 s, d1, d3 for 1 s fly on before they stop")
    assert "operation.setpoint_loss_s" in text
    assert "3 s is the longest now" in text
    assert "gcs params apply" in text


def test_loss_times_of_other_stations_count() -> None:
    with pytest.raises(RefusedError, match="other stations' vehicles for 1 s"):
        check_loss_times(("d1", "d2"), np.array([3.0, 3.0]), elsewhere_s=1.0)
    check_loss_times(("d1", "d2"), np.array([3.0, 3.0]), elsewhere_s=3.0)


def test_many_vehicles_are_counted_not_listed() -> None:
    ids = tuple(f"d{number}" for number in range(1, 13))
    with pytest.raises(RefusedError, match=r"d2, .*d9 and 3 more for 1 s"):
        check_loss_times(ids, np.array([3.0, *[1.0] * 11]))
