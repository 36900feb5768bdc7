"""Fleets and their surroundings, for the property tests of the filter and of the tick."""

import numpy as np
from hypothesis import assume, settings
from hypothesis import strategies as st

from gcs.formation.obstacles import Ellipse
from gcs.model.state import Array, Mask
from gcs.safety.constraints import slack_m_s
from gcs.safety.separation import separation_constraints
from gcs.safety.surroundings import SafetySettings, Surroundings
from tests.support.law_fleets import vectors

CALM = settings(deadline=None)
SAFETY = SafetySettings()
LIMITS = SAFETY.limits
TICK_S = 0.05
NO_PATHS = np.zeros((0, 2, 3))
OPEN = SAFETY.model_copy(
    update={
        "fence": SAFETY.fence.model_copy(
            update={"height_min_m": 0.5, "height_max_m": 1e4, "distance_max_m": 1e4}
        )
    }
)
FASTEST_M_S = float(np.hypot(LIMITS.horizontal_m_s, max(LIMITS.up_m_s, LIMITS.down_m_s)))


def assert_within_limits(velocity: Array) -> None:
    assert np.isfinite(velocity).all()
    assert (np.hypot(velocity[:, 0], velocity[:, 1]) <= LIMITS.horizontal_m_s * (1 + 1e-9)).all()
    assert (-velocity[:, 2] <= LIMITS.up_m_s * (1 + 1e-9)).all()
    assert (velocity[:, 2] <= LIMITS.down_m_s * (1 + 1e-9)).all()


@st.composite
def legal_fleets(draw: st.DrawFn) -> tuple[Array, Array]:
    """Positions no pair of which is inside the floor, and desired velocities of any size."""
    n = draw(st.integers(2, 6))
    position = draw(vectors(n, 8.0)) - (0.0, 0.0, 30.0)
    assume(closest(position) >= SAFETY.floor.horizontal_m)
    return position, draw(vectors(n, 12.0))


def closest(position: Array) -> float:
    first, second = np.triu_indices(len(position), 1)
    scaled = (position[first] - position[second]) * SAFETY.floor.scale
    return float(np.linalg.norm(scaled, axis=1).min(initial=np.inf))


def around(
    position: Array,
    *,
    commanded: Mask | None = None,
    segments: Array = NO_PATHS,
    ellipses: dict[str, Ellipse] | None = None,
) -> Surroundings:
    n = len(position)
    return Surroundings(
        position,
        np.zeros((n, 3)),
        np.ones(n, dtype=bool) if commanded is None else commanded,
        np.ones(n, dtype=bool),
        np.zeros(n, dtype=bool),
        segments,
        ellipses or {},
        [f"d{i}" for i in range(n)],
        np.zeros(n),
        np.full(n, np.inf),
        np.zeros((n, 3)),
        np.zeros(n),
    )


def least_slack_m_s(velocity: Array, here: Surroundings, *, that_rest_keeps: bool = False) -> float:
    """Distance of the velocities (n, 3) from breaking a separation constraint; negative: one is broken.

    With `that_rest_keeps` only of constraints that vehicles at rest keep.
    """
    pairs = separation_constraints(
        here.position_m,
        here.velocity_m_s,
        here.commanded,
        here.airborne,
        floor=SAFETY.floor,
        braking=SAFETY.braking,
        uncertainty_m=here.uncertainty_m,
        course_m_s=np.zeros_like(velocity),
        spare_m_s=np.full(len(velocity), 2.0 * FASTEST_M_S),
    )
    return min(
        (
            slack_m_s(velocity, i, j, pairs.normal, pairs.bound_m_s, k)
            for k, (i, j) in enumerate(zip(pairs.first, pairs.second, strict=True))
            if pairs.bound_m_s[k] <= 0.0 or not that_rest_keeps
        ),
        default=np.inf,
    )
