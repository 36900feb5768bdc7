"""A rehearsal decides about the collective return as the flight does."""

import numpy as np

from gcs.model.plan import Obstacle
from gcs.planning.return_paths import WELL_IN_PLACE_M
from gcs.simulation.flight import FormationRun
from gcs.simulation.scenario import FormationFlight, Judged, Scenario

COUNT = 6
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


def test_the_rehearsed_plan_avoids_obstacles() -> None:
    """The rehearsal planned its ways through obstacles, which the flight's planner avoids."""
    run = run_of(FLIGHT)
    pads_m = run.record.start_m * (1.0, 1.0, 0.0)
    middle_m = pads_m.mean(axis=0)
    start_m = pads_m + np.array([30.0, 0.0, -7.0])
    wall = Obstacle("wall", float(middle_m[0]) + 15.0, float(middle_m[1]), 1.0, 1.0, 8.0)
    run.plan = type(run.plan)(run.plan.formation, obstacles=(wall,))
    ways = run._return_paths(start_m, pads_m, 5.0)
    half_m = np.array([wall.half_length_x_m, wall.half_length_y_m])
    inside = (np.abs(ways.path_m[..., :2] - (wall.x_m, wall.y_m)) < half_m).all(axis=-1)
    lower = -ways.path_m[..., 2] < wall.height_m
    assert ways.unplanned == ()
    assert not (inside & lower).any()
