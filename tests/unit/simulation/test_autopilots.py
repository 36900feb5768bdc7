"""Simulated fleets of one autopilot, or of several by turns."""

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.model.state import Array
from gcs.sim.autopilots.ardupilot.response import Copters, Response
from gcs.simulation.autopilots import Bodies, bodies_of, responses
from gcs.simulation.scenario import Wind, World
from gcs.simulation.vehicles import Vehicles

DT_S = 0.01
BOTH = ("px4", "ardupilot")


def of(count: int, *autopilots: str, spread: float = 0.0, wind_m_s: float = 0.0) -> Bodies:
    world = World(
        autopilots=autopilots, response_spread=spread, ramp_m_s2=2.0, wind=Wind(mean_x_m_s=wind_m_s)
    )
    return bodies_of(np.zeros((count, 3)), world, DT_S, np.random.default_rng(1))


def stepped(bodies: Bodies, command: Array, seconds: float, *, wind_m_s: float = 0.0) -> Array:
    wind, still = np.tile([wind_m_s, 0.0, 0.0], (len(command), 1)), np.zeros_like(command)
    for _ in range(round(seconds / DT_S)):
        bodies.step(command, wind, still)
    return bodies.velocity_m_s


def test_by_turns_each_vehicle_moves_as_its_own_kind() -> None:
    command = np.tile([5.0, 0.0, -1.0], (4, 1))
    mixed = stepped(of(4, *BOTH), command, 1.5)
    alone = {kind: stepped(of(2, kind), command[:2], 1.5) for kind in BOTH}
    assert mixed[0::2] == pytest.approx(alone["px4"])
    assert mixed[1::2] == pytest.approx(alone["ardupilot"])
    assert abs(mixed[0, 0] - mixed[1, 0]) > 0.3


def test_a_fleet_of_one_kind_is_that_of_the_kind_itself() -> None:
    assert isinstance(of(3, "px4"), Vehicles)
    bodies, copters = of(2, "ardupilot"), Copters(np.zeros((2, 3)), DT_S, Response())
    command = np.array([[4.0, 0.0, 0.0], [0.0, -4.0, 1.0]])
    for _ in range(150):
        copters.step(
            command,
            np.tile([2.0, 2.5], (2, 1)),
            copters.position_m,
            copters.velocity_m_s,
            wind_m_s=0.0,
            resting=np.zeros(2, np.bool_),
        )
    assert stepped(bodies, command, 1.5) == pytest.approx(copters.velocity_m_s)


def test_vehicles_of_a_kind_differ_and_hover_in_wind() -> None:
    bodies = of(4, "ardupilot", spread=0.2, wind_m_s=5.0)
    stepped(bodies, np.zeros((4, 3)), 3.0, wind_m_s=5.0)
    assert np.abs(bodies.position_m).max() < 1e-6
    moved = stepped(bodies, np.tile([3.0, 0.0, 0.0], (4, 1)), 0.7, wind_m_s=5.0)
    assert len(set(np.round(moved[:, 0], 4).tolist())) == 4


def test_held_vehicles_rest_and_start_from_where_they_are_held() -> None:
    bodies, held = of(2, *BOTH), np.ones(2, np.bool_)
    stepped(bodies, np.tile([5.0, 0.0, 0.0], (2, 1)), 2.0)
    place = np.tile([1.0, 2.0, -3.0], (2, 1))
    bodies.rest(held, place)
    assert (bodies.velocity_m_s == 0.0).all()
    stepped(bodies, np.zeros((2, 3)), 2.0)
    assert bodies.position_m[1] == pytest.approx(place[1], abs=0.05)


def test_control_knows_what_the_parameters_say_not_what_is_flown() -> None:
    world = World(autopilots=BOTH, ramp_m_s2=2.0, ramp_share=0.4)
    assert responses(world, 3).acceleration_m_s2.tolist() == [np.inf, 1.6, np.inf]
    slow = bodies_of(np.zeros((2, 3)), world, DT_S, np.random.default_rng(1))
    assert stepped(slow, np.tile([5.0, 0.0, 0.0], (2, 1)), 2.0)[1, 0] < 0.4 * 2.0 * 2.0 + 0.1


@pytest.mark.parametrize("names", [(), ("px4", "paparazzi")])
def test_an_autopilot_without_a_profile_is_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(ValidationError, match="px4, ardupilot"):
        World(autopilots=names)
