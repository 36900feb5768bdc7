"""Links that are late, and clocks that only run at another rate."""

from collections.abc import Callable

import numpy as np
import pytest

from gcs.estimation.link_delay import LinkDelay

LIMIT_S = 0.2
"""`failsafes.links_late.late_s`."""

NO_ANSWER = np.array([np.nan])


def latest_s(
    rate: float, seconds: float, delay_s: Callable[[float], float] = lambda _: 0.0, seed: int = 1
) -> tuple[LinkDelay, float]:
    """A vehicle that sends its clock once a second over a link with some milliseconds of jitter.

    Returns: the estimate, and the greatest delay that it named.
    """
    random, link, greatest_s = np.random.default_rng(seed), LinkDelay(1), 0.0
    for step in range(int(seconds)):
        sent_s = 100.0 + step
        arrived_s = sent_s + delay_s(sent_s - 100.0) + random.exponential(0.004)
        link.note(np.array([1.7e9 + (1.0 + rate) * sent_s - arrived_s]), NO_ANSWER, arrived_s)
        greatest_s = max(greatest_s, float(link.late_s[0]))
    return link, greatest_s


@pytest.mark.parametrize("rate", [-0.02, -0.016, -0.005, 0.01])
def test_a_clock_with_a_constant_rate_is_no_delay(rate: float) -> None:
    """A simulator on a busy machine loses 1 to 2 % against the wall clock."""
    link, _ = latest_s(rate, 40.0)
    assert link.rate[0] == pytest.approx(rate, abs=0.002)
    before_s = float(link.late_s[0])
    link, greatest_s = latest_s(rate, 600.0)
    assert link.late_s[0] < 0.02
    assert greatest_s < 0.6, "only until its rate is known, which takes 20 s"
    assert before_s < 0.1


@pytest.mark.parametrize("rate", [0.0, -0.016])
def test_a_link_that_becomes_late_is_late(rate: float) -> None:
    link, _ = latest_s(rate, 120.0, lambda since_s: 0.5 if since_s > 90.0 else 0.0)
    assert link.late_s[0] > LIMIT_S
    link, _ = latest_s(rate, 110.0, lambda since_s: 0.5 if since_s > 90.0 else 0.0)
    assert link.late_s[0] == pytest.approx(0.5, abs=0.1)


def test_a_link_that_fills_up_steadily_is_late() -> None:
    """At 2 % more than a radio can carry the delay grows on a line as well, but not from the start on."""
    link, _ = latest_s(0.0, 120.0, lambda since_s: 0.02 * max(since_s - 60.0, 0.0))
    assert link.rate[0] == 0.0
    assert link.late_s[0] > 1.0


def test_a_simulators_rate_may_change_with_the_load() -> None:
    link, greatest_s = latest_s(-0.005, 200.0, lambda since_s: 0.012 * max(since_s - 100.0, 0.0))
    assert link.late_s[0] < 0.05
    assert greatest_s < LIMIT_S


def test_a_vehicle_set_to_another_time_begins_anew() -> None:
    link = LinkDelay(1)
    for step in range(60):
        arrived_s = 100.0 + step
        ahead_s = 1000.0 if step > 30 else 0.0
        link.note(np.array([1.7e9 + ahead_s - 0.02 * step]), NO_ANSWER, arrived_s)
        assert link.late_s[0] < 0.6
    assert link.rate[0] == pytest.approx(-0.02, abs=0.002)


def test_rows_do_not_mix() -> None:
    link = LinkDelay(3)
    for step in range(60):
        now_s = 100.0 + step
        delay_s = 0.5 if step > 40 else 0.0
        link.note(
            np.array([1.7e9 - 0.016 * step, 1.7e9 - delay_s + 1e-6 * step, np.nan]), np.full(3, np.nan), now_s
        )
    assert link.rate.tolist() == [pytest.approx(-0.016, abs=1e-4), 0.0, 0.0]
    assert link.late_s.tolist() == [pytest.approx(0.0, abs=0.02), pytest.approx(0.5, abs=0.01), 0.0]


def test_constant_delay_is_half_of_the_soonest_answer() -> None:
    """0.12 s each way: nothing in the clock shows it. Some answers wait for telemetry on the way."""
    random, link = np.random.default_rng(2), LinkDelay(2)
    for step in range(30):
        answers_s = np.array([0.24 + random.exponential(0.05), np.nan])
        link.note(np.full(2, 1.7e9), answers_s, float(step))
    assert link.delay_s[0] == pytest.approx(0.12, abs=0.02)
    assert link.delay_s[1] == 0.0, "an autopilot that does not answer"
    assert (link.late_s == 0.0).all()


def test_link_that_becomes_slower_counts_once() -> None:
    """By its clock within seconds, then by its answers too: 0.05 s before, 0.2 s after."""
    link = LinkDelay(1)
    for step in range(60):
        one_way_s = 0.05 if step < 30 else 0.2
        link.note(
            np.array([1.7e9 - one_way_s + 1e-7 * step]),
            np.array([2.0 * one_way_s + 1e-7 * step]),
            float(step),
        )
        if step == 29:
            assert link.delay_s[0] == pytest.approx(0.05, abs=0.01)
        if step == 36:
            assert link.delay_s[0] > 0.15
    assert link.delay_s[0] == pytest.approx(0.2, abs=0.02)
