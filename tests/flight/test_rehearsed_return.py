"""A rehearsal decides about the collective return as the flight does."""

from typing import NamedTuple

import numpy as np
import pytest

from gcs.model.lifecycle import Phase
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask
from gcs.planning.return_paths.paths import WELL_IN_PLACE_M, PathProgress
from gcs.service import ShowAction
from gcs.simulation.formation_run import FormationRun
from gcs.simulation.scenario import FormationFlight, Judged, Scenario
from gcs.testing.virtual_show import FLEET_STEP_S, VirtualShow, fly, show_config

pytestmark = pytest.mark.soak

COUNT = 6
TICK_S, GOAL_M_S = 0.05, 5.0
FLIGHT = FormationFlight(kind="formation", radius_m=8.0, ending="return", ending_s=20.0)


def run_of(flight: FormationFlight) -> FormationRun:
    scenario = Scenario(
        name="return", about="", duration_s=200.0, flight=flight, judged=Judged(vehicles=(COUNT,))
    )
    return FormationRun(scenario, flight, COUNT, seed=1)


class Watched(FormationRun):
    """Keeps how far from above its pad each vehicle was when it began to come down."""

    def before_tick(self) -> None:
        """Compare before and after."""
        before = self.descending.copy()
        super().before_tick()
        for row in np.flatnonzero(self.descending & ~before).tolist():
            here_m, pad_m = self.world.received_m[row], self.record.goal_m[row]
            self.off_m.append(float(np.hypot(*(here_m - pad_m)[:2])))

    off_m: list[float]


def test_rehearsed_vehicles_land_where_the_flight_lands_them() -> None:
    """The rehearsal let them come down from 0.8 m beside the pad, the flight from 0.4 m."""
    scenario = run_of(FLIGHT).scenario
    run = Watched(scenario, FLIGHT, COUNT, seed=1)
    run.off_m = []
    run.fly()
    assert len(run.off_m) == COUNT
    assert max(run.off_m) < WELL_IN_PLACE_M
    assert run.finished()


@pytest.mark.soak
def test_the_rehearsed_plan_avoids_obstacles() -> None:
    """The rehearsal planned its paths through obstacles, which the flight's planner avoids."""
    run = run_of(FLIGHT)
    pads_m = run.record.start_m * (1.0, 1.0, 0.0)
    middle_m = pads_m.mean(axis=0)
    start_m = pads_m + np.array([30.0, 0.0, -7.0])
    wall = Obstacle("wall", float(middle_m[0]) + 15.0, float(middle_m[1]), 1.0, 1.0, 8.0)
    run.plan = type(run.plan)(run.plan.formation, obstacles=(wall,))
    run.world.receive()
    run.world.received_m[:], run.record.goal_m = start_m, pads_m
    paths = run._return_paths(np.arange(len(start_m)), 5.0)
    half_m = np.array([wall.half_length_x_m, wall.half_length_y_m])
    inside = (np.abs(paths.path_m[..., :2] - (wall.x_m, wall.y_m)) < half_m).all(axis=-1)
    lower = -paths.path_m[..., 2] < wall.height_m
    assert paths.unplanned == ()
    assert not (inside & lower).any()


class Step(NamedTuple):
    """One tick of a flight's collective return. Rows as in the fleet."""

    position_m: Array  # (n, 3) as estimated
    goal_m: Array  # (n, 3)
    descending: Mask  # (n,)


async def flown_return(show: VirtualShow) -> tuple[PathProgress, Array, list[Step]]:
    """Return together. Returns: the flight's plan, the starts, and each tick until all vehicles descend."""
    await show.start()
    show.service.commands.command_show(ShowAction.STOP)
    await show.until(lambda: show.vehicle("d1").reason == "on its way home")
    flight, collective_return = show.service.flight, show.service.commands.collective_return
    assert collective_return is not None
    progress = collective_return._progress
    assert progress is not None
    steps: list[Step] = []
    async for _ in show.service.view.values():
        vehicles = list(flight.vehicles.values())
        descending = np.array([vehicle.phase is Phase.LANDING for vehicle in vehicles])
        goal_m = np.array([vehicle.goal_m for vehicle in vehicles])
        steps.append(Step(np.array(flight.newest.state.position_m), goal_m, descending))
        if descending.all():
            break
    return progress, np.array([vehicle.home_m for vehicle in vehicles]), steps


@pytest.mark.soak
def test_rehearsal_and_flight_follow_one_plan_alike() -> None:
    """The rehearsal is given the flight's plan and positions: goals and descents are the flight's."""
    progress, home_m, steps = fly(flown_return, show_config(COUNT), step_s=FLEET_STEP_S)
    run = run_of(FLIGHT)
    run.pads_m = home_m
    run._return_paths = lambda *_: progress.return_paths  # type: ignore[method-assign]
    descended: list[Mask] = []
    for number, step in enumerate(steps):
        run.world.received_m = step.position_m
        run.come_home(5.0, begin=number == 0)
        descended.append(run.descending.copy())
        alike = ~step.descending & ~run.descending
        assert np.abs(run.goal_m - step.goal_m)[alike].max(initial=0.0) < GOAL_M_S * 3 * TICK_S
    first = [np.argmax(np.array(each), axis=0) for each in (descended, [step.descending for step in steps])]
    assert descended[-1].all()
    assert np.abs(first[0] - first[1]).max() <= 2
