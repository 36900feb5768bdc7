"""Vehicles that follow setpoints slower than their profiles say are noticed, others never."""

import numpy as np
import pytest

from gcs.model.response import FleetResponse, Response
from gcs.model.state import Array
from gcs.safety.answers import KEPT_S, Answers, compared

TICK_S = 0.05
RAMPED = Response(acceleration_m_s2=2.5, swings_s=0.45)


def after_steps(
    flown_m_s2: list[float],
    vehicles: list[Response],
    *,
    wind_m_s: float = 0.0,
    delay_s: float = 0.0,
    known_s: float | None = None,
) -> Answers:
    """What is known after steps of 5 m/s there and back, flown with those accelerations 0.35 s late.

    `known_s`: the delay that the station reckons with; None: as it is.
    """
    n, late = len(vehicles), round((0.35 + 2.0 * delay_s) / TICK_S)
    known_s = delay_s if known_s is None else known_s
    known, velocity, asked = Answers.none(n), np.zeros((n, 3)), [np.zeros((n, 3))] * (late + 1)
    lack = np.tile([wind_m_s, 0.0, 0.0], (n, 1))
    for index in range(round(24.0 / TICK_S)):
        goal = np.tile([5.0 if index * TICK_S % 12.0 < 6.0 else 0.0, 0.0, 0.0], (n, 1))
        step = np.clip(goal - asked[-1], -2.5 * TICK_S, 2.5 * TICK_S)
        asked.append(asked[-1] + step)
        most = TICK_S * np.array(flown_m_s2)[:, None]
        velocity = velocity + np.clip(asked[-1 - late] - velocity, -most, most)
        known = _next(known, asked[-1], velocity - lack, vehicles, lack, known_s)
    return known


def _next(
    known: Answers, asked: Array, velocity: Array, vehicles: list[Response], lack: Array, delay_s: float
) -> Answers:
    return compared(
        known,
        asked,
        velocity,
        np.ones(len(vehicles), np.bool_),
        lack,
        FleetResponse.of(vehicles),
        dt_s=TICK_S,
        link_delay_s=delay_s,
    )


@pytest.mark.parametrize("delay_s", [0.0, 0.2])
def test_less_acceleration_than_parameters_say_is_noticed(delay_s: float) -> None:
    known = after_steps([2.5, 1.0, 2.2], [RAMPED, RAMPED, RAMPED], delay_s=delay_s)
    assert known.slow.tolist() == [False, True, False]


@pytest.mark.parametrize("known_s", [0.0, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("flown_m_s2", [2.5, 4.0, 8.0])
def test_vehicle_that_is_faster_than_asked_is_not_slow(
    flown_m_s2: float, delay_s: float, known_s: float
) -> None:
    """Ahead is not behind, and links may be later than the station knows."""
    known = after_steps([flown_m_s2], [RAMPED], delay_s=delay_s, known_s=known_s)
    assert not known.slow.any()


@pytest.mark.parametrize("delay_s", [0.2, 0.3, 0.4])
@pytest.mark.parametrize("period_s", [4.0, 5.0, 7.0])
def test_vehicle_that_is_only_late_is_not_slow_at_any_turn(delay_s: float, period_s: float) -> None:
    """To and fro by 2.5 m/s, answered by a little more, as late as the link and the autopilot make it."""
    known, late_s = Answers.none(1), 0.35 + 2.0 * delay_s
    for index in range(round(40.0 / TICK_S)):
        now_s = index * TICK_S
        asked, flown = (
            np.array([[size_m_s * np.sin(2.0 * np.pi * at_s / period_s), 0.0, 0.0]])
            for size_m_s, at_s in ((2.5, now_s), (2.9, now_s - late_s))
        )
        known = _next(known, asked, flown, [RAMPED], np.zeros((1, 3)), delay_s)
        assert not known.slow.any()


def test_one_whose_parameters_say_so_is_as_expected() -> None:
    assert not after_steps([1.0], [Response(acceleration_m_s2=1.0)]).slow.any()


def test_vehicle_without_a_named_acceleration_is_noticed_as_well() -> None:
    assert after_steps([3.0, 1.0], [Response(), Response()]).slow.tolist() == [False, True]


def test_wind_that_takes_speed_from_all_is_not_their_answer() -> None:
    assert not after_steps([2.5, 2.5], [RAMPED, RAMPED], wind_m_s=2.0).slow.any()


def test_it_is_remembered_for_a_while_and_forgotten() -> None:
    known = after_steps([1.0], [RAMPED])
    still, none = np.zeros((1, 3)), np.zeros((1, 3))
    for _ in range(round(5.0 / TICK_S)):
        known = _next(known, still, still, [RAMPED], none, 0.0)
    assert known.slow.all()
    for _ in range(round(KEPT_S / TICK_S)):
        known = _next(known, still, still, [RAMPED], none, 0.0)
    assert not known.slow.any()


def test_vehicle_that_is_not_commanded_is_not_compared() -> None:
    known = after_steps([1.0], [RAMPED])
    no_vehicle, still = np.zeros(1, np.bool_), np.zeros((1, 3))
    known = compared(
        known,
        np.full((1, 3), np.nan),
        still,
        no_vehicle,
        still,
        FleetResponse.of([RAMPED]),
        dt_s=TICK_S,
        link_delay_s=0.0,
    )
    assert not known.slow.any()
    assert np.isnan(known.laggard_m_s).all()
