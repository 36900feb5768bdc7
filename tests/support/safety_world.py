"""Vehicles, boxes and settings whose numbers are easy to compute with, for the tests of the filter."""

from math import sqrt

import numpy as np

from gcs.formation.obstacles import Ellipse
from gcs.model.state import Array
from gcs.safety.constraints import Braking, Constraints, nearest, shortened
from gcs.safety.filter import filter_velocities
from gcs.safety.floor import Floor
from gcs.safety.neighbours import Rows
from gcs.safety.surroundings import Limits, SafetySettings, Surroundings
from gcs.safety.walls import Fence

BRAKING = Braking(reaction_s=0.5, lead_s=0.0, deceleration_m_s2=1.5, escape_rate_per_s=0.5)
FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=1.0, uncertainty_m=0.0, pad_height_m=2.0)
FENCE = Fence(height_min_m=3.0, height_max_m=100.0, distance_max_m=300.0)
SETTINGS = SafetySettings(limits=Limits(), floor=FLOOR, fence=FENCE, braking=BRAKING)
NO_PATHS = np.zeros((0, 2, 3))

BOX = Ellipse(0.0, 0.0, 5.0 * sqrt(2), 5.0 * sqrt(2), top_height_m=12.0)  # its wall: 5 m to every side


def surroundings(
    position: Array,
    *,
    velocity: Array | None = None,
    commanded: list[bool] | None = None,
    descending: bool = False,
    segments: Array = NO_PATHS,
    ellipses: dict[str, Ellipse] | None = None,
) -> Surroundings:
    n = len(position)
    return Surroundings(
        position,
        np.zeros((n, 3)) if velocity is None else velocity,
        np.ones(n, dtype=bool) if commanded is None else np.array(commanded),
        np.ones(n, dtype=bool),
        np.full(n, descending),
        segments,
        ellipses or {},
        [f"d{i}" for i in range(n)],
        np.zeros(n),
        np.full(n, np.inf),
        np.zeros((n, 3)),
        np.zeros(n),
    )


def filtered(desired: Array, around: Surroundings) -> Array:
    return filter_velocities(desired, around, SETTINGS)[0]


def half_space(row: int, other: int, normal: tuple[float, float, float], bound: float) -> Constraints:
    return Constraints(
        np.array([row]),
        np.array([other]),
        np.array([normal]),
        np.array([bound]),
        np.array([f"{row}-{other}"], dtype=object),
    )


def project(desired: Array, constraints: Constraints) -> Array:
    return nearest(desired, *_rows(constraints))


def shrink(velocity: Array, constraints: Constraints) -> Array:
    return shortened(velocity, *_rows(constraints), np.zeros(len(velocity), dtype=bool))


def _rows(constraints: Constraints) -> tuple[Rows, Rows, Array, Array]:
    return constraints.first, constraints.second, constraints.normal, constraints.bound_m_s
