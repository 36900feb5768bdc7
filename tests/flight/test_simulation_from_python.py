# mypy: disable-error-code="arg-type, list-item"
"""Simulation from Python: the flights and figures of the command line, as arrays."""

import json
from itertools import count
from typing import Any

import numpy as np
import pytest

from gcs.cli.main import main
from gcs.model.errors import ConfigError, InvalidError
from gcs.simulation import DIMS, FlightResult, Scenario, Stepper, Task, fly, fly_many
from gcs.simulation.flight import prepared
from gcs.simulation.scenario import FormationFlight, World
from gcs.site.simulated import SimulatedStations

COUNT = 4
TIMED = ("tick", "realtime_factor", "failed", "missed")


@pytest.fixture(scope="module")
def short() -> Scenario:
    return Scenario.load("assembly").with_(duration_s=12.0)


@pytest.fixture(scope="module")
def flight(short: Scenario) -> FlightResult:
    return fly(short, COUNT, 3)


def untimed(figures: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in figures.items() if name not in TIMED}


@pytest.mark.keeps("assembly-4")
@pytest.mark.parametrize(
    ("name", "count"),
    [("assembly", 4), ("swap-212", 8), pytest.param("article-assembly", 4, marks=pytest.mark.soak)],
)
def test_figures_are_those_of_the_command_line(
    name: str, count: int, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["simulate", name, "--vehicles", str(count), "--seed", "2", "--json"])
    printed = json.loads(capsys.readouterr().out)
    metrics = fly(Scenario.load(name), count, 2).metrics
    assert untimed(json.loads(json.dumps(metrics.figures()))) == untimed(printed)
    assert metrics.separation.minimum_m == printed["separation"]["minimum_m"]


def test_arrays_have_the_dimensions_that_are_listed(flight: FlightResult) -> None:
    lengths = {"time": 240, "vehicle": COUNT, "axis": 3, "level": 2}
    for name, array in flight.arrays().items():
        assert array.shape == tuple(lengths[dim] for dim in DIMS[name]), name
    assert flight.position_m.dtype == flight.velocity_m_s.dtype == np.float32
    assert flight.vehicle.tolist() == ["d1", "d2", "d3", "d4"]
    assert (flight.task == Task.FORMATION).all()
    assert flight.in_air.all()


def test_arrays_agree_with_each_other(flight: FlightResult) -> None:
    step_s = float(np.diff(flight.time_s).mean())
    flown_m_s = np.diff(flight.position_m, axis=0) / step_s
    between_m_s = (flight.velocity_m_s[1:] + flight.velocity_m_s[:-1]) / 2
    assert np.abs(flown_m_s - between_m_s).max() < 0.1
    assert np.isfinite(flight.setpoint_m_s).all()
    off_m = np.linalg.norm(flight.position_m[-1] - flight.centre_m[-1], axis=1) - flight.radius_m[-1]
    assert np.abs(off_m).max() < 1.0
    assert flight.closest_m.min().round(3) == flight.metrics.separation.minimum_m
    assert set(flight.limited_by.ravel()) <= {"", "limits", *(f"separation from d{k}" for k in range(1, 5))}


def test_table_has_one_row_for_each_time_and_vehicle(flight: FlightResult) -> None:
    table = flight.table()
    assert {len(column) for column in table.values()} == {240 * COUNT}
    assert table["vehicle"][:5].tolist() == ["d1", "d2", "d3", "d4", "d1"]
    assert table["time_s"][COUNT] == flight.time_s[1]
    assert table["velocity_z_m_s"][COUNT + 2] == flight.velocity_m_s[1, 2, 2]
    assert {"position_x_m", "setpoint_y_m_s", "limited_by", "task", "in_air"} <= set(table)


def test_details_are_kept_only_where_they_are_asked_for(short: Scenario) -> None:
    assert prepared(short.with_(duration_s=1.0), COUNT, 1).fly().details is None


