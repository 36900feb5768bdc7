"""The alarm of a vehicle that the paths of lost vehicles enclose, from the tick's own search."""

from dataclasses import replace

import numpy as np
import pytest

from gcs.control import ControlSettings, Memory, Task, Tasks, tick
from gcs.flight.monitors.space_alarms import of_routes
from gcs.model.plan import Formation, Plan
from gcs.model.state import FleetState, Traits
from gcs.service.alarms import AlarmCause

SETTINGS = ControlSettings()
CEILING_M = SETTINGS.safety.fence.height_max_m


@pytest.mark.parametrize(("top_m", "named"), [(CEILING_M, ["d0"]), (30.0, [])])
def test_vehicle_without_a_way_to_its_goal_is_named(top_m: float, named: list[str]) -> None:
    """A ring of columns about d0, open at the top or not; d1 stands outside, at its goal."""
    turn_rad = np.arange(0.0, 6.28, 0.4)
    place_m = np.column_stack(
        [9.0 * np.cos(turn_rad), 9.0 * np.sin(turn_rad), np.full(len(turn_rad), -top_m)]
    )
    ring_m = np.stack([place_m, place_m * (1.0, 1.0, 0.0)], axis=1)
    position_m = np.array([[0.0, 0.0, -10.0], [40.0, 0.0, -10.0]])
    goal_m, still = np.array([[30.0, 0.0, -10.0], [40.0, 0.0, -10.0]]), np.zeros((2, 3))
    none = np.zeros(2, dtype=bool)
    tasks = Tasks(np.full(2, Task.GOAL, dtype=np.int8), goal_m, ~none, none, ring_m)
    fleet = FleetState(0.05, ("d0", "d1"), position_m, still, np.zeros(2), np.zeros(2))
    about = Plan(Formation(10.0, 20.0)), Traits.alike(2)
    decided = tick(fleet, tasks, *about, Memory.fresh(2, 0.0), SETTINGS)
    found = list(of_routes(decided, fleet.ids))
    assert [each.vehicles for each in found] == [(name,) for name in named]
    assert all(each.cause is AlarmCause.NO_WAY for each in found)
    later = tick(
        replace(fleet, time_s=20.0), replace(tasks, segments_m=ring_m[4:5]), *about, decided.memory, SETTINGS
    )
    assert list(of_routes(later, fleet.ids)) == [], "the paths are open again"
