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


def test_a_vehicle_without_links_stays_in_the_air_unseen() -> None:
    world = TrueWorld(np.full((2, 3), -20.0), World(), 1)
    lost = np.array([True, False])
    world.cut_links(lost)
    world.leave_to_themselves(lost, 0.9)
    for _ in range(100):
        fleet = world.receive()
        world.send(Setpoints(world.time_s, world.ids, np.tile([1.0, 0.0, 0.0], (2, 1)), np.zeros(2)))
        world.advance()
    assert fleet.age_s[0] > 4.0
    assert fleet.age_s[1] == 0.0
    assert world.position_m[0, 2] == pytest.approx(-20.0 + 0.9 * 4.7, abs=0.4)
    assert abs(world.position_m[0, 0] + 20.0) < 0.1
    assert world.position_m[1, 0] > -19.0
    assert world.in_air.all()
    world.forget(lost)
    assert np.isnan(world.receive().position_m[0]).all()