@pytest.mark.soak
def test_many_flights_come_in_the_order_of_their_seeds(short: Scenario, flight: FlightResult) -> None:
    flights = list(fly_many(short, COUNT, [5, 3], workers=2))
    assert [each.seed for each in flights] == [5, 3]
    assert np.array_equal(flights[1].position_m, flight.position_m)
    assert not np.array_equal(flights[0].position_m, flight.position_m)


def test_numbers_of_numpy_are_whole_numbers(short: Scenario, flight: FlightResult) -> None:
    again = fly(short, np.int64(COUNT), np.float32(3.0))
    assert np.array_equal(again.position_m, flight.position_m)


@pytest.mark.soak
def test_vehicles_with_goals_fly_round_boxes() -> None:
    """Without the boxes one of them flies through each."""
    wall = {"x_m": 0.0, "y_m": 4.0, "half_length_x_m": 3.0, "half_length_y_m": 6.0, "height_m": 80.0}
    meets = {"x_m": 60.0, "y_m": -3.0, "velocity_x_m_s": -1.0}
    plain = Scenario.build(120.0, "goals", layout="head-on", extent_m=60.0)
    boxed = plain.with_(boxes=[wall, wall | meets])
    metrics = fly(boxed, 4).metrics
    assert metrics.obstacles is not None
    assert (metrics.obstacles.penetrations, metrics.separation.violations) == (0, 0)
    assert metrics.arrival.arrived == 4


def test_scenario_is_changed_by_keyword_in_all_its_worlds() -> None:
    before = Scenario.load("assembly")
    changed = before.with_(law="article", noise=1.0, wind={"mean_x_m_s": 3.0}, failsafes={}, radius_m=12)
    assert isinstance(changed.flight, FormationFlight)
    assert (changed.flight.law, changed.flight.radius_m) == ("article", 12.0)
    for seed in (0, 1):
        was, world = before.in_world_of(seed).world, changed.in_world_of(seed).world
        assert (world.noise, world.wind.mean_x_m_s, world.drag_per_s) == (1.0, 3.0, was.drag_per_s)
    assert changed.failsafes is not None
    assert before.failsafes is None
    assert changed.with_(failsafes=None, radius_m=None) == before.with_(
        law="article", noise=1.0, wind={"mean_x_m_s": 3.0}
    )
    lost = before.with_(flight={"loss": {"share": 0.25, "action": "land"}}, world=World(vehicle="cascade"))
    assert isinstance(lost.flight, FormationFlight)
    assert lost.flight.loss.share == 0.25
    assert {world.vehicle for world in lost.worlds} == {"cascade"}


def test_scenario_is_built_without_a_file() -> None:
    built = Scenario.build(3.0, radius_m=15.0, telemetry_delay_s=0.1, control={"law": {"speed_m_s": 3.0}})
    assert (built.world.telemetry_delay_s, built.control.law.speed_m_s) == (0.1, 3.0)
    assert fly(built, 3).radius_m[-1] == 15.0
    goals = Scenario.build(3.0, "goals", layout="cube", extent_m=40.0)
    assert (fly(goals, 3).task == Task.GOAL).all()


