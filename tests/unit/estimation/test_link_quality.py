import numpy as np
import pytest

from gcs.estimation.link_health import LinkQuality


def shares_after(arrive: float, seconds: float, seed: int = 3) -> float:
    """Ticks at 20 Hz, positions at 10 Hz, of which `arrive` (0 to 1) come."""
    random, quality = np.random.default_rng(seed), LinkQuality(np.array([10.0, 10.0]))
    newest_s = np.array([-np.inf, -np.inf])
    for tick in range(round(seconds * 20)):
        now_s = 100.0 + tick / 20
        if tick % 2 == 0 and random.random() < arrive:
            newest_s = np.array([now_s, -np.inf])
        quality.note(newest_s, now_s)
    assert quality.share[1] == 0.0, "of one that is never received"
    return float(quality.share[0])


@pytest.mark.parametrize(("arrive", "share"), [(1.0, 1.0), (0.5, 0.5), (0.0, 0.0)])
def test_link_quality_is_the_share_of_positions_that_arrive(arrive: float, share: float) -> None:
    assert shares_after(arrive, 60.0) == pytest.approx(share, abs=0.25 if arrive == 0.5 else 0.06)


def test_a_good_link_is_good_from_its_first_second_on() -> None:
    assert min(shares_after(1.0, seconds) for seconds in (1.0, 2.0, 5.0)) > 0.9


def test_falls_when_a_vehicle_is_silent_and_never_exceeds_one() -> None:
    quality = LinkQuality(np.array([5.0]))
    for tick in range(400):
        quality.note(np.array([tick / 20]), tick / 20)
    assert quality.share[0] == 1.0
    for tick in range(400, 800):
        quality.note(np.array([399 / 20]), tick / 20)
    assert 0.0 < quality.share[0] < 0.1


def test_tick_of_zero_length_changes_nothing() -> None:
    quality = LinkQuality(np.array([10.0]))
    quality.note(np.array([0.0]), 0.0)
    quality.note(np.array([0.1]), 0.0)
    assert quality.share[0] == 0.0
