"""Drones with nothing but their inboxes: what arrives in them, and what comes of it in flight."""

import numpy as np
import pytest

from gcs.formation.neighbours import NeighboursSettings, Sight, range_m
from gcs.formation.orbit import Center
from gcs.model.state import Array
from gcs.simulation.batch import broken
from gcs.simulation.flight import prepared
from gcs.simulation.initial_states import lattice
from gcs.simulation.metrics import report
from gcs.simulation.scenario import Radio, Scenario
from gcs.simulation.world import Neighbourhood

TICK_S = 0.05
RADIUS_M = 10.0
SETTINGS = NeighboursSettings(sighting_rate_per_s=0.1)


def exchanged(radio: Radio, position_m: Array, rounds: int, velocity_m_s: Array | None = None) -> list[Sight]:
    """What every vehicle sees, round by round, while all go on with `velocity_m_s`."""
    n = len(position_m)
    velocity = np.zeros((n, 3)) if velocity_m_s is None else velocity_m_s
    around = Neighbourhood(radio, SETTINGS, np.arange(1.0, n + 1.0), RADIUS_M, TICK_S, 1)
    center = Center.at_rest(np.array([1.0, 2.0, -30.0]))
    return [
        around.exchange(k * TICK_S, position_m + k * TICK_S * velocity, velocity, np.ones(n, bool), center)
        for k in range(rounds)
    ]


def test_range_holds_the_requested_neighbours_on_even_sphere() -> None:
    for count in (20, 50, 200):
        place = RADIUS_M * lattice(count)
        apart_m = np.linalg.norm(place[:, None] - place[None], axis=2)
        within = (apart_m < range_m(12, count, RADIUS_M)).sum() / count - 1.0
        assert 9.5 < within < 13.0
    assert range_m(12, 4, RADIUS_M) == 2.0 * RADIUS_M


def test_inbox_holds_extrapolated_neighbours_and_their_charges() -> None:
    place = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 40.0, 0.0]])
    pace = np.tile((1.0, -2.0, 0.5), (3, 1))
    radio = Radio(delay_s=0.1, loss=0.0)
    seen = exchanged(radio, place, 8, pace)
    assert not np.isfinite(seen[1].inbox_m).any()  # still under way
    last = seen[7]
    assert last.inbox_m[0, 0] == pytest.approx(place[1] + 7 * TICK_S * pace[1])
    assert last.inbox_m[1, 0] == pytest.approx(place[0] + 7 * TICK_S * pace[0])
    assert not np.isfinite(last.inbox_m[2]).any()
    assert last.inbox_charge[0, 0] == 2.0
    assert last.belief is None


def test_lost_messages_keep_the_previous_silent_are_forgotten() -> None:
    place = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    known = [
        bool(np.isfinite(sight.inbox_m[0]).all())
        for sight in exchanged(Radio(delay_s=0.0, loss=0.5, silence_max_s=0.5), place, 400)
    ]
    assert np.mean(known) > 0.95
    around = Neighbourhood(Radio(delay_s=0.0, loss=0.0), SETTINGS, np.ones(2), RADIUS_M, TICK_S, 1)
    still = np.zeros((2, 3))
    received = []
    for k in range(30):
        present = np.array([True, k < 10])
        received.append(
            bool(np.isfinite(around.exchange(k * TICK_S, place, still, present, None).inbox_m[0]).all())
        )
    assert received[12]
    assert not received[25]


def test_beliefs_agree_on_what_all_see_together() -> None:
    radio = Radio(center="agreed", sighting_error_m=1.0, loss=0.1)
    belief = exchanged(radio, RADIUS_M * lattice(20), 600)[-1].belief
    assert belief is not None
    assert np.ptp(belief.center_m, axis=0).max() < 0.3
    assert np.abs(belief.center_m.mean(axis=0) - (1.0, 2.0, -30.0)).max() < 1.0


@pytest.mark.soak
@pytest.mark.parametrize("name", ["neighbours-only", "consensus"])
def test_twenty_with_a_dozen_neighbours_become_an_even_sphere(name: str) -> None:
    record = prepared(Scenario.load(name), 20, 7).fly()
    assert not broken(report(record), record.scenario.judged.must)


@pytest.mark.soak
def test_fifty_close_together_over_late_links_come_to_rest() -> None:
    record = prepared(Scenario.load("law-article"), 50, 5).fly()
    assert not broken(report(record), record.scenario.judged.must)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["mixed-article", "mixed-neighbours"])
def test_slow_ramps_beside_px4_do_not_swing_through_the_sphere(name: str) -> None:
    """ArduPilot vehicles with 1 m/s^2 swung by 0.5 and 0.7 m as they arrived."""
    scenario = Scenario.load(name)
    gentle = tuple(world.model_copy(update={"ramp_m_s2": 1.0}) for world in scenario.worlds)
    record = prepared(scenario.model_copy(update={"worlds": gentle}), 8, 7001).fly()
    assert not broken(report(record), scenario.judged.must)
    outward_m = np.linalg.norm(record.path_m - np.array(record.center_m)[:, None], axis=2)
    outward_m -= np.array(record.radius_m)[:, None]
    for row in range(1, 8, 2):
        arrived = int((outward_m[:, row] < 0.3).argmax())
        assert outward_m[arrived:, row].min() > -0.4
    assert -record.path_m[:, :, 2].max() > scenario.control.safety.fence.height_min_m