@pytest.mark.soak
def test_vehicles_of_several_stations_are_flown_as_rows() -> None:
    scenario = Scenario.load("stations").with_(duration_s=2.0, divided={"count": 2})
    apart = fly(scenario, 8, divide=SimulatedStations)
    assert apart.setpoint_m_s.shape == (40, 8, 3)
    assert np.isfinite(apart.setpoint_m_s[5:]).all()
    with pytest.raises(ConfigError, match="SimulatedStations"):
        fly(scenario, 8)
    with pytest.raises(ConfigError, match="vehicles = 1: at least 2, one each"):
        fly(scenario, 1, divide=SimulatedStations)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: Scenario.load("asembly"), "asembly: there is no such file; near it: assembly, "),
        (lambda: Scenario.load("assembly").with_(lwa="article"), "lwa: unknown keyword; did you mean law?"),
        (lambda: Scenario.load("assembly").with_(law="flock"), "flock"),
        (lambda: Scenario.load("assembly").with_(world={"nosie": 1}), "did you mean noise?"),
        (lambda: Scenario.load("assembly").with_(loss=0.1), "there are several; say flight={'loss'"),
        (lambda: Scenario.build(-1.0), "duration_s = -1.0: must be greater than 0"),
        (lambda: Scenario.build(1.0, "flock"), "one of 'formation'"),
        (lambda: fly(Scenario.load("assembly"), 0), "vehicles = 0: a whole number, at least 1"),
        (lambda: fly(Scenario.load("assembly"), 2.5), "vehicles = 2.5: a whole number"),
        (lambda: fly(Scenario.load("assembly"), 4, -1), "seed = -1: a whole number, at least 0"),
        (lambda: fly_many(Scenario.load("assembly"), 0), "vehicles = 0: a whole number"),
        (lambda: fly_many(Scenario.load("assembly"), workers=0), "workers = 0: a whole number, at least 1"),
        (lambda: fly(Scenario.load("assembly"), "3"), "vehicles = '3': a whole number, at least 1"),
        (lambda: fly(Scenario.load("assembly"), True), "vehicles = True: a whole number"),
        (lambda: fly(Scenario.load("assembly"), [3]), "vehicles = [3]: a whole number"),
        (lambda: fly(Scenario.load("assembly"), float("nan")), "vehicles = nan: a whole number"),
        (lambda: fly(Scenario.load("assembly"), 10**400), "a whole number, at least 1, at most 20000"),
        (lambda: fly(Scenario.load("assembly"), 4, "x"), "seed = 'x': a whole number, at least 0"),
        (lambda: fly(Scenario.load("assembly"), 4, None), "seed = None: a whole number, at least 0"),
        (lambda: fly("assembly"), "scenario = 'assembly': a Scenario, such as Scenario.load"),
        (lambda: fly(Scenario.load("assembly"), 4, on_progress=3), "on_progress = 3: a function"),
        (lambda: fly(Scenario.load("stations"), 4, divide=3), "divide = 3: a function"),
        (lambda: Stepper("assembly"), "scenario = 'assembly': a Scenario, such as Scenario.load"),
        (lambda: Stepper(Scenario.load("assembly"), 4).reset("x"), "seed = 'x': a whole number"),
        (lambda: fly_many("assembly"), "scenario = 'assembly': a Scenario, such as Scenario.load"),
        (lambda: fly_many(Scenario.load("assembly"), seeds=5), "seeds = 5: several whole numbers, such as"),
        (lambda: fly_many(Scenario.load("assembly"), seeds="12"), "seeds = '12': several whole numbers"),
        (lambda: fly_many(Scenario.load("assembly"), seeds=[1, None]), "seeds[1] = None: a whole number"),
        (lambda: fly_many(Scenario.load("assembly"), seeds=count()), "at most 1000000"),
        (lambda: fly_many(Scenario.load("assembly"), workers="2"), "workers = '2': a whole number"),
        (lambda: Scenario.load(3), "3: there is no such file"),
        (lambda: Scenario.build("x"), "duration_s = 'x'"),
        (lambda: Scenario.build(3.0, ["goals"]), "one of 'formation'"),
        (lambda: Scenario.load("assembly").with_(flight=3), "flight"),
        (lambda: Scenario.load("assembly").with_(world=[1]), "world"),
        (lambda: Scenario.load("assembly").with_(worlds=3, noise=1.0), "worlds"),
        (lambda: Scenario.load("assembly").with_(wind="much"), "wind"),
    ],
)
def test_wrong_input_is_refused_with_what_is_allowed(wrong: Any, words: str) -> None:
    with pytest.raises((ConfigError, InvalidError)) as caught:
        wrong()
    assert words in str(caught.value)
