"""A fresh position that contradicts what else is known is not believed, and an honest one always is."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.estimation.contradictions import Contradictions, Doubt
from gcs.model.state import Array
from gcs.sim.vehicle.sensors import draw_errors, step_errors

TICK_S = 0.05
DIGITS_M = np.array([0.011, 0.011, 0.001])
"""The last digits of GLOBAL_POSITION_INT."""

Motion = Callable[[float], Array]


class Reports:
    """One vehicle that reports ten times a second; `doubt` is of the newest tick."""

    def __init__(self) -> None:
        self.found = Contradictions(1)
        self.now_s = 0.0
        self.doubts: list[Doubt] = []

    def hear(
        self,
        position_m: Array,
        velocity_m_s: Array,
        asked_m_s: Array | None,
        *,
        armed: bool = True,
        late_s: float = 0.0,
    ) -> None:
        """One message, and two ticks."""
        position_m = np.round(position_m / DIGITS_M) * DIGITS_M
        asked = np.full((1, 3), np.nan) if asked_m_s is None else asked_m_s[np.newaxis]
        here = position_m[np.newaxis], velocity_m_s[np.newaxis], np.array([self.now_s])
        reported = *here, np.array([armed]), np.array([late_s])
        for _ in range(2):
            self.found.look(self.now_s, reported, asked)
            self.now_s += TICK_S
        self.doubts.append(Doubt(int(self.found.doubts[0])))

    def first(self, doubt: Doubt) -> float:
        """Seconds until it was in doubt for this reason, and for no other before."""
        at = self.doubts.index(doubt)
        assert set(self.doubts[:at]) <= {Doubt.NONE}
        return 2 * TICK_S * (at + 1)


ALONG = np.array([0.6, -0.8, 0.0])


def honest(reports: Reports, seconds: float, speed_m_s: float) -> None:
    """Fly straight on for so long."""
    for _ in range(round(seconds / (2 * TICK_S))):
        reports.hear(reports.now_s * speed_m_s * ALONG, speed_m_s * ALONG, speed_m_s * ALONG)
    assert set(reports.doubts) == {Doubt.NONE}
    reports.doubts.clear()


@pytest.mark.parametrize("speed_m_s", [0.6, 1.5, 4.0])
def test_position_that_stands_is_found_by_the_velocity(speed_m_s: float) -> None:
    reports = Reports()
    honest(reports, 3.0, speed_m_s)
    here_m = reports.now_s * speed_m_s * ALONG
    for _ in range(20):
        reports.hear(here_m, speed_m_s * ALONG, None)
    assert reports.first(Doubt.STANDS) < 0.55


@pytest.mark.parametrize("speed_m_s", [1.0, 4.0])
def test_position_that_stands_is_found_by_setpoints(speed_m_s: float) -> None:
    reports, here_m = Reports(), np.array([3.0, 4.0, -20.0])
    for _ in range(20):
        reports.hear(here_m, np.zeros(3), np.zeros(3))
    for _ in range(20):
        reports.hear(here_m, np.zeros(3), speed_m_s * ALONG)
    assert reports.first(Doubt.STANDS_COMMANDED) <= 2.0 + 1.1


@pytest.mark.parametrize("speed_m_s", [1.0, 2.0, 4.0])
def test_velocity_of_the_wrong_sign_is_found(speed_m_s: float) -> None:
    reports = Reports()
    honest(reports, 3.0, speed_m_s)
    for _ in range(20):
        reports.hear(reports.now_s * speed_m_s * ALONG, -speed_m_s * ALONG, None)
    assert reports.first(Doubt.STRAYS) <= 1.3


@pytest.mark.parametrize(("late_s", "doubt"), [(0.5, Doubt.NONE), (0.7, Doubt.LATE)])
def test_late_position_is_doubted_until_it_is_prompt(late_s: float, doubt: Doubt) -> None:
    reports = Reports()
    honest(reports, 1.0, 2.0)
    for late in (late_s, 0.4, 0.2):
        reports.hear(reports.now_s * 2.0 * ALONG, 2.0 * ALONG, None, late_s=late)
    assert reports.doubts == [doubt, doubt, Doubt.NONE]


def test_vehicle_that_stands_still_is_believed() -> None:
    reports, here_m = Reports(), np.array([3.0, 4.0, -20.0])
    for _ in range(600):
        reports.hear(here_m, np.zeros(3), np.zeros(3))
    assert set(reports.doubts) == {Doubt.NONE}


def test_vehicle_on_the_ground_is_not_judged() -> None:
    reports, here_m = Reports(), np.array([3.0, 4.0, 0.0])
    for _ in range(50):
        reports.hear(here_m, ALONG, None, armed=False)
    assert set(reports.doubts) == {Doubt.NONE}


def test_what_stood_is_believed_once_it_moves_again() -> None:
    reports = Reports()
    honest(reports, 3.0, 2.0)
    here_m = reports.now_s * 2.0 * ALONG
    for _ in range(10):
        reports.hear(here_m, 2.0 * ALONG, None)
    reports.hear(here_m, np.zeros(3), None)
    assert reports.doubts[-1] is Doubt.STANDS, "it has not moved"
    for _ in range(10):
        reports.hear(reports.now_s * 2.0 * ALONG, 2.0 * ALONG, None)
    assert reports.doubts[-10:] == [Doubt.NONE] * 10


def test_a_jump_is_no_drift() -> None:
    reports = Reports()
    honest(reports, 3.0, 2.0)
    for _ in range(30):
        reports.hear(reports.now_s * 2.0 * ALONG + np.array([0.0, 4.0, 0.0]), 2.0 * ALONG, None)
    assert set(reports.doubts) == {Doubt.NONE}


@given(st.integers(0, 10_000), st.floats(0.0, 8.0), st.floats(0.2, 3.0), st.floats(0.0, 2.0))
def test_recorded_errors_are_no_contradiction(
    seed: int, speed_m_s: float, turn_s: float, scale: float
) -> None:
    """On circles at up to 8 m/s, with up to twice the errors recorded of PX4's estimates."""
    random, reports = np.random.default_rng(seed), Reports()
    errors = draw_errors(1, scale, random)
    rate_rad_s = min(1.0 / turn_s, 4.0 / max(speed_m_s, 0.1))  # up to 4 m/s^2
    for _ in range(300):
        errors = step_errors(errors, 2 * TICK_S, scale, random)
        angle = rate_rad_s * reports.now_s
        around = np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
        position_m = speed_m_s / rate_rad_s * around + errors.position_m[0]
        velocity_m_s = speed_m_s * np.array([np.cos(angle), np.sin(angle), 0.0])
        reports.hear(position_m, velocity_m_s + errors.velocity_m_s[0], velocity_m_s)
    assert set(reports.doubts) == {Doubt.NONE}
