"""From where a vehicle descends slowly, and when it stands on something, whatever its height says."""

import numpy as np
import pytest

from gcs.estimation.touch_down import LEAST_M, MOST_M, STANDS_S, GroundContact, height_error_m
from gcs.model.state import Landed

TICK_S = 0.05


@pytest.mark.parametrize(
    ("accuracy_m", "departed_m", "error_m"),
    [
        (0.02, 0.0, LEAST_M),
        (0.02, 3.4, 3.4),
        (0.02, -4.0, LEAST_M),  # it is higher than it reports: that harms nothing
        (1.78, 0.0, 3.56),
        (1.78, 4.0, 4.0),
        (np.nan, 3.4, 3.4),
        (1.78, np.nan, 3.56),
        (np.nan, np.nan, LEAST_M),
        (np.inf, 0.0, MOST_M),
    ],
)
def test_the_greater_doubt_counts(accuracy_m: float, departed_m: float, error_m: float) -> None:
    assert height_error_m(np.array([accuracy_m]), np.array([departed_m])) == pytest.approx([error_m])


def stood_after_s(
    desired_m_s: float, sinks_m_s: float, *, delay_s: float = 0.0, landed: Landed = Landed.IN_AIR
) -> float | None:
    contact = GroundContact()
    for tick in range(100):
        if contact.note(tick * TICK_S, desired_m_s, sinks_m_s, delay_s, landed):
            return tick * TICK_S
    return None


def test_a_vehicle_that_does_not_sink_stands() -> None:
    assert stood_after_s(0.4, 0.03) == pytest.approx(STANDS_S, abs=TICK_S)
    assert stood_after_s(1.4, 0.03, delay_s=0.5) == pytest.approx(STANDS_S + 1.0, abs=TICK_S)


@pytest.mark.parametrize(
    ("desired_m_s", "sinks_m_s"),
    [(0.4, 0.38), (1.4, 0.5), (0.0, 0.0), (-1.0, 0.0), (np.nan, 0.0), (0.4, np.nan)],
)
def test_one_that_sinks_or_need_not_does_not_stand(desired_m_s: float, sinks_m_s: float) -> None:
    assert stood_after_s(desired_m_s, sinks_m_s) is None


def test_the_landed_state_counts_at_once() -> None:
    assert stood_after_s(1.4, 1.4, landed=Landed.ON_GROUND) == 0.0


def test_a_moment_without_sinking_is_no_contact() -> None:
    contact = GroundContact()
    stands = [
        contact.note(tick * TICK_S, 1.0, 0.0 if tick % 10 else 1.0, 0.0, Landed.IN_AIR) for tick in range(100)
    ]
    assert not any(stands)
