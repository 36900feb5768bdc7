"""Vehicles with velocities of their own that all lose the ground station at once, computed by hand."""

import numpy as np
import pytest

from gcs.model.setpoint_loss import FleetWithoutSetpoints, WithoutSetpoints
from gcs.planning.setpoint_loss import Action, Clash
from gcs.safety.floor import Floor
from gcs.simulation.control_loss import clashes_in_motion

FLOOR = Floor(horizontal_m=2.0, vertical_m=3.0, margin_m=5.0, uncertainty_m=5.0, deviations=1.0)
"""Margin and uncertainty do not count."""

PX4 = WithoutSetpoints(flies_on_s=1.0)
"""It stops 2 s of its velocity ahead."""

Three = tuple[float, float, float]


def found(
    position_m: list[Three],
    velocity_m_s: list[Three],
    action: Action,
    alone: WithoutSetpoints = PX4,
    other: WithoutSetpoints = PX4,
) -> list[Clash]:
    home_m = np.array([(100.0 * row, 0.0, 0.0) for row in range(len(position_m))])
    clashes = clashes_in_motion(
        np.array(position_m),
        np.array(velocity_m_s),
        home_m,
        (action,),
        FleetWithoutSetpoints([alone, *[other] * (len(position_m) - 1)]),
        floor=FLOOR,
        return_height_m=np.full(len(position_m), 30.0),
    )
    return clashes[action]


@pytest.mark.parametrize(
    ("speed_m_s", "clash"),
    [
        (1.8, False),  # 10 - 2 * 2 * 1.8 = 2.8 m, less 0.54 m where one stops 0.3 s later
        (1.9, True),  # 2.4 m, less 0.57 m
    ],
)
def test_vehicles_that_fly_at_each_other_need_room_to_stop(speed_m_s: float, clash: bool) -> None:
    places_m: list[Three] = [(0.0, 0.0, -20.0), (10.0, 0.0, -20.0)]
    assert bool(found(places_m, [(speed_m_s, 0.0, 0.0), (-speed_m_s, 0.0, 0.0)], "hold")) is clash


@pytest.mark.parametrize(
    ("velocity_m_s", "clash"),
    [
        ((4.0, 0.0, 0.0), True),  # in line: one stops 0.3 s later, 1.2 m on
        ((0.0, 4.0, 0.0), False),  # side by side: 3.2 m
        ((3.0, 0.0, 0.0), False),
    ],
)
def test_vehicles_at_one_velocity_need_room_in_line_only(velocity_m_s: Three, clash: bool) -> None:
    places_m: list[Three] = [(0.0, 0.0, -20.0), (3.0, 0.0, -20.0)]
    assert bool(found(places_m, [velocity_m_s, velocity_m_s], "hold")) is clash


def test_vehicles_that_cross_meet_before_they_stop() -> None:
    """Both are at the crossing 1 s after the loss, and 5.7 m apart when they have stopped."""
    places_m: list[Three] = [(-4.0, 0.0, -20.0), (0.0, -4.0, -20.0)]
    (clash,) = found(places_m, [(4.0, 0.0, 0.0), (0.0, 4.0, 0.0)], "hold")
    assert (clash.first, clash.second) == (0, 1)
    assert clash.sideways_m == pytest.approx(0.0, abs=1e-6)


def test_actions_begin_where_vehicles_have_stopped() -> None:
    """One above the other at the loss, and 6 m apart when they land; or the other way round."""
    above: list[Three] = [(0.0, 0.0, -20.0), (0.0, 0.0, -30.0)]
    beside: list[Three] = [(0.0, 0.0, -20.0), (6.0, 0.0, -30.0)]
    moves: list[Three] = [(0.0, 0.0, 0.0), (3.0, 0.0, 0.0)]
    assert found(above, moves, "land") == []
    assert found(beside, moves, "land") == []
    (clash,) = found(beside, [(0.0, 0.0, 0.0), (-3.0, 0.0, 0.0)], "land")
    assert clash.sideways_m == pytest.approx(0.0)
    assert found(beside, [(0.0, 0.0, 0.0), (-3.0, 0.0, 0.0)], "hold") == []


def test_an_autopilot_that_flies_on_longer_meets_another() -> None:
    """One stops after 2 s, the one behind it after 4 s."""
    places_m: list[Three] = [(0.0, 0.0, -20.0), (7.0, 0.0, -20.0)]
    moves: list[Three] = [(3.0, 0.0, 0.0), (3.0, 0.0, 0.0)]
    assert found(places_m, moves, "hold") == []
    assert found(places_m, moves, "hold", alone=WithoutSetpoints(flies_on_s=3.0)) != []


def test_each_pair_is_named_once_the_closest_first() -> None:
    places_m: list[Three] = [(0.0, 0.0, -20.0), (1.5, 0.0, -20.0), (2.5, 0.0, -20.0)]
    still: list[Three] = [(0.0, 0.0, 0.0)] * 3
    assert [(one.first, one.second, one.sideways_m) for one in found(places_m, still, "land")] == [
        (1, 2, 1.0),
        (0, 1, 1.5),
    ]
