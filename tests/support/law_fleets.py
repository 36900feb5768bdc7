"""Fleets for the property tests of law and safety."""

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from gcs.formation.obstacles import Ellipse
from gcs.formation.steering import contact_m, tangent
from gcs.model.plan import Obstacle
from gcs.model.state import Array, Mask


def within(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite numbers, none so small that its square underflows to zero."""
    return st.floats(low, high, allow_subnormal=False).map(lambda value: round(value, 6))


@st.composite
def vectors(draw: st.DrawFn, count: int, bound: float) -> Array:
    """(count, 3), each component within the bound."""
    array: Array = draw(arrays.arrays(np.float64, (count, 3), elements=within(-bound, bound)))
    return array


@st.composite
def places(draw: st.DrawFn, count: int) -> Array:
    """(count, 3) in the air above a field of 80 by 80 m."""
    return draw(vectors(count, 40.0)) * (1.0, 1.0, 0.5) - (0.0, 0.0, 30.0)


@st.composite
def masks(draw: st.DrawFn, count: int) -> Mask:
    """(count,) of True and False."""
    return np.array(draw(st.lists(st.booleans(), min_size=count, max_size=count)), dtype=bool)


@st.composite
def obstacles(draw: st.DrawFn) -> Obstacle:
    """A box somewhere on the field."""
    x_m, y_m = draw(within(-40.0, 40.0)), draw(within(-40.0, 40.0))
    half_x_m, half_y_m = draw(within(0.5, 20.0)), draw(within(0.5, 20.0))
    return Obstacle("box", x_m, y_m, half_x_m, half_y_m, draw(within(1.0, 60.0)))


def tangent_of(ellipse: Ellipse, place: Array, side: float) -> Array:
    """(2,) unit vector from a place along one of its tangents."""
    x_m, y_m = float(place[0]) - ellipse.x_m, float(place[1]) - ellipse.y_m
    return np.array(tangent(x_m, y_m, ellipse.semi_x_m, ellipse.semi_y_m, side), dtype=np.float64)


def met_m(ellipse: Ellipse, place: Array, velocity: Array, shrunk: float = 1.0) -> float:
    """Distance ahead to an ellipse, or to a smaller one, in m."""
    x_m, y_m = float(place[0]) - ellipse.x_m, float(place[1]) - ellipse.y_m
    semi_x_m, semi_y_m = shrunk * ellipse.semi_x_m, shrunk * ellipse.semi_y_m
    return contact_m(x_m, y_m, semi_x_m, semi_y_m, float(velocity[0]), float(velocity[1]))


COUNTS = st.integers(1, 6)
