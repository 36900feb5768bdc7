"""A simulated flight step by step, with velocities of a program instead of the law's."""

from typing import Any

import numpy as np
import pytest

from gcs.model.errors import ConfigError, InvalidError, RefusedError, ShapeError
from gcs.simulation import Scenario, Stepper, fly

COUNT = 4
TIMED = ("tick", "realtime_factor")


@pytest.fixture(scope="module")
def short() -> Scenario:
    return Scenario.load("assembly").with_(duration_s=12.0)


def untimed(figures: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in figures.items() if name not in TIMED}


def test_steps_of_the_law_are_the_flight(short: Scenario) -> None:
    flight = fly(short, COUNT, 3)
    with Stepper(short, COUNT, seed=1) as sim:
        state, done = sim.reset(seed=3), False
        assert state.time_s == 0.0
        assert np.isnan(state.setpoint_m_s).all()
        while not done:
            state, done = sim.step()
        assert state.time_s == pytest.approx(12.0)
        again = sim.result()
        with pytest.raises(RefusedError, match="the flight is over"):
            sim.step()
    for name, array in flight.arrays().items():
        assert np.array_equal(array, again.arrays()[name]), name
    assert untimed(again.metrics.figures()) == untimed(flight.metrics.figures())


def test_given_velocities_are_flown_instead_of_the_law(short: Scenario) -> None:
    asked_m_s = np.tile([0.0, 1.5, -0.5], (COUNT, 1))
    with Stepper(short, COUNT) as sim:
        sim.reset()
        for _ in range(100):
            state, _ = sim.step(asked_m_s)
    assert np.abs(state.velocity_m_s - asked_m_s).max() < 0.1
    assert state.proposed_m_s == pytest.approx(asked_m_s)
    assert state.allowed_m_s == pytest.approx(asked_m_s)


@pytest.mark.parametrize(
    "scenario",
    [Scenario.load("assembly"), Scenario.build(60.0, "goals", layout="opposite", extent_m=30.0)],
    ids=["formation", "goals"],
)
def test_velocities_that_would_collide_pass_the_filter(scenario: Scenario) -> None:
    """All fly at the middle of them all as fast as they can."""
    with Stepper(scenario, 8) as sim:
        state, closest_m, limited = sim.reset(), np.inf, 0
        for _ in range(400):
            towards_m = state.position_m.mean(axis=0) - state.position_m
            state, _ = sim.step(5.0 * towards_m)
            closest_m = min(closest_m, state.closest_m)
            limited += sum(map(bool, state.limited_by))
        floor_m = sim.result().metrics.separation.floor_m
    assert floor_m <= closest_m < 1.8 * floor_m, "they came together, and no closer than that"
    assert limited > 400


@pytest.mark.soak
def test_velocities_do_not_keep_vehicles_from_their_return() -> None:
    away_m_s, done = np.tile([0.0, 0.0, -1.0], (COUNT, 1)), False
    with Stepper(Scenario.build(90.0, ending="return", ending_s=5.0), COUNT) as sim:
        state = sim.reset()
        while not done:
            state, done = sim.step(away_m_s)
        pads_m = sim.result().position_m[0] * (1.0, 1.0, 0.0)
    assert not state.in_air.any()
    assert state.time_s < 60.0
    assert np.abs(state.position_m - pads_m).max() < 0.5


@pytest.mark.keeps("formation")
@pytest.mark.parametrize("kind", ["formation", "goals"])
def test_velocities_do_not_undo_a_failsafe(kind: str) -> None:
    """A storm carries vehicles to the fence, and the service brings them home."""
    layout: dict[str, Any] = {"layout": "cube", "extent_m": 30.0} if kind == "goals" else {}
    wind = {"mean_x_m_s": 16.0, "rise_s": 10.0}
    control = {"safety": {"fence": {"distance_max_m": 50.0}}}
    storm = Scenario.build(40.0, kind, failsafes={}, wind=wind, control=control, **layout)
    given_m_s, done = np.tile([0.0, 0.3, 0.0], (COUNT, 1)), False
    with Stepper(storm, COUNT) as sim:
        sim.reset()
        while not done:
            state, done = sim.step(given_m_s)
        acted = sim.result().metrics.failsafes
    assert acted is not None
    assert acted[0].action == "return"
    led = np.abs(state.proposed_m_s - given_m_s).max(axis=1) > 0.5
    assert led.any(), "those that are led home"


def test_velocities_do_not_lead_past_the_fence() -> None:
    control = {"safety": {"fence": {"distance_max_m": 30.0}}}
    with Stepper(Scenario.build(20.0, control=control), COUNT) as sim:
        state, done = sim.reset(), False
        while not done:
            state, done = sim.step(np.tile([4.0, 0.0, 0.0], (COUNT, 1)))
    out_m = np.hypot(*state.position_m[:, :2].T)
    assert 28.0 < out_m.max() <= 30.0
    assert all(state.limited_by), "each is held back"


@pytest.mark.parametrize(
    ("velocities_m_s", "error", "words"),
    [
        (np.zeros((3, COUNT)), ShapeError, r"\(3, 4\): \(4, 3\) is needed"),
        (np.zeros(3), ShapeError, r"\(4, 3\) is needed"),
        ([[0, 0, 0]] * 3 + [[0, np.nan, 0]], InvalidError, r"velocities_m_s\[3\]"),
    ],
)
def test_wrong_velocities_are_refused(
    short: Scenario, velocities_m_s: Any, error: type[Exception], words: str
) -> None:
    sim = Stepper(short, COUNT)
    sim.reset()
    with pytest.raises(error, match=words):
        sim.step(velocities_m_s)
    with pytest.raises(RefusedError, match="nothing was flown"):
        sim.result()


@pytest.mark.parametrize("name", ["article-assembly", "stations"])
def test_flights_without_a_common_tick_are_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="use fly"):
        Stepper(Scenario.load(name))
