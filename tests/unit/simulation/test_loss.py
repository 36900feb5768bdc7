"""Vehicles that lose their links in simulated flights, and the failsafes that act on it."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from gcs.control import Task
from gcs.control.memory import Memory
from gcs.failsafe.policy import FailsafePolicy, VehicleLost
from gcs.model.state import Setpoints
from gcs.planning.lost_space import COLUMNS_APART_M
from gcs.safety.floor import Floor
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.loss import Losses
from gcs.simulation.metrics import report
from gcs.simulation.scenario import FormationFlight, Judged, Scenario, ScenarioLoss, World
from gcs.simulation.world import TrueWorld

COUNT = 8


def run_of(loss: ScenarioLoss, failsafes: FailsafePolicy | None, duration_s: float) -> FormationRun:
    flight = FormationFlight(kind="formation", loss=loss)
    scenario = Scenario(
        name="loss",
        about="some are lost",
        duration_s=duration_s,
        flight=flight,
        judged=Judged(vehicles=(COUNT,)),
        failsafes=failsafes,
    )
    return FormationRun(scenario, flight, COUNT, 1)


def test_lost_vehicles_stay_in_the_air_and_in_the_way() -> None:
    run = run_of(ScenarioLoss(share=0.13, at_s=5.0), None, 12.0)
    record = run.fly()
    assert run.losses.known.sum() == 1
    assert record.in_air[-1].all()
    assert (run.task[run.losses.known] == Task.NONE).all()
    assert not record.violating
    stopped_m = record.path_m[-1, run.losses.known] - record.path_m[-60, run.losses.known]
    assert np.linalg.norm(stopped_m) < 0.3
    assert run.losses.apart_m(record.path_m[-1, run.losses.known], run.floor).max() < 1.0


def test_too_many_lost_vehicles_end_the_flight_as_in_reality() -> None:
    run = run_of(ScenarioLoss(share=0.25, at_s=10.0, action="land"), FailsafePolicy(), 120.0)
    record = run.fly()
    assert [what for _, _, what in record.failsafes][-1] == "return"
    assert record.failsafes[-1][1] == "too many vehicles lost"
    assert not record.in_air[-1].any()
    assert not record.violating
    assert report(record)["failsafes"]


@pytest.mark.long
@pytest.mark.soak
@pytest.mark.parametrize("action", ["pause", "land"])
def test_a_lost_vehicle_pauses_or_lands_the_others(action: str) -> None:
    policy = FailsafePolicy(vehicle_lost=VehicleLost.model_validate({"action": action}))
    run = run_of(ScenarioLoss(share=0.13, at_s=15.0), policy, 70.0)
    record = run.fly()
    others = ~run.losses.known
    assert [what for _, _, what in record.failsafes] == [action]
    assert record.in_air[-1][others].any() == (action == "pause")
    if action == "pause":
        assert np.abs(record.path_m[-1, others] - record.path_m[-100, others]).max() < 0.5
    assert not record.violating


@pytest.mark.soak
def test_without_failsafes_the_others_close_the_gap() -> None:
    record = run_of(ScenarioLoss(share=0.25, at_s=10.0, action="land"), None, 40.0).fly()
    assert record.failsafes == []
    assert "failsafes" not in report(record)
    assert record.formed[-1].sum() == 6


@pytest.mark.parametrize("vehicle", ["fitted", "cascade"])
def test_space_of_a_vehicle_that_was_turning_is_closed(vehicle: Literal["fitted", "cascade"]) -> None:
    """PX4 flies on with its last setpoint: the vehicle was received northbound, and goes south."""
    links = World(vehicle=vehicle, telemetry_delay_s=0.1, setpoint_delay_s=0.1, response_spread=0.0)
    world = TrueWorld(np.array([[0.0, 0.0, -20.0], [50.0, 0.0, -20.0]]), links, 1)
    losses, memory = Losses(ScenarioLoss(share=0.5, at_s=2.4), 2, 1), Memory.fresh(2, 0.0)
    (row,) = np.flatnonzero(losses.rows)
    northbound_m_s, away_m = 0.0, []
    floor = Floor(vertical_m=Floor().horizontal_m)
    while world.time_s < 8.0:
        fleet = world.receive()
        losses.advance(world, fleet, memory, 0.5)
        sent_m_s = np.tile([2.5 if world.time_s < 2.0 else -2.5, 0.0, 0.0], (2, 1))
        memory = replace(memory, desired_m_s=sent_m_s, setpoint_m_s=sent_m_s)
        world.send(Setpoints(world.time_s, world.ids, sent_m_s, np.zeros(2)))
        world.advance()
        if losses.known.any():
            away_m.append(losses.apart_m(world.position_m, floor)[row])
        else:
            northbound_m_s = float(world.received_m_s[row, 0])
    assert northbound_m_s > 0.5
    assert max(away_m) < COLUMNS_APART_M / 2


def test_vehicles_that_wait_to_join_are_never_the_lost_ones() -> None:
    for seed in range(20):
        losses = Losses(ScenarioLoss(share=0.5), 8, seed, joining=2)
        assert int(losses.rows.sum()) == 3
        assert not losses.rows[6:].any()


@pytest.mark.soak
def test_all_others_land_although_pads_lie_below_a_lost_one() -> None:
    """A vehicle with such a pad hovered beside the closed space for ever, and no landing was counted."""
    flight = FormationFlight(
        kind="formation", ending="return", ending_s=30.0, loss=ScenarioLoss(share=0.1, at_s=6.0)
    )
    scenario = Scenario(
        name="loss", about="some are lost", duration_s=120.0, flight=flight, judged=Judged(vehicles=(20,))
    )
    run = FormationRun(scenario, flight, 20, 1)
    record = run.fly()
    lost = run.losses.known
    assert np.hypot(*(record.goal_m - run.world.home_m)[~lost, :2].T).max() > 1.0
    figures = report(record)["arrival"]
    assert isinstance(figures, dict)
    assert figures["arrived"] == figures["expected"] == 18
    assert not record.violating
    assert record.planning_s is not None
