"""What counts as too near an obstacle."""

import numpy as np

from gcs.flight.monitors.space_alarms import inside_margins
from gcs.model.plan import Obstacle

HALL = Obstacle("hall", 10.0, 0.0, 4.0, 2.0, 20.0)
VAN = Obstacle("van", 0.0, 30.0, 1.0, 1.0, 2.0, velocity_x_m_s=2.0, time_s=5.0)


def test_margins_are_beside_and_above_boxes() -> None:
    places_m = np.array(
        [
            [10.0, 0.0, -5.0],  # in it
            [14.9, 0.0, -5.0],  # in the margin of its long side
            [15.1, 0.0, -5.0],
            [14.9, 2.9, -5.0],  # at its corner
            [10.0, 0.0, -21.4],  # above it, in the headroom
            [10.0, 0.0, -21.6],
            [np.nan, np.nan, np.nan],
        ]
    )
    inside = inside_margins([HALL], places_m, 0.0, 1.0, 1.5)
    assert inside[:, 0].tolist() == [True, True, False, True, True, False, False]


def test_boxes_count_where_they_are_at_that_time() -> None:
    place_m = np.array([[6.0, 30.0, -1.0]])
    assert inside_margins([HALL, VAN], place_m, 8.0, 0.5, 0.5).tolist() == [[False, True]]
    assert not inside_margins([HALL, VAN], place_m, 5.0, 0.5, 0.5).any()
