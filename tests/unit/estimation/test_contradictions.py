"""A fresh position that contradicts what else is known is not believed, and an honest one always is."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Final

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

DATA: Final = Path(__file__).parents[2] / "data"

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
        clock_s: float | None = None,
        accuracy_m: float = np.nan,
    ) -> None:
        """One message, and two ticks."""
        position_m = np.round(position_m / DIGITS_M) * DIGITS_M
        asked = np.full((1, 3), np.nan) if asked_m_s is None else asked_m_s[np.newaxis]
        here = position_m[np.newaxis], velocity_m_s[np.newaxis], np.array([self.now_s])
        clock_s = self.now_s if clock_s is None else clock_s
        dated = np.array([late_s]), np.array([clock_s]), np.array([accuracy_m])
        reported = *here, np.array([armed]), *dated
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


@pytest.mark.parametrize("along", [ALONG, np.array([0.0, 0.0, 1.0])], ids=["level", "up"])
@pytest.mark.parametrize(("drift_m_s", "led_m"), [(0.5, 6.6), (0.7, 5.0), (1.0, 4.3), (2.0, 4.0)])
def test_slow_drift_from_the_velocity_is_found(drift_m_s: float, led_m: float, along: Array) -> None:
    reports = Reports()
    honest(reports, 3.0, 2.0)
    began_s = reports.now_s
    for _ in range(200):
        flown_m = reports.now_s * 2.0 * ALONG
        reports.hear(flown_m + (reports.now_s - began_s) * drift_m_s * along, 2.0 * ALONG, 2.0 * ALONG)
    assert reports.first(Doubt.STRAYS) * drift_m_s <= led_m


def test_drift_that_a_poor_receiver_explains_is_believed() -> None:
    reports = Reports()
    for _ in range(300):
        reports.hear(reports.now_s * 0.6 * ALONG, np.zeros(3), np.zeros(3), accuracy_m=2.0)
    assert set(reports.doubts) == {Doubt.NONE}


@pytest.mark.parametrize("name", ["vx-5", "vx1", "vx5", "vx10", "vy5"])
@pytest.mark.parametrize("every", [3, 6, 10])
def test_steps_of_a_real_px4_are_no_contradiction(name: str, every: int) -> None:
    """Recorded with a receiver without corrections, in steps of up to 10 m/s."""
    with gzip.open(DATA / "px4" / f"step_{name}.csv.gz", "rt") as lines:
        recorded = np.loadtxt(lines, delimiter=",", skiprows=1)[::every]
    judged = Contradictions(1)
    for sample in recorded:
        at_s = sample[:1]
        here = sample[np.newaxis, 1:4], sample[np.newaxis, 4:7], at_s, np.array([True])
        judged.look(float(at_s[0]), (*here, np.zeros(1), at_s, np.full(1, 0.9)), np.full((1, 3), np.nan))
        assert judged.doubts[0] == Doubt.NONE


@pytest.mark.parametrize("speed_m_s", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_axis_that_stands_against_setpoints_is_found(axis: int, speed_m_s: float) -> None:
    """The other two go where they should, and the velocity agrees with what it reports."""
    reports, along = Reports(), np.array([0.6, 0.6, 0.5])
    moves = np.where(np.arange(3) == axis, 0.0, along)
    for _ in range(60):
        reports.hear(reports.now_s * speed_m_s * moves, speed_m_s * moves, speed_m_s * along)
    assert reports.first(Doubt.STANDS_COMMANDED) <= max(1.5, 1.0 / (speed_m_s * along[axis])) + 0.3


@pytest.mark.parametrize("answers_s", [0.3, 0.8, 1.2])
def test_vehicle_that_answers_late_is_believed(answers_s: float) -> None:
    """From a hover in which no digit moves; links take up to 0.4 s each way."""
    reports = Reports()
    for _ in range(50):
        reports.hear(np.array([3.0, 4.0, -20.0]), np.zeros(3), np.zeros(3))
    began_s = reports.now_s + answers_s
    for tick in range(60):
        flown_s = max(reports.now_s - began_s, 0.0)
        wobbles_m = np.array([0.0, 0.0, 0.002 * (tick % 2)])
        moves_m_s = 2.0 * min(flown_s, 1.0)
        way_m = np.array([min(flown_s, 1.0) ** 2 + 2.0 * max(flown_s - 1.0, 0.0), 0.0, 0.0])
        reports.hear(
            np.array([3.0, 4.0, -20.0]) + way_m + wobbles_m,
            np.array([moves_m_s, 0.0, 0.0]),
            np.array([2.0, 0.0, 0.0]),
        )
    assert set(reports.doubts) == {Doubt.NONE}


@pytest.mark.parametrize("stands_s", [0.4, 0.6, 0.9])
def test_positions_that_waited_for_a_link_are_believed(stands_s: float) -> None:
    """The link stands again and again; then it delivers what waited over two ticks, the oldest first."""
    reports, speed_m_s = Reports(), 4.0
    for _ in range(20):
        for _ in range(20):
            sent_s = reports.now_s
            reports.hear(sent_s * speed_m_s * ALONG, speed_m_s * ALONG, None, clock_s=sent_s)
        since_s = reports.now_s
        reports.now_s += stands_s
        for share in (0.2, 1.0):
            sent_s = since_s + share * (reports.now_s - since_s)
            reports.hear(sent_s * speed_m_s * ALONG, speed_m_s * ALONG, None, clock_s=sent_s)
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
