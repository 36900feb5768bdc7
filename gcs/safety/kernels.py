"""All kernels of the filter, compiled or loaded before the flight."""

import numpy as np

from gcs.formation.obstacles import Ellipse
from gcs.safety.filter import SafetySettings, Surroundings, filter_velocities
from gcs.safety.projection import any_broken
from gcs.safety.separation import minimum_separation, separation_constraints
from gcs.safety.traffic import give_way, keep_right


def warm_up() -> None:
    """Run every kernel once, with the types used in flight; the first run after a change takes seconds."""
    settings = SafetySettings()
    position_m = np.array([[0.0, 0.0, -20.0], [2.5, 0.0, -20.0], [40.0, 0.0, -20.0]])
    desired_m_s = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    everybody, nobody = np.ones(3, dtype=bool), np.zeros(3, dtype=bool)
    surroundings = Surroundings(
        position_m,
        desired_m_s,
        everybody,
        everybody,
        nobody,
        np.zeros((0, 2, 3)),
        {"box": Ellipse(45.0, 0.0, 5.0, 5.0, top_height_m=30.0)},
        ("a", "b", "c"),
        np.zeros(3),
        np.full(3, np.inf),
    )
    turned_m_s = keep_right(
        desired_m_s,
        position_m,
        desired_m_s,
        position_m + 10.0 * desired_m_s,
        to_goal=everybody,
        commanded=everybody,
        airborne=everybody,
        flatness=1.0,
        settings=settings.traffic,
    )
    given_m_s = give_way(
        turned_m_s,
        position_m,
        position_m + 10.0 * desired_m_s,
        to_goal=everybody,
        flatness=1.0,
        settings=settings.traffic,
    )
    filter_velocities(given_m_s, surroundings, settings)
    pairs = separation_constraints(
        position_m,
        desired_m_s,
        everybody,
        everybody,
        floor=settings.floor,
        braking=settings.braking,
        uncertainty_m=np.zeros(3),
        course_m_s=desired_m_s,
        spare_m_s=np.ones(3),
        only=everybody,
    )
    any_broken(desired_m_s, pairs.first, pairs.second, pairs.normal, pairs.bound_m_s)
    minimum_separation(position_m, everybody, settings.floor)
