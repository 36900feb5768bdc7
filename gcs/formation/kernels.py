"""Kernels of the law that a plain tick does not reach, compiled or loaded before the flight."""

import numpy as np

from gcs.formation.neighbours import Sight, step_aside
from gcs.formation.obstacles import AvoidanceSettings, Ellipse
from gcs.formation.steering import avoid_all
from gcs.formation.way import SHORTEST_WAY_M, Way, steer_center


def warm_up() -> None:
    """Run the kernels for obstacles and neighbours once, with the types used in flight."""
    center_m, desired_m_s = np.array([0.0, 0.0, -20.0]), np.array([2.0, 0.0, 0.0])
    tower = {"tower": Ellipse(10.0, 0.0, 5.0, 5.0, top_height_m=30.0)}
    settings, way = AvoidanceSettings(), Way(None, SHORTEST_WAY_M)
    steer_center(center_m, desired_m_s, center_m[None], tower, {}, settings, radius_m=1.0, way=way)
    avoid_all(center_m[None], desired_m_s[None], tower, {}, np.zeros(1), settings)
    sight = Sight(np.zeros((1, 1, 3)), np.ones((1, 1)), 30.0)  # frozen, as in flight
    step_aside(center_m[None], center_m[None], sight.inbox_m, sight.inbox_charge, sight.range_m)
