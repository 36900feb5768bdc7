"""The simulated world's errors and links."""

import numpy as np
import pytest

from gcs.model.state import Setpoints
from gcs.simulation.scenario import World
from gcs.simulation.world import TrueWorld

N = 400


def test_bias_has_its_deviation_and_correlation_time() -> None:
    world = TrueWorld(np.full((N, 3), -10.0), World(bias_m=0.5, bias_time_s=60.0, tick_rate_hz=1.0), 1)
    first = world.estimate()[0] - world.position_m
    for _ in range(60):
        world.advance()
    after = world.estimate()[0] - world.position_m
    assert np.std(first) == pytest.approx(0.5, abs=0.03)
    assert np.std(after) == pytest.approx(0.5, abs=0.03)
    assert np.corrcoef(first.ravel(), after.ravel())[0, 1] == pytest.approx(np.exp(-1.0), abs=0.06)


def test_bias_changes_nothing_else_that_is_random() -> None:
    with_bias, without = (
        TrueWorld(np.full((4, 3), -10.0), World(noise=1.0, bias_m=bias_m), 7) for bias_m in (1.0, 0.0)
    )
    for _ in range(20):
        with_bias.advance()
        without.advance()
    assert (with_bias.position_m == without.position_m).all()
    assert (with_bias.estimate()[1] == without.estimate()[1]).all()
    assert (with_bias.estimate()[0] != without.estimate()[0]).all()


def test_delay_each_way_is_seen_after_both() -> None:
    delays = World(telemetry_delay_s=0.1, setpoint_delay_s=0.1, response_spread=0.0)
    world = TrueWorld(np.array([[0.0, 0.0, -10.0]]), delays, 1)
    moved_s, seen_s = [], []
    for _ in range(20):
        fleet = world.receive()
        world.send(Setpoints(world.time_s, world.ids, np.array([[3.0, 0.0, 0.0]]), np.zeros(1)))
        moved_s += [world.time_s] if world.velocity_m_s[0, 0] > 0.0 else []
        seen_s += [world.time_s] if fleet.velocity_m_s[0, 0] > 0.0 else []
        world.advance()
    assert moved_s[0] == pytest.approx(0.25, abs=0.051)  # the link's delay and the vehicle's own
    assert seen_s[0] == pytest.approx(moved_s[0] + 0.1, abs=1e-9)


@pytest.mark.parametrize("action", ["hold", "descend", "land", "return"])
def test_a_vehicle_without_links_does_what_its_autopilot_does(action: str) -> None:
    world = TrueWorld(np.array([[-20.0, 0.0, -20.0], [20.0, 0.0, -20.0]]), World(), 1)
    lost, ahead = np.array([True, False]), np.tile([2.0, 0.0, 0.0], (2, 1))
    for tick in range(50 * 20):
        fleet = world.receive()
        if tick == 40:
            world.cut_links(lost)
        if tick == 60:
            world.fly_alone(lost, action)
            noticed_m = world.position_m[0].copy()
        world.send(Setpoints(world.time_s, world.ids, ahead, np.zeros(2)))
        world.advance()
    assert fleet.age_s[0] > 40.0
    assert fleet.age_s[1] == 0.0
    assert (fleet.velocity_m_s[0] == 0.0).all()
    assert world.in_air[0] == (action == "hold")
    stop_m = np.hypot(*(world.position_m[0] - noticed_m)[:2])
    if action == "return":
        assert np.hypot(*(world.position_m[0] - world.home_m[0])[:2]) < 0.5
    else:
        assert stop_m < 1.5
    assert world.position_m[0, 2] == pytest.approx(-20.0 if action == "hold" else 0.0, abs=0.3)
